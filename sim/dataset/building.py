"""Building a dataset: episodes in shards, each written whole, so that what was stopped goes on with the next shard."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache, partial
from pathlib import Path
from time import perf_counter
from typing import Any

from threadpoolctl import threadpool_limits

from mapping import MapSettings
from mapping.storage import replacing
from sim.episode.scenario import Scenario
from sim.episode.setup import Setup, build_setup
from sim.errors import UsageError, other_input, other_values
from sim.pictures.png import png_bytes
from sim.record.locked_folder import LockedFolder
from sim.record.ownership import MANIFEST
from sim.record.run_folder import describe_machine
from sim.running.fields import changed
from sim.running.parts import make_parts
from sim.running.run_episode import make_episode
from sim.workers import Workers
from sim.world.probes.probe import ProbeModel
from sim.world.scene.arm import ArmModel

from . import hdf5_shard, parquet_shard
from .card import card_of
from .lerobot_files import write_lerobot
from .plan import DatasetPlan
from .record import record_of

MARKER = "dataset.json"
"""What the dataset is of, by which its folder is known."""


def build(plan: DatasetPlan, *, n_jobs: int, tell: Callable[[str], None]) -> int:
    """Build what is not there yet, and return how many episodes were run.

    Args:
        plan: What to build.
        n_jobs: Processes that run shards.
        tell: Called with a sentence after each shard.

    Raises:
        UsageError, WorldError, PlannerError: Something cannot be made.
        KeyboardInterrupt: Ctrl-C was pressed; whole shards are kept.
    """
    make_parts(changed(plan.config, seed=plan.seeds[0]))  # what cannot be is told before anything is written
    (hdf5_shard.h5py if plan.format == "hdf5" else parquet_shard.pyarrow)()
    start_s, n_run = perf_counter(), 0
    with LockedFolder(plan.folder, what="dataset", overwrite=True, marker=MARKER):
        _begin(plan)
        missing = [shard for shard in range(plan.n_shards) if not plan.is_there(shard)]
        for shard in _written(plan, missing, n_jobs):
            n_run += len(plan.members(shard))
            hours = (perf_counter() - start_s) / n_run * len(plan.seeds) / 3600.0
            tell(f"shard {shard + 1} of {plan.n_shards}, {n_run} episodes run; all would take {hours:.2g} h")
        if plan.format == "lerobot":
            write_lerobot(plan.folder, plan.shards_folder, plan.n_shards, Path(plan.config.scenario).stem)
        _write_text(plan.folder / "README.md", card_of(plan))
    return n_run


def write_shard(plan: DatasetPlan, shard: int) -> int:
    """Run the episodes of a shard, write it, and return its number."""
    kind = hdf5_shard.Hdf5Shard if plan.format == "hdf5" else parquet_shard.ParquetShard
    writer = kind(plan.shards_folder, shard)
    with threadpool_limits(limits=1):
        for index in plan.members(shard):
            parts = make_parts(changed(plan.config, seed=plan.seeds[index]))
            setup = _setup_of(parts.scenario, parts.arm, parts.map_settings.hinge_spacing_m, parts.probe)
            episode = make_episode(parts, setup)
            writer.add(index, record_of(episode, parts, png_bytes))
    writer.close()
    return shard


@lru_cache(maxsize=1)
def _setup_of(scenario: Scenario, arm: ArmModel | None, hinge_spacing_m: float, probe: ProbeModel) -> Setup:
    """The setup of an episode; a process keeps the last one, which seeds of one organ share."""
    return build_setup(scenario, arm, MapSettings(hinge_spacing_m=hinge_spacing_m), probe=probe)


def _written(plan: DatasetPlan, missing: list[int], n_jobs: int) -> Iterator[int]:
    """The shards that are missing, as they are written."""
    if n_jobs == 1:
        yield from (write_shard(plan, shard) for shard in missing)
        return
    with Workers[int, int](partial(write_shard, plan), n_jobs=n_jobs) as workers:
        yield from workers.in_order(missing, lost="a shard; make shards smaller")


def _begin(plan: DatasetPlan) -> None:
    """Write what the dataset is of, or see that it is of the same.

    Raises:
        UsageError: The folder holds another dataset.
    """
    if (plan.folder / MANIFEST).exists():
        raise UsageError(f"{plan.folder}: holds a run and no dataset. Choose another `out`.")
    marker, identity = plan.folder / MARKER, json.loads(json.dumps(plan.identity()))
    if marker.is_file():
        known = json.loads(marker.read_text(encoding="utf-8")).get("identity", {})
        if other := other_input(known.get("inputs", {}), identity["inputs"]):
            raise UsageError(
                f"{plan.folder}: holds a dataset that began with another {other}. Give it as it was to go on, or "
                "choose another `out`."
            )
        began, given = (_as_options(each) for each in (known, identity))
        if changed := other_values(began, given):
            raise UsageError(
                f"{plan.folder}: holds a dataset that began with other values of {changed}. Give the same to go on "
                "with it, or choose another `out`."
            )
    if n_more := plan.n_beyond():
        raise UsageError(
            f"{plan.folder}: holds {n_more} episodes beyond these {len(plan.seeds)}. More seeds may be added, and none "
            "taken away: give more `seeds`, or choose another `out`."
        )
    content = {"machine": describe_machine(), "identity": identity, "n_episodes": len(plan.seeds)}
    _write_text(marker, json.dumps(content, indent=2) + "\n")


def _as_options(identity: Mapping[str, Any]) -> dict[str, Any]:
    """What a dataset is of, by the names of the options that say so."""
    flat = {**identity, **identity.get("episodes", {})}
    return {
        "shard" if name == "shard_size" else name: value
        for name, value in flat.items()
        if name not in ("episodes", "inputs")
    }


def _write_text(path: Path, text: str) -> None:
    with replacing(path) as file:
        file.write(text.encode())
