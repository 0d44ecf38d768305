"""The program behind `sounding trials`: it runs the trials of a study that are not done yet, and writes its tables."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

from tqdm import tqdm

from sim.campaign.engines.engine import Engine, Outcome
from sim.campaign.engines.factory import EngineName, make_engine
from sim.errors import UsageError
from sim.interrupt import NotedInterrupt
from sim.notices import Notify, print_notice

from .campaign_folder import CampaignFolder
from .study import Study, Trial

NOTICE = (
    "stopping: finished trials are kept, those under way are dropped and run by the next call; "
    "Ctrl-C again stops at once."
)


@dataclass(frozen=True)
class CampaignSummary:
    """What a call did, and what the campaign's folder holds."""

    folder: Path
    n_trials: int
    """Trials of the study."""
    n_done: int
    """Trials that the folder holds, failed ones too."""
    n_failed: int
    """Trials in the folder that failed, or whose worker died."""
    n_run: int
    """Trials that this call ran."""
    n_damaged: int
    """Lines of the journal that were not whole, whose trials were run again."""
    is_interrupted: bool


def run_trials(
    study: Study,
    out: Path | str,
    *,
    jobs: int = 2,
    engine: EngineName = "local",
    address: str | None = None,
    folders: bool = False,
    retry_failed: bool = False,
    overwrite: bool = False,
    any_version: bool = False,
    notify: Notify = print_notice,
) -> CampaignSummary:
    """Run the trials of a study that its folder does not hold yet, and write its tables.

    Args:
        study: A study that `make_study` or `load_study` made.
        out: The campaign's folder.
        jobs: Number of processes; the rows do not depend on it.
        engine: `local` (processes of this machine), `dask` or `ray`.
        address: Address of the Dask or Ray cluster; None starts one on this machine.
        folders: Whether each trial's episode folder is written too, under `trials/`; this takes twice the time.
        retry_failed: Whether trials that failed or whose worker died are run again.
        overwrite: Whether a campaign that the folder already holds is replaced.
        any_version: Whether to go on with a campaign that another version of the code began.
        notify: Tells what is to be known about the trials' files, each sentence once; by default on stderr.

    Raises:
        UsageError: Something cannot be done; what the folder held is kept.
        OSError: The disk is full, for example; what was done is kept.
    """
    with CampaignFolder(Path(out), overwrite=overwrite) as folder:
        folder.begin(study, any_version=any_version)
        with NotedInterrupt(NOTICE) as interrupt:
            open_trials = [trial for trial in study.trials() if _is_open(folder, trial, retry_failed)]
            n_run = 0
            if open_trials:
                print(_beginning_text(study, len(open_trials), jobs), file=sys.stderr)
                trials = _with_folders(open_trials, folder) if folders else open_trials
                with make_engine(engine, n_jobs=jobs, address=address) as running:
                    n_run = _run(running, folder, trials, interrupt, notify)
            is_interrupted = interrupt.is_set and n_run < len(open_trials)
        folder.write_tables(study)
        return CampaignSummary(
            folder=folder.path,
            n_trials=len(study),
            n_done=len(folder.journal),
            n_failed=folder.journal.n_failed,
            n_run=n_run,
            n_damaged=folder.journal.n_damaged,
            is_interrupted=is_interrupted,
        )


def _beginning_text(study: Study, n_open: int, jobs: int) -> str:
    """What there is to do, before it begins."""
    done = f", of which {len(study) - n_open} are done" if n_open < len(study) else ""
    how = "one after the other" if jobs == 1 else f"{jobs} at a time"
    return f"{study.title}: {len(study)} trials{done}; {n_open} to run, {how}. The bar shows time gone < time left."


def _is_open(folder: CampaignFolder, trial: Trial, retry_failed: bool) -> bool:
    key = trial.key
    return key not in folder.journal or (retry_failed and folder.journal.is_failed(key))


def _with_folders(trials: list[Trial], folder: CampaignFolder) -> list[Trial]:
    return [replace(trial, folder=folder.path.absolute() / "trials" / trial.name) for trial in trials]


def _run(
    engine: Engine, folder: CampaignFolder, trials: list[Trial], interrupt: NotedInterrupt, notify: Notify
) -> int:
    """Run trials, write each to the journal as it ends, tell each notice once, and return how many ended."""
    n_run, n_actions = 0, 0
    told: set[str] = set()
    n_failed = folder.journal.n_failed
    n_before = len(folder.journal)
    with tqdm(total=n_before + len(trials), initial=n_before, desc="trials", unit="trial") as progress:
        for outcome in engine.outcomes(trials):
            if outcome is not None:
                _keep(folder, outcome)
                for notice in outcome.result.notices:
                    if notice not in told:
                        with tqdm.external_write_mode(file=sys.stderr):
                            notify(notice)
                    told.add(notice)
                n_run += 1
                n_actions += outcome.result.row.get("n_sensings") or 0
                n_failed += outcome.result.row["status"] != "finished"
                seconds = max(progress.format_dict["elapsed"], 1e-9)
                progress.set_postfix_str(_postfix(n_actions / seconds, n_failed), refresh=False)
                progress.update()
            if interrupt.is_set:
                break
    return n_run


def _keep(folder: CampaignFolder, outcome: Outcome) -> None:
    """Write an outcome to the journal.

    Raises:
        UsageError: The journal cannot be written.
    """
    try:
        folder.journal.append(outcome.result.entry(outcome.trial))
    except OSError as error:
        raise UsageError(
            f"{folder.journal.path}: {error.strerror}. The {len(folder.journal)} trials that ended before are "
            "kept: make room and call again to go on."
        ) from error


def _postfix(actions_per_s: float, n_failed: int) -> str:
    return f"{actions_per_s:.1f} actions/s" + (f", {n_failed} failed" if n_failed else "")


def campaign_text(summary: CampaignSummary) -> str:
    """A summary as text for a terminal."""
    lines = [f"{summary.n_done} of {summary.n_trials} trials done, {summary.n_run} of them by this call"]
    if summary.n_failed:
        lines.append(
            f"{summary.n_failed} failed: their rows in trials.csv say why; `retry_failed` runs them again"
        )
    if summary.n_damaged:
        lines.append(f"{summary.n_damaged} lines of the journal were not whole; their trials were run again")
    lines.append(f"written to {summary.folder}")
    return "\n".join(lines)
