"""Ctrl-C that waits for a good moment.

Python raises KeyboardInterrupt wherever it is, also in finalisers and callbacks whose exceptions it drops: a run
would then go on as if nothing had been pressed. Here the first Ctrl-C is noted, and the loop looks for it.
"""

from __future__ import annotations

import signal
import sys
import threading
from types import FrameType, TracebackType
from typing import Any


class NotedInterrupt:
    """A context in which the first Ctrl-C only sets `is_set`, and the second raises KeyboardInterrupt at once.

    Outside the main thread, where Python lets nobody handle signals, the context does nothing.
    """

    def __init__(
        self,
        notice: str = "stopping after this action, whose results are kept; Ctrl-C again stops at once.",
    ) -> None:
        """Begin without an interrupt; `notice` is printed at the first one."""
        self.is_set = False
        self._notice = notice
        self._before: Any = None

    def __enter__(self) -> NotedInterrupt:
        """Take over Ctrl-C."""
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.is_set:
            raise KeyboardInterrupt
        self.is_set = True
        print(f"\n{self._notice}", file=sys.stderr)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give Ctrl-C back."""
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)
