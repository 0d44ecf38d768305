"""What MuJoCo says: its errors as one line, and its warnings caught before they reach the terminal or a log file."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

MUJOCO_ERRORS = (ValueError, RuntimeError, mujoco.FatalError)
"""What MuJoCo raises on a file that it cannot use."""


def whole_message(error: Exception) -> str:
    """All lines of an error of MuJoCo as one, with the element and the line of the file that it names."""
    return _one_line(str(error).removeprefix("Error: ")) or type(error).__name__


@contextmanager
def caught_warnings() -> Iterator[list[str]]:
    """The warnings of MuJoCo within a `with` block, one line each.

    MuJoCo itself would print them and write them to a MUJOCO_LOG.TXT in the present folder.
    """
    said: list[str] = []
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: said.append(_one_line(text)))
    try:
        with warnings.catch_warnings(record=True) as python_warnings:
            warnings.simplefilter("always")
            yield said
            texts = [_one_line(str(warning.message)) for warning in python_warnings]
            said += [text for text in texts if text not in said]
    finally:
        mujoco.set_mju_user_warning(before)


def _one_line(text: str) -> str:
    return "; ".join(line.strip().rstrip(".;:") for line in text.splitlines() if line.strip())
