"""NIfTI files by nibabel: what the header claims and names, and the voxels part by part, none of which is kept."""

from __future__ import annotations

import gzip
import html
import json
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from nibabel import nifti1, nifti2
from nibabel.freesurfer.mghformat import MGHHeader
from numpy.typing import NDArray

from sim.world.errors import VolumeError
from sim.world.text import decoded

from .grid import METRES_PER_UNIT, Grid
from .nifti_places import remarks_on_place

GZIP_MAGIC = b"\x1f\x8b"

HEADER_ENDINGS, DATA_ENDINGS = (".hdr", ".hdr.gz"), (".img", ".img.gz")
"""Of the two files of a pair."""

LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0])

MOST_EXTENSION_BYTES = 4 << 20
"""Longer extensions are not looked at: names of a thousand labels take some hundred thousand bytes."""

XML_LABEL = re.compile(r"<Label\b([^>]*)>(.*?)</Label>", re.DOTALL)
XML_KEY = re.compile(r"""\bKey\s*=\s*["'](\d{1,5})["']""")

AFNI_TABLE = re.compile(r"VALUE_LABEL_DTABLE.*?</AFNI_atr>", re.DOTALL)
AFNI_ROW = re.compile(r'"(\d{1,5})"\s+"([^"\n]*)"')

JSON_KEYS = ("labels", "label_map", "label_names", "labelmap", "segments")
"""Under which programs keep names in JSON."""


def read_nifti(path: Path) -> Grid:
    """The grid of a NIfTI file, or of a pair of .hdr and .img. No voxel is read before the grid's layers are taken.

    Raises:
        ValueError: The first bytes are not those of a NIfTI header. nibabel raises errors of its own on others.
    """
    head, data = pair_of(path)
    with opened(head) as file:
        header = _header_class(file, is_pair=head != data).from_fileobj(file)
    affine = np.asarray(header.get_best_affine(), dtype=np.float64)
    unit = METRES_PER_UNIT.get(str(header.get_xyzt_units()[0]), 1e-3)
    T = np.eye(4)
    T[:3] = LPS_FROM_RAS @ affine[:3] * unit
    slope, intercept = header.get_slope_inter()
    shape = tuple(int(n) for n in header.get_data_shape())
    return Grid(
        shape=shape,
        dtype=header.get_data_dtype(),
        T_lps_voxel=T,
        layers=lambda n: _layers(data, header.get_data_dtype(), shape, header.get_data_offset(), n),
        is_streamed=True,
        slope=1.0 if slope is None else float(slope),
        intercept=0.0 if intercept is None else float(intercept),
        notices=remarks_on_place(header, affine, shape, unit_mm=unit * 1e3),
        label_names=extension_names(each.content for each in getattr(header, "extensions", ())),
        is_compressed=is_gzipped(data),
        data_path=data,
    )


def read_mgh(path: Path) -> Grid:
    """The grid of a .mgh or .mgz file of FreeSurfer.

    Raises:
        ValueError: The file is damaged. nibabel raises errors of its own.
    """
    with opened(path) as file:
        header = MGHHeader.from_fileobj(file)
    T = np.eye(4)
    T[:3] = LPS_FROM_RAS @ np.asarray(header.get_affine(), dtype=np.float64)[:3] * 1e-3
    shape, dtype = (
        tuple(int(n) for n in header.get_data_shape()),
        np.dtype(cast(Any, header.get_data_dtype())),
    )
    return Grid(
        shape=shape,
        dtype=dtype,
        T_lps_voxel=T,
        layers=lambda n: _layers(path, dtype, shape, header.get_data_offset(), n),
        is_streamed=True,
        is_compressed=is_gzipped(path),
    )


def is_gzipped(path: Path) -> bool:
    """Whether a file is packed by gzip, which its first bytes tell, whatever its name says."""
    with path.open("rb") as file:
        return file.read(2) == GZIP_MAGIC


def opened(path: Path) -> BinaryIO:
    """A file that gives its bytes unpacked, whether it is packed or not."""
    return cast(BinaryIO, gzip.open(path)) if is_gzipped(path) else path.open("rb")


def pair_of(path: Path) -> tuple[Path, Path]:
    """The file of the header and that of the voxels, which are one but for .hdr and .img.

    Raises:
        VolumeError: The other file of a pair is not there.
    """
    name = path.name
    ending = next((each for each in (*HEADER_ENDINGS, *DATA_ENDINGS) if name.lower().endswith(each)), None)
    if ending is None:
        return path, path
    endings = DATA_ENDINGS if ending in HEADER_ENDINGS else HEADER_ENDINGS
    stem = name[: -len(ending)]
    others = [path.with_name(stem + case) for each in endings for case in (each, each.upper())]
    other = next((each for each in others if each.is_file()), None)
    if other is None:
        wanted = " or ".join(f"{stem}{each}" for each in endings)
        raise VolumeError(
            f"{path}: is one of a pair, and the other, {wanted}, is not beside it; put it there"
        )
    return (path, other) if ending in HEADER_ENDINGS else (other, path)


def _header_class(file: BinaryIO, *, is_pair: bool) -> type[Any]:
    """What reads a header: NIfTI-1's is of 348 bytes, NIfTI-2's of 540.

    Raises:
        ValueError: The first bytes are not those of a NIfTI header.
        VolumeError: They are Analyze's.
    """
    start = file.read(348)
    file.seek(0)
    if len(start) < 4:
        raise ValueError("the file ends within its header")
    sizes = {int.from_bytes(start[:4], order) for order in ("little", "big")}
    if not sizes & {348, 540}:
        raise ValueError("the first bytes are not those of a NIfTI header")
    if 540 in sizes:
        return nifti2.Nifti2PairHeader if is_pair else nifti2.Nifti2Header
    if is_pair and start[344:348] not in (b"ni1\0", b"n+1\0"):
        raise ValueError(
            "it is of Analyze's format, which does not tell left from right; save it as .nii.gz or .nrrd"
        )
    return nifti1.Nifti1PairHeader if is_pair else nifti1.Nifti1Header


def _layers(
    path: Path, dtype: np.dtype[Any], shape: tuple[int, ...], offset: int, n: int
) -> Iterator[NDArray[Any]]:
    """The voxels in parts of `n` layers, none of which is kept."""
    i, j, n_layers = (*shape[:2], int(np.prod(shape[2:])))
    with opened(path) as file:
        file.seek(offset)
        for first in range(0, n_layers, n):
            part = (i, j, min(n, n_layers - first))
            n_bytes = int(np.prod(part)) * dtype.itemsize
            content = file.read(n_bytes)
            if len(content) < n_bytes:
                raise EOFError(
                    f"it ends {n_bytes - len(content):,} bytes before layer {first + part[2]} does"
                )
            yield np.frombuffer(content, dtype).reshape(part, order="F")


def extension_names(contents: Iterable[bytes]) -> dict[int, str]:
    """The names that the extensions of a NIfTI header give the labels.

    TotalSegmentator and Connectome Workbench write a table of labels in XML, AFNI a table of its own, others JSON.

    Args:
        contents: The bytes of each extension.
    """
    names: dict[int, str] = {}
    for content in contents:
        if len(content) > MOST_EXTENSION_BYTES:
            continue
        text = decoded(content).strip("\0 \t\r\n")
        found = _names_in_xml(text) or _names_in_table(text) or _names_in_json(_parsed(text))
        names = {**found, **names}
    return {label: name for label, name in names.items() if label > 0 and name}


def _names_in_xml(text: str) -> dict[int, str]:
    """The names of a label table as Caret and Connectome Workbench write it."""
    names = {}
    for attributes, body in XML_LABEL.findall(text):
        key = XML_KEY.search(attributes)
        if key is not None:
            plain = re.fullmatch(r"\s*<!\[CDATA\[(.*?)\]\]>\s*", body, flags=re.DOTALL)
            names[int(key[1])] = (plain[1] if plain else html.unescape(body)).strip()
    return names


def _names_in_table(text: str) -> dict[int, str]:
    """The names of AFNI's table of values."""
    table = AFNI_TABLE.search(text)
    rows = AFNI_ROW.findall(html.unescape(table[0])) if table else ()
    return {int(label): name.strip() for label, name in rows}


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return None
    except RecursionError:
        return None


def _names_in_json(tree: Any) -> dict[int, str]:
    """Names in JSON: numbers to names, names to numbers, or lists of objects with a name and a value."""
    if isinstance(tree, list):
        return {label: name for each in tree for label, name in _names_in_json(each).items()}
    if not isinstance(tree, dict):
        return {}
    for key in JSON_KEYS:
        if isinstance(tree.get(key), dict | list):
            return _names_in_json(tree[key])
    if isinstance(tree.get("name"), str):
        value = next((tree[key] for key in ("value", "label", "id", "labelID") if key in tree), None)
        return {value: tree["name"]} if isinstance(value, int) else {}
    names = {}
    for key, value in tree.items():
        if str(key).isdecimal() and isinstance(value, str):
            names[int(key)] = value
        elif isinstance(value, int) and not isinstance(value, bool):
            names[value] = str(key)
    return names
