"""The journal: what it says was done was done, whatever killed the process that wrote it."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
import textwrap

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.campaign.journal import Journal, decoded, encoded, read_entries
from sim.campaign.study import key_of


def entry(seed: int, status: str = "finished", **row) -> dict:
    return {"settings": {"seed": seed}, "row": {"status": status, **row}, "timings": {}, "curves": {}}


@settings(max_examples=50)
@given(
    st.dictionaries(
        st.text(max_size=9),
        st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=9) | st.none(),
        max_size=5,
    )
)
def test_an_entry_is_a_line_that_reads_back_with_all_digits(row) -> None:
    line = encoded(entry(3) | {"row": row})
    assert line.count(b"\n") == 1
    assert decoded(line) == entry(3) | {"row": row}


@settings(max_examples=100)
@given(st.data())
def test_no_part_of_a_line_passes_for_an_entry(data) -> None:
    line = encoded(entry(3, text="some words", number=0.123))
    cut = data.draw(st.integers(0, len(line) - 1))
    assert decoded(line[:cut]) is None
    place, other = data.draw(st.integers(0, len(line) - 1)), data.draw(st.binary(min_size=1, max_size=1))
    if line[place : place + 1] != other:
        assert decoded(line[:place] + other + line[place + 1 :]) is None


def test_a_line_written_by_half_is_cut_off_and_its_trial_open_again(tmp_path) -> None:
    path = tmp_path / "journal"
    path.write_bytes(encoded(entry(0)) + encoded(entry(1)) + encoded(entry(2))[:-9])
    with Journal(path) as journal:
        assert journal.keys() == {key_of({"seed": 0}), key_of({"seed": 1})}
        assert journal.n_damaged == 1
        journal.append(entry(2))
    assert path.read_bytes() == b"".join(encoded(entry(seed)) for seed in range(3))


def test_a_damaged_line_in_the_middle_costs_its_trial_alone(tmp_path) -> None:
    path = tmp_path / "journal"
    path.write_bytes(
        encoded(entry(0)) + encoded(entry(1)).replace(b"finished", b"finishes") + encoded(entry(2))
    )
    with Journal(path) as journal:
        assert journal.keys() == {key_of({"seed": 0}), key_of({"seed": 2})}
        assert [e["settings"]["seed"] for e in journal.entries([key_of({"seed": s}) for s in (2, 1, 0)])] == [
            2,
            0,
        ]


def test_the_last_entry_of_a_trial_counts(tmp_path) -> None:
    path = tmp_path / "journal"
    with Journal(path) as journal:
        journal.append(entry(0, "failed"))
        journal.append(entry(1))
        assert journal.n_failed == 1
        journal.append(entry(0))
        assert (journal.n_failed, len(journal)) == (0, 2)
    assert {e["settings"]["seed"]: e["row"]["status"] for e in read_entries(path)} == {
        0: "finished",
        1: "finished",
    }


def test_a_full_disk_leaves_whole_lines_alone(tmp_path) -> None:
    """A limit on the size of files stands for the disk: the write that crosses it is cut short, then fails."""
    code = f"""
        from pathlib import Path
        from sim.campaign.journal import Journal
        journal = Journal(Path({str(tmp_path / "journal")!r}))
        row = {{"status": "finished", "text": "x" * 300}}
        try:
            for seed in range(100):
                journal.append({{"settings": {{"seed": seed}}, "row": row}})
        except OSError as error:
            print(len(journal))
    """

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))

    run = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        capture_output=True,
        text=True,
        preexec_fn=limit,
        timeout=300,
    )
    n_kept = int(run.stdout)
    lines = (tmp_path / "journal").read_bytes().splitlines(keepends=True)
    assert len(lines) == n_kept == 5
    assert all(decoded(line) for line in lines)
    with Journal(tmp_path / "journal") as journal:
        assert (len(journal), journal.n_damaged) == (n_kept, 0)


def test_an_entry_that_is_not_plain_is_refused_before_it_is_written(tmp_path) -> None:
    with Journal(tmp_path / "journal") as journal:
        with pytest.raises(ValueError, match="JSON"):
            journal.append(entry(0, value=float("nan")))
        assert (tmp_path / "journal").stat().st_size == 0
