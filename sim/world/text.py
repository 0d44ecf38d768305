"""Bytes of files as text, whatever wrote them."""

from __future__ import annotations

import codecs
from pathlib import Path


def decoded(content: bytes, *, is_strict: bool = False) -> str:
    """A text as its byte order mark says, and as UTF-8 where it has none.

    Args:
        content: The bytes.
        is_strict: Whether what is no UTF-8 is an error, and not Western European, in which every byte is a letter.

    Raises:
        UnicodeDecodeError: The bytes are no text, and the reading is strict.
    """
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return content.decode("utf-16", errors="strict" if is_strict else "replace")
    for encoding in ("utf-8-sig",) if is_strict else ("utf-8-sig", "cp1252"):
        try:
            return content.decode(encoding)
        except UnicodeDecodeError:
            if is_strict:
                raise
    return content.decode("latin-1")


def read_text(path: Path) -> str:
    """The text of a file that is UTF-8 or begins with a byte order mark, as Windows' Notepad writes, with plain lines.

    Raises:
        OSError: The file cannot be read.
        UnicodeDecodeError: It is no such text.
    """
    return decoded(path.read_bytes(), is_strict=True).replace("\r\n", "\n").replace("\r", "\n")
