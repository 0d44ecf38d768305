"""What a session refuses, and why."""

from __future__ import annotations

from typing import Literal

Refusal = Literal["malformed", "too large", "wrong frame", "stale", "unknown", "unusable", "too many"]
"""Why something is refused: it is broken; larger than allowed; in a frame that cannot be the organ's; older than what
is known; of a kind or name that nobody asked for; of no use as it is; or more than can be worked off."""


class RefusedError(ValueError):
    """What the outside sent cannot be used; the text says why, and nothing has changed."""

    def __init__(self, kind: Refusal, text: str) -> None:
        """Keep the kind beside the sentence."""
        super().__init__(text)
        self.kind: Refusal = kind
