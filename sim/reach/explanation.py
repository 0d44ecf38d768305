"""The program behind `sounding ik`: one sensing pose, explained."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from sim.cli.arm_options import METRES_MM, IkOptions
from sim.episode.scenario import load_scenario
from sim.world.ik.result import IkResult
from sim.world.ik.search import IkSearch
from sim.world.ik.settings import IkSettings
from sim.world.scene.arm import ArmModel
from sim.world.scene.clearance import FAR_M
from sim.world.scene.clearance_meter import Clearances
from sim.world.scene.named_arms import named_arm

from .workcell import Workcell, build_workcell

ON_SURFACE_M = 1e-3
"""A position this close to the organ's surface is said to lie on it."""


@dataclass(frozen=True)
class Explanation:
    """What there is to say about a pose."""

    is_reached: bool
    text: str
    """Lines for a terminal."""


def explain_pose(options: IkOptions) -> Explanation:
    """Solve a pose and say everything that a person needs to understand the answer.

    Raises:
        UsageError, WorldError: Something asked for cannot be done.
    """
    with threadpool_limits(limits=1):
        workcell = build_workcell(load_scenario(options.scenario), _arm(options))
        return explain_in(workcell, options)


def _arm(options: IkOptions) -> ArmModel:
    x_mm, y_mm, z_mm = options.base_mm
    base_m, yaw_rad = (x_mm * 1e-3, y_mm * 1e-3, z_mm * 1e-3), math.radians(options.base_yaw_deg)
    return named_arm(options.arm, options.flange, base_m=base_m, base_yaw_rad=yaw_rad)


def explain_in(workcell: Workcell, options: IkOptions) -> Explanation:
    """As `explain_pose`, in a workcell that stands already: scenario and arm of the options are not looked at."""
    position_m = np.array(options.position_mm) * 1e-3
    normal = np.array(options.normal, dtype=np.float64)
    normal /= np.linalg.norm(normal)
    search = workcell.make_search(IkSettings(standoff_m=options.standoff_mm * 1e-3))
    answers = search.search(position_m[None], normal[None])
    result = answers.results[0]
    clearances = search.meter.measure(np.stack([result.q, result.q_standoff]))
    lines = [
        *_pose_lines(options, workcell, position_m, normal),
        f"answer           {'reached' if result.is_reached else 'not reached'}: {result.explain()}",
    ]
    if result.n_iterations == 0:  # decided without a search: no joints are worth showing
        return Explanation(result.is_reached, "\n".join([*lines, "effort           none, decided at once"]))
    lines.append(f"position error   {result.position_error_m * 1e3:.3f} mm")
    lines.append(f"beam error       {np.rad2deg(result.angle_error_rad):.3f} degrees")
    if result.is_reached:
        lines.append(f"clearance        {_clearance(workcell, clearances, 0)} at the pose")
        if options.standoff_mm > 0:
            lines.append(f"                 {_clearance(workcell, clearances, 1)} at the stand-off")
        lines.append(f"answers          {answers.n_solutions[0]} distinct among the first starts")
    lines.append(f"effort           {result.n_restarts + 1} starts, {result.n_iterations} steps")
    return Explanation(result.is_reached, "\n".join([*lines, "", *_joint_lines(search, result)]))


def _pose_lines(
    options: IkOptions, workcell: Workcell, position_m: NDArray[np.float64], normal: NDArray[np.float64]
) -> list[str]:
    """The pose itself, and where it lies relative to the organ."""
    x, y, z = options.position_mm
    lines = [
        f"position         {x:.1f} {y:.1f} {z:.1f} mm, {_place(workcell, position_m)}",
        f"beam             {normal[0]:+.3f} {normal[1]:+.3f} {normal[2]:+.3f}",
    ]
    if 0.0 < max(abs(value) for value in options.position_mm) < METRES_MM:
        lines.append("note             the position is in millimetres; was it given in metres?")
    return lines


def _place(workcell: Workcell, position_m: NDArray[np.float64]) -> str:
    distance_m = float(workcell.organ_distance.distance_m(position_m[None])[0])
    if abs(distance_m) <= ON_SURFACE_M:
        return "on the organ's surface"
    side = "outside" if distance_m > 0 else "inside"
    return f"{abs(distance_m) * 1e3:.0f} mm {side} the organ"


def _clearance(workcell: Workcell, clearances: Clearances, index: int) -> str:
    """How far the closest pair is apart, and which it is."""
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
