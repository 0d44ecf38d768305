"""Hidden seeds: made from a key that the organiser alone holds, who shows a commitment to it.

seed(task, i) is the first 63 bits of HMAC-SHA256(key, "task name|i") (RFC 2104). Whoever lacks the key can tell no
seed, and the commitment, a digest of the key, binds the organiser to one key for all entrants.
"""

from __future__ import annotations

import hashlib
import hmac
from pathlib import Path

from sim.errors import FieldError

LEAST_KEY_BYTES = 32
_COMMITTED = b"sounding-bench key\n"


def read_key(path: Path) -> bytes:
    """The key that a file holds: all of its bytes.

    Raises:
        FieldError: The file cannot be read, or is too short for nobody to guess it.
    """
    try:
        key = path.read_bytes()
    except OSError as error:
        raise FieldError("key", path, f"cannot be read ({error.strerror}).") from error
    if len(key) < LEAST_KEY_BYTES:
        raise FieldError(
            "key",
            path,
            f"has {len(key)} bytes; a key that nobody guesses has {LEAST_KEY_BYTES} random bytes or more.",
        )
    return key


def hidden_seed(key: bytes, task: str, index: int) -> int:
    """The hidden seed of a trial, from 0 to 2^63 - 1.

    Args:
        key: The organiser's key.
        task: The task's name with its version.
        index: The trial's number, from 0 on.
    """
    told = hmac.digest(key, f"{task}|{index}".encode(), "sha256")
    return int.from_bytes(told[:8], "big") >> 1


def commitment(key: bytes) -> str:
    """What may be shown of a key: a digest, from which nobody finds the key."""
    return hashlib.sha256(_COMMITTED + key).hexdigest()
