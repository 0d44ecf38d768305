"""The command line: a module for each command, with its flags, its help and what goes to the terminal."""

from .command_line import main

__all__ = ["main"]
