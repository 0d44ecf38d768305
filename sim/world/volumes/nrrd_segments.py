"""The segments of an NRRD file of 3D Slicer: their names, and the layers that overlapping segments lie on.

Segments that overlap cannot share one label a voxel. Slicer puts them on layers, each a volume of its own, in which
numbers begin again. Here a voxel has one number all the same: where several segments hold it, one that stands for all.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

MOST_SEGMENTS = 1000

LARGEST_NUMBER = 65_535
"""Of a label in a layer."""

MOST_COMBINATIONS = 5000
"""Segments overlap in fewer ways than this; more are no segmentation."""


@dataclass(frozen=True, kw_only=True)
class Segment:
    """A segment of a file.

    Attributes:
        name: What a person calls it.
        value: Its number within its layer.
        layer: Its layer.
    """

    name: str
    value: int
    layer: int = 0


def segments_of(header: Mapping[str, Any]) -> list[Segment]:
    """The segments that the keys of an NRRD header describe.

    Args:
        header: Its fields, keys and values.
    """
    segments = []
    for index in range(MOST_SEGMENTS):
        name, value = header.get(f"Segment{index}_Name"), header.get(f"Segment{index}_LabelValue")
        if name is None and value is None:
            break
        layer = str(header.get(f"Segment{index}_Layer", "0")).strip()
        if value is not None and str(value).isdecimal() and layer.isdecimal():
            segments.append(Segment(name=_unescaped(str(name or "")), value=int(value), layer=int(layer)))
    return segments


def _unescaped(value: str) -> str:
    """The value of an NRRD key, in which line breaks and backslashes are written with a backslash before them."""
    return value.replace("\\\\", "\0").replace("\\n", " ").replace("\0", "\\").strip()


@dataclass(kw_only=True)
class SegmentLayers:
    """Layers of segments as one volume of labels.

    Attributes:
        labels: Label of each number of each layer, one array a layer, 0 for none.
        names: Name of each label.
        overlaps: Numbers that stand for several labels at once; known once all layers are combined.
        is_renumbered: Whether labels are other numbers than in the file, as a number stands for several segments.
    """

    labels: list[NDArray[np.int64]]
    names: dict[int, str]
    overlaps: dict[int, tuple[int, ...]] = field(default_factory=dict)
    is_renumbered: bool = False

    def combined(self, parts: NDArray[Any]) -> NDArray[np.uint16]:
        """One number for each voxel.

        Args:
            parts: The numbers of each layer, shape (L, I, J, K).

        Raises:
            ValueError: The numbers are no labels, or segments overlap in more ways than those of a person do.
        """
        if parts.min() < 0 or parts.max() > LARGEST_NUMBER or (parts != np.rint(parts)).any():
            raise ValueError(
                "the values of its layers are no labels, which are whole numbers from 0 to 65,535"
            )
        each = np.stack([self._labels_of(layer, parts[layer]) for layer in range(len(parts))])
        whole = each.sum(axis=0)
        is_shared = (each > 0).sum(axis=0) > 1
        if is_shared.any():
            rows, which = np.unique(each[:, is_shared].T, axis=0, return_inverse=True)
            numbers = np.array([self._number_of(tuple(int(label) for label in row if label)) for row in rows])
            whole[is_shared] = numbers[which.ravel()]
        return whole.astype(np.uint16)

    def _labels_of(self, layer: int, numbers: NDArray[Any]) -> NDArray[np.int64]:
        """The labels of the numbers of a layer; those of no segment get labels of their own."""
        table, numbers = self.labels[layer], numbers.astype(np.int64)
        for number in np.unique(numbers[table[numbers] == 0]):
            if number > 0:
                table[number] = self._next()
                self.names[int(table[number])] = f"layer {layer}, {number}"
        return table[numbers]

    def _number_of(self, members: tuple[int, ...]) -> int:
        """The number that stands for several labels."""
        for number, known in self.overlaps.items():
            if known == members:
                return number
        number = self._next()
        self.overlaps[number] = members
        return number

    def _next(self) -> int:
        """A number that is not taken."""
        taken = max((int(table.max()) for table in self.labels), default=0)
        number = max(taken, *self.overlaps, *self.names, 0) + 1
        if len(self.overlaps) > MOST_COMBINATIONS or number > LARGEST_NUMBER:
            raise ValueError("its layers overlap in too many ways; they are no segmentation")
        return number


def layers_of(segments: Sequence[Segment], n_layers: int) -> SegmentLayers:
    """The layers of a file before any is read: its own numbers, or where one stands for several segments, 1, 2, 3, ...

    Args:
        segments: All segments.
        n_layers: How many layers the file has.
    """
    values = [each.value for each in segments]
    is_renumbered = len(set(values)) < len(values)
    labels = list(range(1, len(segments) + 1)) if is_renumbered else values
    tables = [np.zeros(LARGEST_NUMBER + 1, dtype=np.int64) for _ in range(n_layers)]
    names = {}
    for each, label in zip(segments, labels, strict=True):
        if each.layer < n_layers and 0 < each.value <= LARGEST_NUMBER:
            tables[each.layer][each.value] = label
            names[label] = each.name
    return SegmentLayers(labels=tables, names=names, is_renumbered=is_renumbered)


def in_parts(
    whole: NDArray[Any], layers: SegmentLayers, thickness: int, layer_axis: int
) -> Iterator[NDArray[np.uint16]]:
    """The combined labels of voxels that are in memory, in parts of so many slices.

    Args:
        whole: The numbers, of four axes of which one is the layers'.
        layers: What they mean.
        thickness: Slices of a part.
        layer_axis: The axis of the layers.
    """
    first_axis = np.moveaxis(whole, layer_axis, 0)
    for first in range(0, first_axis.shape[3], thickness):
        yield layers.combined(first_axis[..., first : first + thickness])
