"""Worker processes: killed ones are replaced, their work is done again once, and nobody waits for the dead."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from multiprocessing import connection
from pathlib import Path

import pytest

from sim import workers as workers_module
from sim.errors import UsageError
from sim.workers import Workers

ROOT = Path(__file__).resolve().parents[2]


def doubled_unless_killed(marker: Path, number: int) -> int:
    """Twice the number; at 3 the process waits to be killed while the file that tells its id is not there yet."""
    if number == 3 and not marker.exists():
        marker.write_text(str(os.getpid()))
        time.sleep(600)
    return 2 * number


def killed_at_three(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return 2 * number


def half_handed_over(marker: Path, number: int) -> int:
    """Twice the number; the first time the process is killed when it has handed over half of it."""

    def half(pipe: connection.Connection, text: bytes) -> None:
        os.write(pipe.fileno(), text[: len(text) // 2])
        os.kill(os.getpid(), signal.SIGKILL)

    if not marker.exists():
        marker.touch()
        connection.Connection._send = half  # pyright: ignore[reportAttributeAccessIssue], Python's own, for this once
    return 2 * number


def with_much_in_hand(much: bytes, number: int) -> int:
    return len(much) + number


def kill_the_process_named_in(marker: Path) -> None:
    while not (marker.exists() and marker.read_text()):
        time.sleep(0.01)
    os.kill(int(marker.read_text()), signal.SIGKILL)


def test_what_a_killed_worker_had_in_hand_is_done_again_and_results_stay_in_order(tmp_path) -> None:
    marker = tmp_path / "marker"
    killer = threading.Thread(target=kill_the_process_named_in, args=(marker,))
    killer.start()
    with Workers(partial(doubled_unless_killed, marker), n_jobs=2) as workers:
        assert list(workers.in_order(range(8), lost="a number.")) == [2 * number for number in range(8)]
    killer.join()


def test_an_item_that_kills_two_workers_ends_with_a_sentence() -> None:
    with Workers(killed_at_three, n_jobs=2) as workers, pytest.raises(UsageError, match="died 2 times of a"):
        list(workers.in_order(range(8), lost="a number."))


def test_a_worker_killed_while_it_hands_a_result_over_is_noticed(tmp_path) -> None:
    """The pool would read on for the rest of the result for ever."""
    with Workers(partial(half_handed_over, tmp_path / "marker"), n_jobs=1) as workers:
        assert list(workers.in_order([4], lost="it.")) == [8]


def started_processes() -> set[int]:
    """The worker processes that this process has started."""
    found = set[int]()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == os.getpid() and b"popen_loky" in (folder / "cmdline").read_bytes():
                found.add(int(folder.name))
        except OSError:
            continue
    return found


def kill_the_first_of(known: set[int]) -> None:
    while not (new := started_processes() - known):
        time.sleep(0.005)
    os.kill(min(new), signal.SIGKILL)


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="finds its processes in /proc")
def test_a_worker_killed_as_it_starts_is_noticed_however_large_its_work() -> None:
    """Sent by the pipe that starts a process, the work would wait for room in it for ever."""
    killer = threading.Thread(target=kill_the_first_of, args=(started_processes(),))
    killer.start()
    with Workers(partial(with_much_in_hand, bytes(2_000_000)), n_jobs=1) as workers:
        assert list(workers.in_order([1, 2], lost="it.")) == [2_000_001, 2_000_002]
    killer.join()


def test_where_no_process_can_be_started_this_one_does_the_work_and_says_so(monkeypatch) -> None:
    def no_semaphores(*arguments, **named):
        raise FileNotFoundError(2, "No such file or directory")

    monkeypatch.setattr(workers_module, "ProcessPoolExecutor", no_semaphores)
    said: list[str] = []
    with Workers(abs, n_jobs=2, notify=said.append) as workers:
        assert list(workers.in_order([-1, -2], lost="a number.")) == [1, 2]
    assert len(said) == 1
    assert "/dev/shm" in said[0]
    assert "\n" not in said[0]


PROGRAM = """
from tqdm import tqdm
from sim.workers import Workers

def with_a_bar(number):
    return sum(tqdm(range(number), disable=False))

if __name__ == "__main__":
    import bars
    with Workers(bars.with_a_bar, n_jobs=2) as workers:
        print(sorted(done.result for done in workers.outcomes(range(1, 4)) if done))
"""


def test_bars_in_workers_leave_nothing_of_the_system_behind(tmp_path) -> None:
    (tmp_path / "bars.py").write_text(PROGRAM)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    run = subprocess.run(
        [sys.executable, "bars.py"], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "[0, 1, 3]"
    assert "leaked" not in run.stderr
