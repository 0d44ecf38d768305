"""The wire: one OpenIGTLink message after the other off a socket, none of which is believed before it is checked.

Header of 58 bytes (http://openigtlink.org/protocols/v2_header.html), big-endian: version, type (12 bytes), device name
(20), time stamp (seconds and fractions of 2^-32), size of the body, CRC-64 of the body.
"""

from __future__ import annotations

import re
import socket
import struct
from dataclasses import dataclass
from time import monotonic
from types import ModuleType

from sim.world.optional import optional_module

from ..errors import RefusedError

HEADER = struct.Struct("> H 12s 20s I I Q Q")
KNOWN_VERSIONS = (1, 2)
"""Versions of the header: of the protocol's versions 1 and 2, and of version 3."""
_NAME = re.compile(rb"[\x20-\x7e]*\x00*")
"""Printable ASCII, filled up with zeros."""


class LostStreamError(Exception):
    """After what came no next message can be found: the connection has to be closed."""


@dataclass(frozen=True, kw_only=True)
class WireSettings:
    """What is taken off the wire."""

    most_bytes: int = 32 * 2**20
    """Largest body of a message; a client that announces more is cut off."""
    patience_s: float = 5.0
    """How long the rest of a message that has begun may take to go on [s]."""


@dataclass(frozen=True, kw_only=True)
class RawMessage:
    """A message whose checksum is right."""

    version: int
    kind: str
    """Such as TRANSFORM."""
    device: str
    """The device's name."""
    stamp_s: float | None
    """Seconds since 1970; None where the sender did not say."""
    body: bytes


def igtl() -> ModuleType:
    """The module pyigtl.

    Raises:
        MissingPackageError: It is not installed.
    """
    return optional_module("pyigtl", "igtl", "OpenIGTLink")


def receive(connection: socket.socket, settings: WireSettings) -> RawMessage | None:
    """The next message of a connection whose time-out is short; None where none has begun yet.

    Raises:
        RefusedError: The message is broken, and the next one can be read.
        LostStreamError: The connection ended or cannot be understood any more; the cause tells what was refused.
    """
    try:
        first = connection.recv(1)
    except TimeoutError:
        return None
    if not first:
        raise LostStreamError("the client has left")
    header = first + _exactly(connection, HEADER.size - 1, settings)
    version, kind, device, seconds, fraction, size, crc = HEADER.unpack(header)
    if version not in KNOWN_VERSIONS or not (_NAME.fullmatch(kind) and _NAME.fullmatch(device)):
        raise LostStreamError("no header") from RefusedError(
            "malformed", "what came is no OpenIGTLink header"
        )
    if size > settings.most_bytes:
        text = f"a body of {size} bytes was announced, at most {settings.most_bytes} are taken"
        raise LostStreamError("too large") from RefusedError("too large", text)
    body = _exactly(connection, size, settings)
    if igtl().messages.CRC64(body) != crc:
        raise RefusedError("malformed", f"the checksum of a {_text(kind)} is wrong")
    stamp_s = seconds + fraction / 2.0**32
    return RawMessage(
        version=version, kind=_text(kind), device=_text(device), stamp_s=stamp_s or None, body=body
    )


def _exactly(connection: socket.socket, size: int, settings: WireSettings) -> bytes:
    """So many bytes of a connection.

    Raises:
        LostStreamError: It ended before.
    """
    taken, last_s = bytearray(), monotonic()
    while len(taken) < size:
        try:
            chunk = connection.recv(min(size - len(taken), 1 << 16))
        except TimeoutError:
            if monotonic() - last_s > settings.patience_s:
                raise LostStreamError("stalled") from RefusedError("malformed", "a message did not go on")
            continue
        if not chunk:
            raise LostStreamError("cut") from RefusedError("malformed", "a message broke off")
        taken += chunk
        last_s = monotonic()
    return bytes(taken)


def _text(name: bytes) -> str:
    return name.rstrip(b"\0").decode("ascii").strip()
