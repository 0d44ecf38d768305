"""The compiled loop that follows the lines of a plane through the tissue."""

# numba compiles these functions, which take many arrays and no objects.
# ruff: noqa: PLR0913

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
def label_at(cells, labels, margins, x, y, z):  # noqa: ANN001, ANN201
    """The label at a point given in spacings from the first node; 0 beyond the grid."""
    if not (x >= 0.0 and y >= 0.0 and z >= 0.0):
        return 0
    i, j, k = int(x), int(y), int(z)
    if i >= cells.shape[0] or j >= cells.shape[1] or k >= cells.shape[2]:
        return 0
    label = int(cells[i, j, k])
    if label != MIXED:
        return label
    u, v, w = x - i, y - j, z - k
    best, best_sum = 0, -1.0
    for corner in range(8):
        a, b, c = corner & 1, (corner >> 1) & 1, corner >> 2
        candidate = labels[i + a, j + b, k + c]
        total = 0.0
        for other in range(8):
            d, e, f = other & 1, (other >> 1) & 1, other >> 2
            if labels[i + d, j + e, k + f] == candidate:
                weight = (u if d else 1.0 - u) * (v if e else 1.0 - v) * (w if f else 1.0 - w)
                total += weight * margins[i + d, j + e, k + f]
        if total > best_sum:
            best, best_sum = int(candidate), total
    return best


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
def trace_lines(
    cells: NDArray[np.uint8],
    labels: NDArray[np.uint8],
    margins: NDArray[np.float32],
    starts: NDArray[np.float64],
    directions: NDArray[np.float64],
    step: float,
    impedances: NDArray[np.float64],
    step_losses: NDArray[np.float64],
    n_coupling: int,
    reflectances: NDArray[np.float32],
    left: NDArray[np.float32],
    found: NDArray[np.uint8],
) -> None:
    """Follows each line and writes what returns from the boundaries, what is left of it, and what it runs through.

    Args:
        cells: See `LabelGrid`.
        labels: See `LabelGrid`.
        margins: See `LabelGrid`.
        starts: First sample of each line, in spacings from the first node, shape (L, 3).
        directions: Unit vectors of the lines, shape (L, 3).
        step: Distance of samples, in spacings.
        impedances: Impedance by label [MRayl]; the last is that of gel.
        step_losses: Factor by which amplitude falls over a step, there and back, by label.
        n_coupling: Samples of gel that may lie between the face and the organ.
        reflectances: Output, amplitude of the echoes of boundaries against that of a perfect mirror, shape (L, S).
        left: Output, amplitude of what comes back from a perfect mirror at each sample, shape (L, S).
        found: Output, label of each sample; that of gel before the organ, shape (L, S).
    """
    n_lines, n_samples = left.shape
    gel = impedances.shape[0] - 1
    for line in range(n_lines):
        x, y, z = starts[line, 0], starts[line, 1], starts[line, 2]
        dx, dy, dz = step * directions[line, 0], step * directions[line, 1], step * directions[line, 2]
        amplitude, last, is_coupled = 1.0, gel, False
        for sample in range(n_samples):
            label = label_at(cells, labels, margins, x, y, z)
            if not is_coupled:
                if label != 0:
                    is_coupled = True
                else:
                    label = gel
                    if sample >= n_coupling:
                        amplitude = 0.0
            echo = 0.0
            if label != last and amplitude > 0.0:
                ratio = (impedances[label] - impedances[last]) / (impedances[label] + impedances[last])
                cosine = incidence_cosine(labels, margins, x, y, z, directions[line], 0 if label == gel else label)
                angle = math.acos(min(cosine, 1.0)) / SPECULAR_RAD
                echo = amplitude * abs(ratio) * (
                    SPECULAR_SHARE * math.exp(-angle * angle) + (1.0 - SPECULAR_SHARE) * cosine
                )
                # Through the boundary and back through it: (1 - R)(1 - R) of the energy with R = ratio^2.
                amplitude *= 1.0 - ratio * ratio
                last = label
            amplitude *= step_losses[label]
            reflectances[line, sample] = echo
            left[line, sample] = amplitude
            found[line, sample] = label
            x, y, z = x + dx, y + dy, z + dz
