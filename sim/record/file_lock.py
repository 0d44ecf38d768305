"""Locks on open files, which the system frees when the process that holds them ends, however it ends."""

import sys
from typing import TextIO

if sys.platform == "win32":
    import msvcrt

    def lock_file(file: TextIO) -> None:
        """Lock a file until it is closed, without waiting.

        Raises:
            OSError: Another process holds the lock.
        """
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
else:
    import fcntl

    def lock_file(file: TextIO) -> None:
        """Lock a file until it is closed, without waiting.

        Raises:
            OSError: Another process holds the lock.
        """
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
