"""What a person may have meant who typed a name that does not exist."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LIKENESS = 0.6
"""The least likeness of a name that is suggested, from 0 to 1."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A question with the known name that is most like a word, with a blank before it; empty if none is like it."""
    by_small = {name.casefold(): name for name in known}
    like = difflib.get_close_matches(word.casefold(), by_small, n=1, cutoff=LIKENESS)
    return f" Did you mean {by_small[like[0]]}?" if like else ""
