"""The leaderboard is what its command makes of the submissions, which are small and whole."""

from __future__ import annotations

import pytest

from benchmarks.leaderboard import LIMITS, PAGE, SUBMISSIONS, load_submissions, page
from sim.bench.claims import faults_of_claims
from sim.bench.submission import SUBMISSION
from sim.bench.tasks import all_tasks

MOST_BYTES = 200_000
NAMES = sorted(path.parent.name for path in SUBMISSIONS.glob(f"*/{SUBMISSION}"))


def test_the_page_is_what_the_command_makes() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(load_submissions())


@pytest.mark.parametrize("name", NAMES)
def test_a_submission_is_small_and_its_scores_follow_from_its_trials(name) -> None:
    assert (SUBMISSIONS / name / SUBMISSION).stat().st_size < MOST_BYTES
    content = load_submissions()[name]
    known = {task.name: task for task in all_tasks()}
    # Versions are those of the machine that ran it.
    faults = faults_of_claims(content, known, None, SUBMISSIONS / name)
    assert [fault for fault in faults if not fault.startswith("made with")] == []


def test_the_limit_is_beside_the_scores_of_its_task() -> None:
    text = page(load_submissions())
    assert text.count("*the limit*") == len(LIMITS)
    assert all(path.is_file() for path in LIMITS.values())
