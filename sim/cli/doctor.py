"""`sounding doctor`: what is installed and what renders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from .terminal import parse

EXAMPLES = """
sounding doctor
"""
"""What the help begins with."""


@dataclass(frozen=True)
class Options:
    """Say what is installed, which OpenGL works and how fast it draws, and what to do about each red line."""


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Print the diagnosis, and return the exit code."""
    from sim.doctor.diagnosis import run_doctor

    del options
    return 0 if run_doctor().is_healthy else 1
