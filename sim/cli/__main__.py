"""`python -m sim.cli` is the `sounding` command."""

import sys

from .command_line import main

if __name__ == "__main__":
    sys.exit(main())
