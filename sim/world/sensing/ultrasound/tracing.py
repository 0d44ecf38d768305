"""The compiled loop that follows the lines of a plane through the tissue."""

# numba compiles these functions, which take many arrays and no objects.

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .compiling import compiled

MIXED = 255
SPECULAR_SHARE = 0.85
"""Share of a boundary's echo that returns as from a mirror; the rest is diffuse, as from a rough one."""
SPECULAR_RAD = 0.35
"""Angle of incidence at which the mirror's part has fallen to 1/e [rad]: the array catches what misses its middle."""


@compiled
def label_between(labels, margins, i, j, k, u, v, w):  # noqa: ANN001, ANN201
    """The label with the largest sum of margins at a place of a cell whose corners differ."""
    best, best_sum = 0, -1.0
    for corner in range(8):
        candidate = labels[i + (corner & 1), j + ((corner >> 1) & 1), k + (corner >> 2)]
        if candidate == best and corner > 0:
            continue
        total = 0.0
        for other in range(8):
            a, b, c = other & 1, (other >> 1) & 1, other >> 2
            if labels[i + a, j + b, k + c] == candidate:
                weight = (u if a else 1.0 - u) * (v if b else 1.0 - v) * (w if c else 1.0 - w)
                total += weight * margins[i + a, j + b, k + c]
        if total > best_sum:
            best, best_sum = int(candidate), total
    return best


@compiled
def label_at(cells, labels, margins, x, y, z):  # noqa: ANN001, ANN201
    """The label at a point given in spacings from the first node; 0 beyond the grid."""
    if not (x >= 0.0 and y >= 0.0 and z >= 0.0):
        return 0
    i, j, k = np.uint32(x), np.uint32(y), np.uint32(z)
    if i >= cells.shape[0] or j >= cells.shape[1] or k >= cells.shape[2]:
        return 0
    label = int(cells[i, j, k])
    if label != MIXED:
        return label
    return label_between(labels, margins, int(i), int(j), int(k), x - i, y - j, z - k)


@compiled
def room_at(rooms, x, y, z):  # noqa: ANN001, ANN201
    """How far around a point the label is known to be the same, in cells; 1 where it is not known."""
    if not (x >= 0.0 and y >= 0.0 and z >= 0.0):
        return 1
    i, j, k = np.uint32(x), np.uint32(y), np.uint32(z)
    if i >= rooms.shape[0] or j >= rooms.shape[1] or k >= rooms.shape[2]:
        return 1
    return max(int(rooms[i, j, k]), 1)


@compiled
def incidence_cosine(labels, margins, x, y, z, direction, label):  # noqa: ANN001, ANN201
    """Cosine of the angle between a line and the normal of the boundary of the label that it enters.

    The normal is the first moment, about the point, of what the nodes around it hold of the label.
    """
    gx, gy, gz = 0.0, 0.0, 0.0
    i, j, k = int(x), int(y), int(z)
    for a in range(max(i - 2, 0), min(i + 4, labels.shape[0])):
        for b in range(max(j - 2, 0), min(j + 4, labels.shape[1])):
            for c in range(max(k - 2, 0), min(k + 4, labels.shape[2])):
                u, v, w = a - x, b - y, c - z
                weight = 1.0 - (u * u + v * v + w * w) / 6.25
                if weight > 0.0:
                    held = margins[a, b, c] if labels[a, b, c] == label else -margins[a, b, c]
                    weight *= held
                    gx, gy, gz = gx + weight * u, gy + weight * v, gz + weight * w
    length = math.sqrt(gx * gx + gy * gy + gz * gz)
    if length == 0.0:
        return 1.0
    return abs(gx * direction[0] + gy * direction[1] + gz * direction[2]) / length


@compiled
def directivity(cosine):  # noqa: ANN001, ANN201
    """Share of a boundary's echo that comes back at an angle of incidence of this cosine."""
    angle = math.acos(min(cosine, 1.0)) / SPECULAR_RAD
    return SPECULAR_SHARE * math.exp(-angle * angle) + (1.0 - SPECULAR_SHARE) * cosine


@compiled
def trace_lines(
    cells: NDArray[np.uint8],
    rooms: NDArray[np.uint8],
    labels: NDArray[np.uint8],
    margins: NDArray[np.float32],
    starts: NDArray[np.float64],
    directions: NDArray[np.float64],
    step: float,
    impedances: NDArray[np.float64],
    step_losses: NDArray[np.float64],
    speckle: NDArray[np.float64],
    mirror: float,
    n_coupling: int,
    signal: NDArray[np.float32],
    left: NDArray[np.float32],
    strength: NDArray[np.float32],
) -> None:
    """Follows each line and writes what returns from the boundaries, what is left, and how strong speckle is.

    Args:
        cells: See `LabelGrid`.
        rooms: See `LabelGrid`.
        labels: See `LabelGrid`.
        margins: See `LabelGrid`.
        starts: First sample of each line, in spacings from the first node, shape (L, 3).
        directions: Unit vectors of the lines, shape (L, 3).
        step: Distance of samples, in spacings.
        impedances: Impedance by label [MRayl]; the last is that of gel.
        step_losses: Factor by which amplitude falls over a step, there and back, by label.
        speckle: Amplitude of speckle by label, that of liver being 1.
        mirror: Amplitude of the echo of a perfect mirror at the face.
        n_coupling: Samples of gel that may lie between the face and the organ.
        signal: Output, echoes of boundaries in phase, and nothing in quadrature, shape (S, L, 2).
        left: Output, what is left of the pulse's amplitude on its way back from each sample, shape (S, L).
        strength: Output, amplitude of speckle at each sample, shape (S, L).
    """
    n_samples, n_lines = left.shape
    gel = impedances.shape[0] - 1
    amplitudes = np.ones(n_lines)
    last = np.full(n_lines, gel)
    sure_until = np.zeros(n_lines, dtype=np.int64)
    is_coupled = np.zeros(n_lines, dtype=np.bool_)
    # Sample by sample, so that what is written lies together.
    for sample in range(n_samples):
        for line in range(n_lines):
            amplitude, label, echo = amplitudes[line], last[line], 0.0
            if sample >= sure_until[line]:
                x = starts[line, 0] + sample * step * directions[line, 0]
                y = starts[line, 1] + sample * step * directions[line, 1]
                z = starts[line, 2] + sample * step * directions[line, 2]
                label = label_at(cells, labels, margins, x, y, z)
                if not is_coupled[line]:
                    if label != 0:
                        is_coupled[line] = True
                    else:
                        label = gel
                        if sample >= n_coupling:
                            amplitude = 0.0
                else:
                    sure_until[line] = sample + 1 + int((room_at(rooms, x, y, z) - 1.0) / step)
                if label != last[line]:
                    before = impedances[last[line]]
                    ratio = (impedances[label] - before) / (impedances[label] + before)
                    entered = 0 if label == gel else label
                    cosine = incidence_cosine(labels, margins, x, y, z, directions[line], entered)
                    echo = amplitude * mirror * abs(ratio) * directivity(cosine)
                    # Through the boundary and back through it: (1 - R)(1 - R) of the energy with R = ratio^2.
                    amplitude *= 1.0 - ratio * ratio
                    last[line] = label
            amplitude *= step_losses[label]
            amplitudes[line] = amplitude
            signal[sample, line, 0] = echo
            signal[sample, line, 1] = 0.0
            left[sample, line] = amplitude
            strength[sample, line] = amplitude * speckle[label]
