"""One sensing pose, explained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from sim.world.ik.result import IkResult
from sim.world.ik.search import IkSearch
from sim.world.ik.settings import IkSettings
from sim.world.scene.clearance import FAR_M
from sim.world.scene.clearance_meter import Clearances

from .workcell import Workcell

ON_SURFACE_M = 1e-3
"""A position this close to the organ's surface is said to lie on it."""


@dataclass(frozen=True)
class Explanation:
    """What can be said about a pose."""

    is_reached: bool
    text: str
    """Lines for a terminal."""


def explain_pose(
    workcell: Workcell,
    position_m: ArrayLike,
    normal: ArrayLike,
    *,
    standoff_m: float,
    padding_m: float = 0.0,
) -> Explanation:
    """The answer to a pose, with everything that a person needs to understand it.

    Args:
        workcell: The organ before the arm.
        position_m: Where the probe's tip is to touch, world frame [m], shape (3,).
        normal: Direction of the beam, into the organ, of any length but zero, shape (3,).
        standoff_m: The pose is approached from this far above it [m]; 0 solves for the pose only.
        padding_m: Room that arm and probe keep [m], see `IkSettings.padding_m`.
    """
    settings = IkSettings(standoff_m=standoff_m, padding_m=padding_m)
    position_m, normal = np.asarray(position_m, dtype=np.float64), np.array(normal, dtype=np.float64)
    with threadpool_limits(limits=1):
        return _explain(workcell, position_m, normal, settings)


def _explain(
    workcell: Workcell, position_m: NDArray[np.float64], normal: NDArray[np.float64], settings: IkSettings
) -> Explanation:
    normal = normal / np.linalg.norm(normal)
    search = workcell.make_search(settings)
    answers = search.search(position_m[None], normal[None])
    result = answers.results[0]
    clearances = search.meter.measure(np.stack([result.q, result.q_standoff]))
    lines = [
        *_pose_lines(workcell, position_m, normal),
        f"answer           {'reached' if result.is_reached else 'not reached'}: {result.explain()}",
    ]
    if result.n_iterations == 0:
        # The answer needed no search, so there are no joints to show.
        return Explanation(result.is_reached, "\n".join([*lines, "effort           none, decided at once"]))
    lines.append(f"position error   {result.position_error_m * 1e3:.3f} mm")
    lines.append(f"beam error       {np.rad2deg(result.angle_error_rad):.3f} degrees")
    if result.is_reached:
        lines.append(f"clearance        {_clearance(workcell, clearances, 0)} at the pose")
        if settings.standoff_m > 0:
            lines.append(f"                 {_clearance(workcell, clearances, 1)} at the stand-off")
        lines.append(f"answers          {answers.n_solutions[0]} distinct among the first starts")
    lines.append(f"effort           {result.n_restarts + 1} starts, {result.n_iterations} steps")
    return Explanation(result.is_reached, "\n".join([*lines, "", *_joint_lines(search, result)]))


def _pose_lines(
    workcell: Workcell, position_m: NDArray[np.float64], normal: NDArray[np.float64]
) -> list[str]:
    """The pose itself, and where it lies relative to the organ."""
    x, y, z = position_m * 1e3
    return [
        f"position         {x:.1f} {y:.1f} {z:.1f} mm, {_place(workcell, position_m)}",
        f"beam             {normal[0]:+.3f} {normal[1]:+.3f} {normal[2]:+.3f}",
    ]


def _place(workcell: Workcell, position_m: NDArray[np.float64]) -> str:
    distance_m = float(workcell.organ_distance.distance_m(position_m[None])[0])
    if abs(distance_m) <= ON_SURFACE_M:
        return "on the organ's surface"
    side = "outside" if distance_m > 0 else "inside"
    return f"{abs(distance_m) * 1e3:.0f} mm {side} the organ"


def _clearance(workcell: Workcell, clearances: Clearances, index: int) -> str:
    """The distance between the closest pair, and which pair that is."""
    contact_m, organ_m = float(clearances.contact_m[index]), float(clearances.organ_m[index])
    if min(contact_m, organ_m) >= FAR_M:
        return f"{FAR_M * 1e3:.0f} mm or more"
    name = workcell.clearance.name
    if organ_m < contact_m:
        return f"{organ_m * 1e3:.0f} mm ({name(int(clearances.organ_geom[index]))} to the organ)"
    first, second = (name(int(geom)) for geom in clearances.contact_pair[index])
    return f"{contact_m * 1e3:.0f} mm ({first} to {second})"


def _joint_lines(search: IkSearch, result: IkResult) -> list[str]:
    """A table of the joints: position, room to the nearer limit, position at the stand-off."""
    chain = search.chain
    heads = ("joint", "here", "to its limit", "at the stand-off")
    title = "" if result.is_reached else "the closest answer found:\n"
    lines = [f"{title}{heads[0]:<14}{heads[1]:>16}{heads[2]:>16}{heads[3]:>18}"]
    q, q_standoff = result.q[chain.columns], result.q_standoff[chain.columns]
    room = chain.limit_room(q)
    for i, name in enumerate(chain.names):
        unit, scale = ("mm", 1e3) if chain.is_slide[i] else ("deg", 180.0 / np.pi)
        left = "no limit" if np.isinf(room[i]) else f"{room[i] * scale:.1f} {unit}"
        here, above = f"{q[i] * scale:+.1f} {unit}", f"{q_standoff[i] * scale:+.1f} {unit}"
        lines.append(f"{name:<14}{here:>16}{left:>16}{above:>18}")
    return lines
