"""The command line: one module a command, with its flags, its help and what goes to the terminal."""

from .command_line import main

__all__ = ["main"]
