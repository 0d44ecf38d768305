"""The `sounding` command, which finds a command's module, reads its options, and tells an error in one line."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from importlib import metadata
from types import ModuleType

import tyro

from planner import PlannerError
from sim.errors import UsageError
from sim.streams import safe_streams
from sim.suggestions import did_you_mean
from sim.world.errors import WorldError

from .terminal import BAD_INPUT, FAILED, in_flags

COMMANDS = {
    "episode": "episode",
    "trials": "trials",
    "dataset": "studies.dataset",
    "bound": "studies.bound",
    "bench": "studies.bench",
    "compare": "compare",
    "serve": "live.serve",
    "controller": "live.controller",
    "reach": "reach",
    "ik": "ik",
    "image": "sensing.image",
    "replay": "replay",
    "report": "report",
    "view": "view",
    "inspect": "inspection",
    "export": "export",
    "doctor": "doctor",
}
"""The module of each command, which has `Options`, `parse_options` and `run`."""
DESCRIPTION = (
    "Sounding plans where a robot arm presses an ultrasound-like probe on an organ, so that hidden tumours are "
    "mapped in few sensing actions.\n\nExamples:\n"
    "    sounding doctor            # what is installed, and what renders\n"
    "    sounding episode           # a first run; the last lines name its folder\n"
    "    sounding episode --help    # the options of a command, after examples of it\n"
    "    sounding --version\n"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, and return the exit code: 0 done, 2 bad input (one line says what), 130 interrupted."""
    try:
        with safe_streams():
            return _run(list(sys.argv[1:] if arguments is None else arguments))
    except OSError as error:
        print(f"sounding: stdout: {error.strerror}. Files were written all the same.", file=sys.stderr)
        return BAD_INPUT


def _run(words: list[str]) -> int:
    from sim.world.camera.gl import adopt_mujoco_gl

    # MuJoCo looks at the choice of OpenGL when it is imported.
    adopt_mujoco_gl()
    command = _module(words[0]) if words and words[0] in COMMANDS else None
    try:
        if words[:1] in (["--version"], ["-V"]):
            print(f"sounding {metadata.version('sounding')}")
            return 0
        if command is None:
            return _help(words)
        options = command.parse_options(words[1:], f"sounding {words[0]}")
        try:
            return command.run(options)
        except SystemExit as error:
            # Nothing of ours ends the process, but what a user brings along may.
            print(
                f"sounding: code that was called ended the program (exit code {error.code}).", file=sys.stderr
            )
            return FAILED
    except (UsageError, WorldError, PlannerError) as error:
        print(f"sounding: {in_flags(error, command and command.Options)}", file=sys.stderr)
        return BAD_INPUT
    except OSError as error:
        print(
            f"sounding: {_what_failed(error)}. What was written so far is kept.",
            file=sys.stderr,
        )
        return BAD_INPUT


def _what_failed(error: OSError) -> str:
    """The file and the reason of the system's error; the error's own words where it names neither."""
    if error.strerror is None:
        return f"{type(error).__name__}: {error}"
    return f"{error.filename}: {error.strerror}" if error.filename else error.strerror


def parse_command(arguments: Sequence[str]) -> object:
    """The options of a command line whose first word names the command.

    Raises:
        UsageError: A value is out of range.
    """
    return _module(arguments[0]).parse_options(arguments[1:], f"sounding {arguments[0]}")


def _module(command: str) -> ModuleType:
    return importlib.import_module(f".{COMMANDS[command]}", package=__package__)


def _help(words: list[str]) -> int:
    """Tell the commands, or that there is no such command, and end the process.

    Raises:
        UsageError: The first word is no command.
    """
    if words and not words[0].startswith("-"):
        raise UsageError(
            f"{words[0]}: there is no such command. Commands: {', '.join(COMMANDS)}."
            f"{did_you_mean(words[0], COMMANDS)}"
        )
    options = {name: _module(name).Options for name in COMMANDS}
    tyro.extras.subcommand_cli_from_dict(
        options, prog="sounding", description=DESCRIPTION, args=words, sort_subcommands=False
    )
    # No command was named, and tyro has said so.
    return BAD_INPUT
