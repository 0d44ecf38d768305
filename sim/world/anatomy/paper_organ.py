"""The paper's synthetic organ (Cho, Hermans, Kuntz, 2021, section V-A), pinned down.

The paper takes its surface from Matplotlib's `get_test_data` and states 14,400 positions, 2,890 hinges and
6,292 query points. `get_test_data(0.05)` gives exactly 120 x 120 positions with x and y in [-3, 3); 17 x 17 x
10 hinges at 0.375 and 22 x 22 x 13 query points fit a box of 6 x 6 x 3.4. So here, in the paper's units of
0.03 m:

- the surface is z = Z2 - Z1 over x, y in [-3, 3], unscaled: from -0.15 to 0.17;
- the solid below it ends at z = -3.3;
- the 14,400 positions are the nodes with x, y < 3, as `get_test_data` gives them;
- the search box is x, y in [-3, 3], z in [-3.3, 0.2]. Its hinges at 0.375 are 17 x 17 x 10, the highest at
  z = 0.075, which the kernel's width of 0.32 carries past the surface.

The solid has one more row of nodes, at x = 3 and y = 3, so that it fills the box. Frame: z up, origin in the
middle of the surface's mean plane.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sim.world.solids.solid import Solid

from .surface import SensingSurface, fit_normals

UNIT_M = 0.03
"""The paper's length unit [m]: its 6 x 6 box is then 180 x 180 mm, the size of a liver."""

GRID_SPACING = 0.05
"""Spacing of the surface's nodes in the paper's units."""

N_GRID = 120
"""Positions along x and along y."""

BOX_LOW_M = UNIT_M * np.array([-3.0, -3.0, -3.3])
"""Lowest corner of the search box [m]; its z is the organ's flat bottom."""

BOX_HIGH_M = UNIT_M * np.array([3.0, 3.0, 0.2])
"""Highest corner of the search box [m]."""


@dataclass(frozen=True, eq=False)
class PaperOrgan:
    """The synthetic organ in its own frame.

    Attributes:
        solid: The organ.
        surface: Its 14,400 sensing positions on a 120 x 120 grid (rows along y, columns along x), and
            normals.
        box_low_m: Lowest corner of the search box [m], shape (3,).
        box_high_m: Highest corner of the search box [m], shape (3,).
    """

    solid: Solid
    surface: SensingSurface
    box_low_m: NDArray[np.float64]
    box_high_m: NDArray[np.float64]


@lru_cache(maxsize=1)
def paper_organ() -> PaperOrgan:
    """The paper's synthetic organ, 180 x 180 x 104 mm, and its sensing positions."""
    axis = -3.0 + GRID_SPACING * np.arange(N_GRID + 1, dtype=np.float64)
    x, y = np.meshgrid(axis, axis)
    nodes_m = UNIT_M * np.stack([x, y, surface_height(x, y)], axis=-1)
    positions_m = nodes_m[:N_GRID, :N_GRID].reshape(-1, 3)
    downward = np.broadcast_to([0.0, 0.0, -1.0], positions_m.shape)
    surface = SensingSurface(positions_m, fit_normals(positions_m, downward), (N_GRID, N_GRID))
    return PaperOrgan(solid_below(nodes_m, float(BOX_LOW_M[2])), surface, BOX_LOW_M.copy(), BOX_HIGH_M.copy())


def surface_height(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Height of the surface at x and y, all in the paper's units.

    The difference of two Gaussian bells that Matplotlib calls its test data, without its scaling by 500:
    exp(-(((x-1)/1.5)^2 + ((y-1)/0.5)^2) / 2) / (2 pi 1.5 0.5) - exp(-(x^2 + y^2) / 2) / (2 pi).
    """
    narrow = np.exp(-(((x - 1.0) / 1.5) ** 2 + ((y - 1.0) / 0.5) ** 2) / 2.0) / (2.0 * np.pi * 0.5 * 1.5)
    round_ = np.exp(-(x**2 + y**2) / 2.0) / (2.0 * np.pi)
    return narrow - round_


def solid_below(nodes_m: NDArray[np.float64], bottom_m: float) -> Solid:
    """The closed solid between a height field and a flat bottom.

    Args:
        nodes_m: Nodes of the top [m], shape (rows, columns, 3): x grows along a row, y from row to row.
        bottom_m: Height z of the bottom [m], below all nodes.

    Returns:
        The solid: its bottom is two triangles, and its walls are fans, so that only the top has many.
    """
    n_rows, n_columns = nodes_m.shape[:2]
    index = np.arange(n_rows * n_columns).reshape(n_rows, n_columns)
    a, b, c, d = (q.ravel() for q in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    top = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    vertices_m = np.concatenate([nodes_m.reshape(-1, 3), nodes_m[[0, 0, -1, -1], [0, -1, -1, 0]]])
    corners = index.size + np.arange(4)
    vertices_m[corners, 2] = bottom_m
    # Counter-clockwise seen from above.
    sides = [index[0], index[:, -1], index[-1, ::-1], index[::-1, 0]]
    walls = [_wall(side, corners[i], corners[(i + 1) % 4]) for i, side in enumerate(sides)]
    floor = corners[[[0, 2, 1], [0, 3, 2]]]
    return Solid(vertices_m, np.concatenate([top, *walls, floor]))


def _wall(side: NDArray[np.int64], first: np.int64, last: np.int64) -> NDArray[np.int64]:
    """Triangles of a wall below a side's nodes: two fans about the bottom's corners, and one between."""
    half = len(side) // 2
    foot = np.where(np.arange(len(side) - 1) < half, first, last)
    fans = np.stack([side[:-1], foot, side[1:]], axis=1)
    return np.concatenate([fans, [[side[half], first, last]]])
