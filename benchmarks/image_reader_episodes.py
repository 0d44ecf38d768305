"""Episodes with the reader of images: are the lesions found and outlined in 30 actions, and what does trust bring?

    .venv/bin/python -m benchmarks.image_reader_episodes [--cases liver lits_27_predtum unc_p2_HCC_031 skvtk_patient]
        [--readers image] [--trust told learnt] [--tissues hypoechoic] [--actions 30] [--seeds 8] [--first 0]

Episodes of find-and-outline with a free probe and the sensor ultrasound. A case is a scenario, or the name of a
patient's liver in $SOUNDING_DATA/livers, which is left out where it is not there. With the trust `learnt` map and
planner learn how often the labels err; with `told` the reader says of each label how sure it is; with `exact` labels
are taken as they are. Lesions count that lie in some pose's cone. A finding is a piece that the map calls tumour, and a
false one touches no lesion. Surface distances are means over both ways, of the lesions that were found.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
from multiprocessing import get_context
from typing import Any

import numpy as np
import tyro
from threadpoolctl import threadpool_limits
from tqdm import tqdm

from benchmarks.patients import cases
from sim.comparison.estimates import mean_estimate
from sim.comparison.texts import interval_text
from sim.episode.setup import Setup, build_setup
from sim.findings.evidence import EpisodeWitness
from sim.findings.findings import find
from sim.running.fields import config_of
from sim.running.parts import EpisodeParts, make_parts
from sim.running.run_episode import make_episode
from sim.tables import markdown_table

CASES = ("liver", "lits_27_predtum", "unc_p2_HCC_031", "skvtk_patient")
SENSED = 0.95


@dataclass(frozen=True, kw_only=True)
class Options:
    """Print a row for each case, tissue, reader and trust."""

    cases: tuple[str, ...] = CASES
    readers: tuple[str, ...] = ("image",)
    trust: tuple[str, ...] = ("told",)
    """How labels are trusted; those of the reader exact always are."""
    tissues: tuple[str, ...] = ("hypoechoic",)
    actions: int = 30
    seeds: int = 8
    first: int = 0
    """First seed."""
    jobs: int = 1


def files_of(case: str) -> dict[str, Any] | None:
    """The options that name a case; None of a patient's liver that is not there."""
    if case in ("sphere", "spheres", "liver", "generated-liver"):
        return {"scenario": case}
    found = [files for label, files in cases(case) if label.split()[0] == case]
    return found[0] if found else None


def parts_of(case: str, seed: int, reader: str, trust: str, tissue: str, actions: int) -> EpisodeParts:
    """The parts of an episode."""
    config = config_of(
        **(files_of(case) or {}),
        sensor="ultrasound",
        reader=reader,
        label_trust=trust,
        tumour_tissue=tissue,
        arm="none",
        motion="none",
        steps=actions,
        seed=seed,
    )
    return make_parts(config)


@lru_cache(maxsize=1)
def setup_of(case: str) -> Setup:
    """Organ and workspace, which all seeds of a case share."""
    parts = parts_of(case, 0, "exact", "exact", "hypoechoic", 1)
    return build_setup(parts.scenario, None, parts.map_settings)


def play(seed: int, *, case: str, reader: str, trust: str, tissue: str, actions: int) -> dict[str, Any]:
    """What became of one episode."""
    with threadpool_limits(1):
        parts = parts_of(case, seed, reader, trust, tissue, actions)
        episode = make_episode(parts, setup_of(case))
        witness = EpisodeWitness(episode, parts.map_settings.prior_prevalence)
        needed, auprc = None, None
        for step in episode.steps(actions):
            witness.note()
            auprc = step.auprc
            if needed is None and (step.sensed_fraction or 0.0) >= SENSED:
                needed = step.step
        findings = find(witness.evidence())
    lesions = [
        (1e3 * each.diameter_m, bool(each.is_found), each.dice, each.surface_mean_m)
        for each in findings.tumours
        if each.attainable_fraction
    ]
    return {
        "needed": needed,
        "auprc": auprc,
        "lesions": lesions,
        "n_false": len(findings.false),
        "missed": episode.trust.rates.missed,
    }


def row(name: list[str], runs: list[dict[str, Any]], actions: int) -> list[str]:
    """The figures of some episodes."""
    needed = [each["needed"] for each in runs]
    lesions = [lesion for each in runs for lesion in each["lesions"]]
    large = [each for each in lesions if each[0] >= 10.0]
    small = [each for each in lesions if each[0] < 10.0]
    gaps_mm = [1e3 * each[3] for each in large if each[3] is not None]
    auprc = mean_estimate(np.array([each["auprc"] for each in runs], float))
    return [
        *name,
        f"{np.mean([actions if each is None else each for each in needed]):.1f}",
        str(needed.count(None)),
        f"{auprc.mean:.3f} {interval_text(auprc.interval, '{:.3f}')}",
        f"{sum(each[1] for each in small)} of {len(small)}",
        f"{sum(each[1] for each in large)} of {len(large)}",
        f"{np.mean([each[2] for each in large]):.3f}" if large else "-",
        f"{np.mean(gaps_mm):.2f}" if gaps_mm else "-",
        f"{np.mean([each['n_false'] for each in runs]):.2f}",
        f"{np.mean([each['missed'] for each in runs]):.3f}",
    ]


def main(options: Options) -> None:
    """Print the table."""
    head = [
        *("case", "tissue", "reader", "trust", "actions to 95 %", "never", "AUPRC", "found, below 10 mm"),
        *("10 mm and more", "Dice of these", "surface [mm]", "false a run", "learnt: missed"),
    ]
    rows, seeds = [], range(options.first, options.first + options.seeds)
    with ProcessPoolExecutor(options.jobs, mp_context=get_context("spawn")) as pool:
        for case in options.cases:
            if files_of(case) is None:
                print(f"{case} is left out: no such folder in $SOUNDING_DATA/livers")
                continue
            for tissue in options.tissues:
                for reader in options.readers:
                    for trust in options.trust if reader != "exact" else ("exact",):
                        work = partial(
                            play,
                            case=case,
                            reader=reader,
                            trust=trust,
                            tissue=tissue,
                            actions=options.actions,
                        )
                        runs = list(
                            tqdm(pool.map(work, seeds), total=len(seeds), desc=f"{case} {reader} {trust}")
                        )
                        rows.append(row([case, tissue, reader, trust], runs, options.actions))
                        print(" | ".join(rows[-1]), flush=True)
    print("\n" + markdown_table(head, rows))


if __name__ == "__main__":
    # Worker processes find functions by the name of their module, which is not `__main__` there.
    from benchmarks import image_reader_episodes

    image_reader_episodes.main(tyro.cli(image_reader_episodes.Options))
