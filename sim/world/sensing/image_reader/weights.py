"""The file of the network's numbers: safetensors, with what tells its version, its layers and that it is whole.

A file begins with the length of its header as eight bytes, the lowest first; the header is JSON, and the numbers follow
(https://huggingface.co/docs/safetensors). Files of others' making read it too, and nothing in it is ever run.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.errors import FieldError

from .frames import N_CHANNELS
from .layers import BLOCK

SHIPPED = Path(__file__).parent / "weights.safetensors"
"""The weights that come with Sounding."""
FORMAT, VERSION = "sounding image reader", "1"
"""What a file has to say of itself."""
FIELD = "reader_weights"
"""The option that names a file, for errors."""
MOST_BYTES = 50_000_000
"""No reader is larger; a larger file is none."""
MOST_LEVELS = 5
"""Frames are halved at most four times."""
AGAIN = "Train it anew (benchmarks.train_image_reader of the repository), or leave the option out for the shipped ones"


@dataclass(frozen=True, eq=False, kw_only=True)
class ReaderWeights:
    """A trained network, and what its answers mean."""

    arrays: Mapping[str, NDArray[np.float32]]
    """The numbers of each layer by its name."""
    widths: tuple[int, ...]
    """Channels of each level, the finest first."""
    scale: float
    """Calibration: the log odds that a cell is lesion are `scale` times the network's answer plus `offset`."""
    offset: float
    prior_log_odds: float
    """Log odds of lesion among the cells by which it was calibrated."""
    trained: str = ""
    """How it was trained."""


def shapes_of(widths: tuple[int, ...]) -> dict[str, tuple[int, ...]]:
    """The layers of a network of some widths, by name with their shapes."""
    shapes: dict[str, tuple[int, ...]] = {}
    before = N_CHANNELS
    for level, width in enumerate(widths):
        for n in range(2):
            shapes[f"down{level}.{n}.weight"], shapes[f"down{level}.{n}.bias"] = (
                (width, before, 3, 3),
                (width,),
            )
            before = width
    for level, (width, below) in enumerate(pairwise(widths)):
        shapes[f"mix{level}.weight"], shapes[f"mix{level}.bias"] = (width, below), (width,)
        shapes[f"up{level}.weight"], shapes[f"up{level}.bias"] = (width, width, 3, 3), (width,)
    shapes["head.weight"], shapes["head.bias"] = (widths[0],), (1,)
    return shapes


def save_weights(weights: ReaderWeights, file: Path) -> None:
    """Write a file of weights.

    Args:
        weights: A trained network.
        file: Where to.
    """
    told = {
        "format": FORMAT,
        "version": VERSION,
        "widths": json.dumps(weights.widths),
        "scale": repr(weights.scale),
        "offset": repr(weights.offset),
        "prior_log_odds": repr(weights.prior_log_odds),
        "trained": weights.trained,
    }
    header: dict[str, Any] = {}
    data = b""
    for name in shapes_of(weights.widths):
        array = np.ascontiguousarray(weights.arrays[name], dtype="<f4")
        end = len(data) + array.nbytes
        header[name] = {"dtype": "F32", "shape": list(array.shape), "data_offsets": [len(data), end]}
        data += array.tobytes()
    header["__metadata__"] = told | {"sha256": _checksum(told, data)}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    file.write_bytes(len(text).to_bytes(8, "little") + text + data)


@lru_cache(maxsize=2)
def load_weights(file: Path | None = None) -> ReaderWeights:
    """The weights of a file, kept for the next time.

    Args:
        file: A file of weights; None for the shipped ones.

    Raises:
        FieldError: The file is missing or damaged, is of another version, or is none of a reader.
    """
    path = file or SHIPPED
    try:
        if path.stat().st_size > MOST_BYTES:
            raise FieldError(FIELD, path, f"this is no file of a reader's weights. {AGAIN}.")
        content = path.read_bytes()
    except OSError as error:
        remedy = AGAIN if file else "Install Sounding anew"
        raise FieldError(FIELD, path, f"this file cannot be read ({error.strerror}). {remedy}.") from error
    return _parsed(path, content)


def _parsed(path: Path, content: bytes) -> ReaderWeights:
    """The weights that the content of a file tells."""
    length = int.from_bytes(content[:8], "little")
    try:
        header = json.loads(content[8 : 8 + length])
        told = dict(header.pop("__metadata__"))
        if told["format"] != FORMAT:
            raise ValueError
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise FieldError(FIELD, path, f"this is no file of a reader's weights. {AGAIN}.") from error
    if told.get("version") != VERSION:
        problem = (
            f"the weights are of version {told.get('version')}, and this Sounding reads version {VERSION}"
        )
        raise FieldError(FIELD, path, f"{problem}. {AGAIN}.")
    data = content[8 + length :]
    if told.pop("sha256", None) != _checksum(told, data):
        raise FieldError(
            FIELD, path, f"the file is damaged: its checksum is not that of its content. {AGAIN}."
        )
    return _weights(path, header, told, data)


def _weights(path: Path, header: dict[str, Any], told: dict[str, str], data: bytes) -> ReaderWeights:
    """The weights of a file that is whole; one of another's making may still hold other layers."""
    try:
        widths = tuple(int(width) for width in json.loads(told["widths"]))
        if not 2 <= len(widths) <= MOST_LEVELS or any(width < BLOCK or width % BLOCK for width in widths):
            raise ValueError
        arrays = {}
        for name, shape in shapes_of(widths).items():
            first, last = header[name]["data_offsets"]
            array = np.frombuffer(data[first:last], dtype="<f4").reshape(shape).astype(np.float32)
            array.setflags(write=False)
            if header[name]["dtype"] != "F32" or not np.isfinite(array).all():
                raise ValueError
            arrays[name] = array
        numbers = {name: float(told[name]) for name in ("scale", "offset", "prior_log_odds")}
        return ReaderWeights(arrays=arrays, widths=widths, trained=told.get("trained", ""), **numbers)
    except (ValueError, KeyError, TypeError) as error:
        problem = "its layers are not those of a reader"
        raise FieldError(FIELD, path, f"the file is damaged: {problem}. {AGAIN}.") from error


def _checksum(told: Mapping[str, str], data: bytes) -> str:
    """The SHA-256 of what a file tells and of its numbers."""
    return hashlib.sha256(json.dumps(dict(told), sort_keys=True).encode() + data).hexdigest()
