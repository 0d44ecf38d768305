"""Standard streams that no program dies of: any encoding, closed ones, and readers that have gone away."""

from __future__ import annotations

import codecs
import io
import os
import sys
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

PLAIN = "sounding-plain"
"""Name of the error handler that writes what an encoding lacks in plain letters."""
PLAIN_SIGNS = str.maketrans(
    {
        **dict.fromkeys("‐‑‒–—−─━═", "-"),
        **dict.fromkeys("│┃║", "|"),
        **dict.fromkeys("╭╮╰╯┌┐└┘├┤┬┴┼╔╗╚╝", "+"),
        **dict.fromkeys("‘’", "'"),
        **dict.fromkeys("“”„", '"'),
        **{
            "±": "+-",
            "×": "x",
            "·": ".",
            "°": " degrees",
            "µ": "u",
            "→": "->",
            "≤": "<=",
            "≥": ">=",
            "…": "...",
        },
    }
)


@contextmanager
def safe_streams() -> Iterator[None]:
    """A context in which printing neither fails nor complains where it cannot matter to the program.

    What the terminal's encoding lacks is written in plain letters. A stream that is closed, or whose reader has gone
    away, swallows what is printed, so that a run goes on to its end. A full disk under stdout is still an error.
    """
    codecs.register_error(PLAIN, _in_plain_letters)
    _fill_closed_descriptors()
    before = sys.stdout, sys.stderr
    after = _safe(sys.stdout, sys.__stdout__, 1), _safe(sys.stderr, sys.__stderr__, 2)
    sys.stdout, sys.stderr = after
    try:
        # The error of a full disk comes here, since at the interpreter's end it would be a strange text, and not in
        # `finally`, where it would hide another.
        try:
            yield
        except SystemExit:
            sys.stdout.flush()
            raise
        sys.stdout.flush()
    finally:
        _flush_quietly(after)
        sys.stdout, sys.stderr = before


@contextmanager
def quiet_stdout() -> Iterator[None]:
    """A context in which what compiled code prints goes nowhere; HiGHS, for one, leaves a line of its own now and then.

    Such code writes to the descriptor and past Python's stream, so the descriptor itself leads elsewhere meanwhile.
    """
    try:
        kept = os.dup(1)
    except OSError:
        # There is no stdout that could be written to.
        yield
        return
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.close(nowhere)
        yield
    finally:
        _flush_compiled()
        os.dup2(kept, 1)
        os.close(kept)


def _flush_compiled() -> None:
    """Have the C library write what it holds back; where it cannot be asked, its text comes later."""
    import ctypes

    with suppress(OSError, TypeError, AttributeError):
        ctypes.CDLL(None).fflush(None)


def _flush_quietly(streams: tuple[Any, ...]) -> None:
    for stream in streams:
        try:
            stream.flush()
        except (OSError, ValueError):
            continue


def _in_plain_letters(error: UnicodeError) -> tuple[str, int]:
    """What stands for letters that an encoding lacks, and where to go on, as `codecs.register_error` wants it."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end].translate(PLAIN_SIGNS)
    # An accent is dropped; of a letter of another script nothing is left but a question mark.
    plain = (unicodedata.normalize("NFKD", each).encode("ascii", "ignore").decode() or "?" for each in text)
    return "".join(plain), error.end


def _fill_closed_descriptors() -> None:
    """Open the null device where stdin, stdout or stderr is closed, so that no file of a run gets its number."""
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            # The system gives the lowest number that is free.
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)


def _safe(stream: Any, own: Any, descriptor: int) -> Any:
    """A stream that can be printed to; one that a caller has put in the place of Python's own is left alone."""
    if stream is None:
        return _wrapped(descriptor, encoding="utf-8")
    if stream is not own or not isinstance(stream, io.TextIOWrapper):
        return stream
    stream.reconfigure(errors=PLAIN)
    if stream.isatty():
        return stream
    stream.flush()
    return _wrapped(descriptor, encoding=stream.encoding)


def _wrapped(descriptor: int, *, encoding: str) -> io.TextIOWrapper:
    raw = _Forgiving(descriptor, "w", closefd=False)
    is_stderr = descriptor == 2
    return io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=encoding,
        errors=PLAIN,
        line_buffering=is_stderr,
        write_through=is_stderr,
    )


class _Forgiving(io.FileIO):
    """A file descriptor that swallows what nobody reads; on stderr, what cannot be written at all."""

    def write(self, text: Any, /) -> int:
        try:
            return super().write(text) or 0
        except BrokenPipeError:
            return len(memoryview(text).cast("B"))
        except OSError:
            if self.fileno() != 2:
                raise
            return len(memoryview(text).cast("B"))
