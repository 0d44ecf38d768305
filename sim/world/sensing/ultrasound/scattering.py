"""The compiled loop that gathers the echoes of the scatterers about a plane.

The tissue is divided into cubes, each of which holds eight scatterers. A hash of the cube's three numbers and the
scatterer's says where in the cube it lies, so that a place has the same scatterers from wherever it is looked at, and
nothing has to be kept. Where a cell of resolution is large, fewer than eight make speckle, and the first are used. The
scatterers' echoes are added with their phase, 4 pi r / wavelength for the way there and back, which makes the speckle:
Wagner et al., IEEE Trans. Sonics Ultrason. 30 (1983) 156-163.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .compiling import compiled

N_PHASES = 1024
"""Entries of the table of phases; half a step is 0.003 rad."""
N_WEIGHTS = 256
"""Entries of the table of the slice's profile, even in the square of the distance from the plane."""
N_ANGLES = 4096
"""Entries of the table of angles, even in their sine from -1 to 1 and read by interpolation."""
FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
"""What the three numbers of a cube are multiplied by in its hash."""
SHIFTS = np.array([10, 20, 30], dtype=np.uint64)
"""Where in its bits the three shares of a cube stand at which its scatterer lies."""
NEXT = np.uint64(0x9E3779B97F4A7C15)
"""What is added for each further scatterer of a cube: the step of splitmix64."""
BITS = np.uint64(1023)
UNIT = 1.0 / 1024.0
N_PER_CUBE = 8
"""Scatterers in a cube."""


@compiled
def mixed(h):  # noqa: ANN001, ANN201
    """Even bits of 64 bits: the finaliser of splitmix64 (Steele et al., OOPSLA 2014)."""
    h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return h ^ (h >> np.uint64(31))


@compiled
def gather_scatterers(
    T: NDArray[np.float64],
    box: NDArray[np.int64],
    factors: NDArray[np.uint64],
    shifts: NDArray[np.uint64],
    fan: NDArray[np.float64],
    slices: NDArray[np.float64],
    keeps: NDArray[np.float64],
    phases: NDArray[np.float32],
    weights: NDArray[np.float32],
    angles: NDArray[np.float64],
    norms: NDArray[np.float32],
    strength: NDArray[np.float32],
    seed: int,
    signal: NDArray[np.float32],
) -> int:
    """Adds the echo of each scatterer about a plane to the two lines that it lies between.

    The axes of the cubes are in the order in which they are walked; the last should cross the plane most steeply.

    Args:
        T: Maps numbers of cubes to x, y and z of the plane [m], shape (3, 4).
        box: First and last cube to look at along the first and the second axis, shape (2, 2).
        factors: `FACTORS` in the order of the axes, shape (3,).
        shifts: `SHIFTS` in the order of the axes, shape (3,).
        fan: Radius of the face [m], length of a sample [m], angle of a line [rad], half-angle of the face [rad],
            cycles of the phase per metre of depth, shape (5,).
        slices: Half of the thickness of the slice at each sample [m], shape (S,).
        keeps: How many scatterers of a cube are used at each sample, at most `N_PER_CUBE`, shape (S,). The part of one
            is the share of cubes in which one more is used.
        phases: Cosine and sine over one cycle, shape (N_PHASES, 2).
        weights: The slice's profile over the square of the share of its half thickness, shape (N_WEIGHTS,).
        angles: The angles of the sines from -1 to 1 [rad], shape (N_ANGLES + 1,).
        norms: Amplitude of one scatterer of speckle whose mean square is 1, at each sample, shape (S,).
        strength: Amplitude of the speckle, shape (S, L).
        seed: Which tissue of all.
        signal: In-phase and quadrature sums, shape (S, L, 2), added to.

    Returns:
        Number of scatterers that were used.
    """
    # One loop: with a function for each echo it takes twice as long.
    n_samples, n_lines = strength.shape
    radius, sample, line_rad, half_rad, cycles = fan[0], fan[1], fan[2], fan[3], fan[4]
    far = radius + n_samples * sample
    steepness = T[1, 2]
    least_cosine = math.cos(half_rad)
    n_used = 0
    for p in range(box[0, 0], box[0, 1] + 1):
        for q in range(box[1, 0], box[1, 1] + 1):
            x0 = T[0, 3] + T[0, 0] * p + T[0, 1] * q
            y0 = T[1, 3] + T[1, 0] * p + T[1, 1] * q
            z0 = T[2, 3] + T[2, 0] * p + T[2, 1] * q + radius
            # Where the middle of the row of cubes meets the plane.
            r0 = -(y0 + 0.5 * (T[1, 0] + T[1, 1])) / steepness
            x = x0 + 0.5 * (T[0, 0] + T[0, 1]) + T[0, 2] * r0
            z = z0 + 0.5 * (T[2, 0] + T[2, 1]) + T[2, 2] * r0
            rho = math.sqrt(x * x + z * z)
            middle = min(max(int((rho - radius) / sample), 0), n_samples - 1)
            half = slices[middle]
            if rho < radius - half or rho > far + half or z < rho * least_cosine - half:
                continue
            per_half, reach = 1.0 / half, half / abs(steepness) + 1.0
            n_sure = int(keeps[middle])
            n_more = np.uint64((keeps[middle] - n_sure) * 1024.0)
            row = np.uint64(p) * factors[0] ^ np.uint64(q) * factors[1]
            for r in range(math.floor(r0 - reach), math.ceil(r0 + reach)):
                state = (row ^ np.uint64(r) * factors[2]) + np.uint64(seed)
                for number in range(n_sure + 1):
                    h = mixed(state)
                    state += NEXT
                    if number == n_sure and (h & BITS) >= n_more:
                        continue
                    a = np.int64((h >> shifts[0]) & BITS) * UNIT
                    b = np.int64((h >> shifts[1]) & BITS) * UNIT
                    c = r + np.int64((h >> shifts[2]) & BITS) * UNIT
                    y = (y0 + T[1, 0] * a + T[1, 1] * b + T[1, 2] * c) * per_half
                    share = y * y
                    if share >= 1.0:
                        continue
                    x = x0 + T[0, 0] * a + T[0, 1] * b + T[0, 2] * c
                    z = z0 + T[2, 0] * a + T[2, 1] * b + T[2, 2] * c
                    rho = math.sqrt(x * x + z * z)
                    depth = rho - radius
                    s = int(depth / sample)
                    if depth < 0.0 or s >= n_samples or z <= 0.0:
                        continue
                    place = (x / rho + 1.0) * (0.5 * N_ANGLES)
                    at = int(place)
                    angle = angles[at] + (place - at) * (angles[at + 1] - angles[at])
                    beside = (angle + half_rad) / line_rad
                    if beside < 0.0 or beside >= n_lines - 1:
                        continue
                    line = int(beside)
                    part = np.float32(beside - line)
                    amplitude = norms[s] * strength[s, int(beside + 0.5)] * weights[int(share * N_WEIGHTS)]
                    turn = depth * cycles
                    phase = int((turn - math.floor(turn)) * N_PHASES) & (N_PHASES - 1)
                    in_phase, quadrature = amplitude * phases[phase, 0], amplitude * phases[phase, 1]
                    rest = np.float32(1.0) - part
                    signal[s, line, 0] += rest * in_phase
                    signal[s, line, 1] += rest * quadrature
                    signal[s, line + 1, 0] += part * in_phase
                    signal[s, line + 1, 1] += part * quadrature
                    n_used += 1
    return n_used


def scatterers_in(
    first: NDArray[np.int64], last: NDArray[np.int64], *, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The scatterers that `gather_scatterers` finds in a box of cubes, written down for others to use.

    Args:
        first: First cube of the box, shape (3,).
        last: Last cube of it, shape (3,).
        seed: Which tissue of all.

    Returns:
        Their places in numbers of cubes, shape (N, N_PER_CUBE, 3), and what decides whether the last of the used ones
        of a cube is used: whether it is below 1024 times the part of one in `keeps`, shape (N, N_PER_CUBE).
    """
    axes = [np.arange(a, b + 1, dtype=np.int64) for a, b in zip(first, last, strict=True)]
    cubes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    product = cubes.astype(np.uint64) * FACTORS
    states = (product[:, 0] ^ product[:, 1] ^ product[:, 2]) + np.uint64(seed)
    h = mixed(states[:, None] + NEXT * np.arange(N_PER_CUBE, dtype=np.uint64))
    places = cubes[:, None] + ((h[..., None] >> SHIFTS) & BITS).astype(np.float64) * UNIT
    return places, (h & BITS).astype(np.int64)
