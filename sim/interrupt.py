"""Ctrl-C, and a scheduler's request to end, that wait for a good moment.

Python raises KeyboardInterrupt wherever it is, also in finalisers and callbacks whose exceptions it drops: a run
would then go on as if nothing had been pressed. Here the first Ctrl-C is noted, and the loop looks for it. SIGTERM,
which a cluster sends some time before it kills, is taken for one.
"""

from __future__ import annotations

import signal
import sys
import threading
from types import FrameType, TracebackType
from typing import Any

_NOTED = (signal.SIGINT, signal.SIGTERM)


class NotedInterrupt:
    """A context in which the first Ctrl-C or SIGTERM only sets `is_set`, and the next raises KeyboardInterrupt at once.

    Outside the main thread, where Python lets nobody handle signals, the context does nothing.
    """

    def __init__(
        self,
        notice: str = "stopping after this action, whose results are kept; Ctrl-C again stops at once.",
    ) -> None:
        """Begin without an interrupt; `notice` is printed at the first one."""
        self.is_set = False
        self._notice = notice
        self._before: dict[int, Any] = {}

    def __enter__(self) -> NotedInterrupt:
        """Take over both signals."""
        if threading.current_thread() is threading.main_thread():
            self._before = {number: signal.signal(number, self._note) for number in _NOTED}
        return self

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.is_set:
            raise KeyboardInterrupt
        self.is_set = True
        print(f"\n{self._notice}", file=sys.stderr)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Give them back."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
