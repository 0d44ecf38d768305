"""The coarse grid of a search for a base: places around the organ from which the arm could reach most of the poses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from planner import Workspace
from sim.world.ik.search import IkSearch
from sim.world.scene.arm import base_frame
from sim.world.scene.base_room import BaseRoom

N_HEIGHTS = 3
"""Heights of the grid, where the range leaves room for them."""
PLACES_PER_HEIGHT = 25
"""With fewer places than this for each of them, the grid has fewer heights."""
MIN_HEIGHT_STEP_M = 0.01
"""A range of heights that is narrower than this is one height."""
SURVEY_SPACING_M = 0.06
"""Spacing of the places that are counted to choose the grid's own spacing [m]."""
POSSIBLE_SHARE = 0.7
"""A place counts where the stretched arm is long enough for at least this share of the poses of the best place."""
MIN_HEADING_M = 0.05
"""An arm whose tip at home is nearer to the base's axis than this [m] looks in no direction."""


class Stand(NamedTuple):
    """Where an upright base stands."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float

    @classmethod
    def of_frame(cls, T_world_base: NDArray[np.float64]) -> Stand:
        """The stand of a base's frame, shape (4, 4)."""
        x_m, y_m, z_m = T_world_base[:3, 3].tolist()
        return cls(x_m, y_m, z_m, float(np.arctan2(T_world_base[1, 0], T_world_base[0, 0])))

    @property
    def T_world_base(self) -> NDArray[np.float64]:
        """The base's frame, shape (4, 4)."""
        return base_frame((self.x_m, self.y_m, self.z_m), self.yaw_rad)

    def rounded(self) -> Stand:
        """The stand to 0.1 mm and 0.1 degrees, so that what is printed is what was tried; yaw within half a turn."""
        yaw_deg = round(float(np.rad2deg(self.yaw_rad)), 1)
        x_m, y_m, z_m = (round(float(value), 4) for value in self[:3])
        return Stand(x_m, y_m, z_m, float(np.deg2rad((yaw_deg + 180.0) % 360.0 - 180.0)))

    def in_millimetres(self) -> dict[str, Any]:
        """The place of the base in the units of an arm's options: `base_mm` [mm] and `base_yaw_deg` [degrees]."""
        place_mm = [round(value * 1e3, 1) + 0.0 for value in self[:3]]
        return {"base_mm": place_mm, "base_yaw_deg": round(float(np.rad2deg(self.yaw_rad)), 1) + 0.0}

    @classmethod
    def from_millimetres(cls, place: Mapping[str, Any]) -> Stand:
        """The stand that `in_millimetres` describes."""
        x_m, y_m, z_m = (value * 1e-3 for value in place["base_mm"])
        return cls(x_m, y_m, z_m, float(np.deg2rad(place["base_yaw_deg"])))

    @property
    def label(self) -> str:
        """The place in words."""
        x_mm, y_mm, z_mm = (f"{value:g}" for value in self.in_millimetres()["base_mm"])
        return f"base at {x_mm}, {y_mm}, {z_mm} mm, yaw {self.in_millimetres()['base_yaw_deg']:g} degrees"


@dataclass(frozen=True, eq=False)
class BaseGrid:
    """Places on a square grid in a few heights, each turned so that the arm at home looks at the organ."""

    stands: list[Stand]
    """Places from which the arm could reach much."""
    blocked: list[tuple[Stand, str]]
    """Further such places, for which table or organ leave no room, and what is in the way."""
    spacing_m: float
    """Distance between neighbouring places of one height."""
    height_step_m: float
    """Distance between neighbouring heights; the whole range where the grid has one height."""


def base_grid(
    search: IkSearch, poses: Workspace, base_room: BaseRoom, height_m: tuple[float, float], *, n_wanted: int
) -> BaseGrid:
    """The grid around an organ whose spacing gives about `n_wanted` places.

    Args:
        search: Solves for the arm.
        poses: The poses that the arm is to reach.
        base_room: Tells where there is room for the base.
        height_m: Lowest and highest base [m, world].
        n_wanted: Places to try.
    """
    low_m, high_m = height_m
    n_heights = 1
    if high_m - low_m >= MIN_HEIGHT_STEP_M:
        n_heights = int(np.clip(n_wanted // PLACES_PER_HEIGHT, 1, N_HEIGHTS))
    heights_m = np.linspace(low_m, high_m, n_heights)
    at_origin = search.at_base(np.eye(4))
    area_m2 = len(_places(at_origin, poses, SURVEY_SPACING_M, heights_m)) * SURVEY_SPACING_M**2
    spacing_m = float(np.sqrt(area_m2 / n_wanted))
    stands, blocked = [], []
    for stand in _places(at_origin, poses, spacing_m, heights_m):
        obstacle = base_room.obstacle(stand.T_world_base)
        if obstacle is None:
            stands.append(stand)
        else:
            blocked.append((stand, obstacle))
    step_m = (high_m - low_m) / (n_heights - 1) if n_heights > 1 else high_m - low_m
    return BaseGrid(stands, blocked, spacing_m, step_m)


def _places(
    at_origin: IkSearch, poses: Workspace, spacing_m: float, heights_m: NDArray[np.float64]
) -> list[Stand]:
    """The places of a grid around the poses from which the arm could reach enough of them."""
    centre_m, heading_rad = poses.positions_m.mean(axis=0), _home_heading_rad(at_origin)
    radius_m = at_origin.chain.hub_reach()[1] + abs(at_origin.chain.axis_hub()[0])
    n = int(radius_m / spacing_m)
    ticks_m = spacing_m * np.arange(-n, n + 1)
    x_m, y_m, z_m = np.meshgrid(centre_m[0] + ticks_m, centre_m[1] + ticks_m, heights_m, indexing="ij")
    stands, shares = [], []
    for place in np.column_stack([x_m.ravel(), y_m.ravel(), z_m.ravel()]):
        towards = centre_m[:2] - place[:2]
        yaw_rad = float(np.arctan2(towards[1], towards[0])) - heading_rad if towards.any() else 0.0
        stand = Stand(float(place[0]), float(place[1]), float(place[2]), yaw_rad).rounded()
        T = stand.T_world_base
        seen_m, beams = (poses.positions_m - T[:3, 3]) @ T[:3, :3], poses.normals @ T[:3, :3]
        shares.append(float(np.mean(at_origin.too_far_m(seen_m, beams) <= 0.0)))
        stands.append(stand)
    least = POSSIBLE_SHARE * max(max(shares), 1e-9)
    return [stand for stand, share in zip(stands, shares, strict=True) if share >= least]


def _home_heading_rad(at_origin: IkSearch) -> float:
    """The direction in which the tip is from the base's axis at home [rad], 0 where it is above the base."""
    chain = at_origin.chain
    x_m, y_m, _ = chain.forward(chain.home[None]).tips_m[0].tolist()
    return float(np.arctan2(y_m, x_m)) if np.hypot(x_m, y_m) > MIN_HEADING_M else 0.0
