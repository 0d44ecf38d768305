"""Every shell command of every page, run as a reader runs it: `pytest -m slow tests/docs/test_docs_commands.py`.

A page's commands run in their order, in one folder that looks like a clone, as processes of their own. What is long is
made short by the table `SHORTER` of page_commands.py, and what the pages speak of is made there too.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
import subprocess
from functools import cache
from pathlib import Path

import pytest
from page_commands import BEFORE, NEEDED, SHORTER, Command, all_commands, make_clone, provide_files

pytestmark = pytest.mark.slow

MOST_SECONDS = 1800
WRITTEN_TO = ("--out", "--video", "--rerun")
"""Flags whose file or folder is there afterwards."""


@pytest.fixture(scope="module")
def clone(tmp_path_factory):
    """The folder of a page by its name, made when it is first asked for."""

    @cache
    def of(page: str) -> Path:
        folder = make_clone(tmp_path_factory.mktemp("pages") / Path(page).stem, page)
        for line in BEFORE.get(page, ()):
            run(line, folder)
        return folder

    return of


def run(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a line of shell in a page's folder."""
    # What stands in .venv/bin is not on a reader's PATH.
    environment = os.environ | {"PYTHONPATH": str(folder), "OPENBLAS_NUM_THREADS": "1"}
    environment.pop("DISPLAY", None)
    done = subprocess.run(
        ["sh", "-c", line], cwd=folder, env=environment, timeout=MOST_SECONDS, capture_output=True, text=True
    )
    assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
    assert "Traceback" not in done.stdout + done.stderr, line
    return done


@pytest.mark.parametrize("command", all_commands(), ids=str)
def test_a_command_of_a_page_runs(command: Command, clone) -> None:
    if command.reason_to_skip:
        pytest.skip(command.reason_to_skip)
    for word, module in NEEDED:
        if word in command.bare and importlib.util.find_spec(module) is None:
            pytest.skip(f"needs the extra that brings {module}")
    folder = clone(command.page)
    provide_files(folder, command)
    print(run(command.short, folder).stdout)
    words = shlex.split(command.short)
    for flag in WRITTEN_TO:
        if flag in words:
            assert (folder / words[words.index(flag) + 1]).exists()


def test_no_command_is_made_short_in_vain() -> None:
    """Each entry of the table is of some page."""
    text = "\n".join(command.printed for command in all_commands())
    assert [pattern for pattern, _ in SHORTER if not re.search(pattern, text)] == []
