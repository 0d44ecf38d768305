"""The exit codes of the command line."""

NOT_REACHED, NOT_USABLE, BAD_INPUT, INTERRUPTED = 1, 1, 2, 130
