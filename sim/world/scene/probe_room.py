"""Probe room: whether the probe has room at the flange, and where the flange looks.

MuJoCo reports no contacts between the probe and what it counts as its neighbours: the body that carries it, what hangs
from that body, and the link before. So these are looked at once, when a scene is built, by their true shapes:

- what moves with the flange (a palm, fingers): its place beside the probe is the same in every configuration, since
  joints beside the chain stay at home;
- the link before, in configurations of the joints between. One that the probe meets in some of them gets contacts with
  the probe, as all other links have; one that it meets in all of them leaves no room.

A probe has to be mounted somewhere: within `MOUNT_M` of the flange it may stand in the link that carries it, and in the
link before, but not in what has joints of its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.arms.body_tree import bodies_above, joints_above

from .overlap import FAR_M, depth_of_points_m, overlap_m
from .probe_surface import MOUNT_M, in_body_m, is_lathed, strewn_points, without_mount

MOUNT = "mount"
"""The body that carries the arm's base, and whose pose in the world is where the arm stands."""
PROBE = "probe_probe"
"""The probe's body, which hangs from the world where no arm carries it."""
BODY = int(mujoco.mjtObj.mjOBJ_BODY)
LEAST_OVERLAP_M = 5e-4
"""Less than this is a matter of how shapes were rounded [m]."""
N_CONFIGURATIONS = 64
"""Configurations of the joints between the link before and the flange, besides home."""
APART_M = 0.01
"""A joint nearer to the flange than this gives it no direction [m]."""
ACROSS_COSINE, BACK_COSINE = 0.5, -0.5
"""A flange lies across where its +z is 60 to 120 degrees off the direction in which the arm leads to it, and looks back
beyond that."""
ALONG_AXIS_COSINE = np.cos(np.deg2rad(30.0))
"""A last joint that turns about the beam, to this angle, leaves no doubt about a flange that lies across the arm."""


@dataclass(frozen=True)
class Obstacle:
    """What the probe stands in."""

    name: str
    """Of the geom, or of its body where it has none, as in the arm's file."""
    depth_m: float
    """How deep, at home."""
    moves_along: bool
    """Whether it moves with the flange; it is the link before where not."""

    def __str__(self) -> str:
        """The obstacle as a sentence without its full stop."""
        depth = f"by {self.depth_m * 1e3:.0f} mm"
        if self.moves_along:
            return (
                f"the probe overlaps {self.name}, which moves with the flange, {depth} in every configuration"
            )
        return f"the probe overlaps {self.name} {depth}, and still does however the joints between them turn"


@dataclass(frozen=True, eq=False)
class Meeting:
    """In which configurations two geoms overlap, home first."""

    whole: NDArray[np.bool_]
    """With all of the probe's geom, shape (1 + N_CONFIGURATIONS,)."""
    beyond: NDArray[np.bool_]
    """With what of it lies beyond the mount, likewise."""


class ProbeRoom:
    """The neighbours of a scene's probe."""

    def __init__(self, model: mujoco.MjModel, home_q: NDArray[np.float64], tip_site: str) -> None:
        """Find the neighbours in a compiled scene whose arm has the home `home_q`."""
        self._model, self._tip = model, model.site(tip_site).id
        self._data = mujoco.MjData(model)
        self._home_q = home_q
        probe = int(model.site_bodyid[self._tip])
        self._chain = joints_above(model, probe)
        self._carrier = int(model.body_weldid[probe])
        self._body = probe
        before = int(model.body_weldid[model.body_parentid[self._carrier]])
        arm = colliding_geoms(model)
        self._probe = [geom for geom in arm if model.geom_bodyid[geom] == probe]
        # A user's probe may have any shape; where it is not one that the mount can be cut off, points stand for it.
        self._points_m = {
            geom: strewn_points(model, geom) for geom in self._probe if not is_lathed(model, geom)
        }
        self._points_beyond_m = {
            geom: each[in_body_m(model, geom, each)[:, 2] >= MOUNT_M] for geom, each in self._points_m.items()
        }
        self._others_m: dict[int, NDArray[np.float64]] = {}
        # The part of the probe beyond its mount, which no link may hold.
        self._beyond = without_mount(model, [geom for geom in self._probe if geom not in self._points_m])
        welds = {
            geom: int(model.body_weldid[model.geom_bodyid[geom]]) for geom in arm if geom not in self._probe
        }
        self._carrying = [geom for geom, weld in welds.items() if weld == self._carrier]
        self._before = [geom for geom, weld in welds.items() if weld == before]
        self._beside = [
            geom for geom, weld in welds.items() if weld != self._carrier and self._moves_along(weld)
        ]

    def obstacle(self) -> Obstacle | None:
        """What leaves the probe no room in any configuration: the one that it stands in deepest, or None."""
        always_before = self._always_before()
        self._set(self._home_q)
        found = [
            Obstacle(self._name(geom), self._depth_m(self._model, self._probe, geom), moves_along)
            for geoms, model, moves_along in (
                (self._beside, self._model, True),
                (self._carrying, self._beyond, True),
                (always_before, self._beyond, False),
            )
            for geom in geoms
            if self._depth_m(model, self._probe, geom) > LEAST_OVERLAP_M
        ]
        return max(found, key=lambda each: each.depth_m, default=None)

    def contacts(self) -> list[tuple[int, int]]:
        """Pairs of a geom of the probe and one of the link before that meet in some configurations and not in all."""
        return [
            pair
            for pair, meeting in self._meetings.items()
            if meeting.beyond.any() and not meeting.whole.all()
        ]

    def direction(self) -> str | None:
        """Where a flange looks that does not look away from the arm, as a phrase, or None.

        The arm leads to the flange from the last hinge that lies apart from it; joints after that one are taken in the
        middle of their ranges.
        """
        model, data = self._model, self._data
        hinges = [joint for joint in self._chain if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE]
        self._set(self._home_q)
        flange_m, apart = self._flange_m(), None
        q = self._home_q.copy()
        for joint in reversed(hinges):
            if np.linalg.norm(flange_m - data.xanchor[joint]) > APART_M:
                apart = joint
                break
            if model.jnt_limited[joint]:
                q[model.jnt_qposadr[joint]] = model.jnt_range[joint].mean()
        if apart is None:
            return None
        self._set(q)
        # The probe's body stands as the flange does; its tip may look elsewhere.
        way_m, outward = self._flange_m() - data.xanchor[apart], data.xmat[self._body].reshape(3, 3)[:, 2]
        cosine = float(way_m @ outward / max(float(np.linalg.norm(way_m)), APART_M))
        is_along_axis = abs(float(data.xaxis[hinges[-1]] @ outward)) > ALONG_AXIS_COSINE
        if cosine >= ACROSS_COSINE or (cosine > BACK_COSINE and is_along_axis):
            return None
        looks = "looks back into the arm" if cosine <= BACK_COSINE else "lies across the arm"
        angle_deg = np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0)))
        return (
            f"the flange's +z {looks}, {angle_deg:.0f} degrees off the direction in which the arm leads to it"
        )

    def _moves_along(self, body: int) -> bool:
        """Whether all joints of the chain move a body, so that it stays where it is beside the probe."""
        return joints_above(self._model, body)[: len(self._chain)] == self._chain

    def _always_before(self) -> list[int]:
        """Geoms of the link before in which the probe beyond its mount stands in every configuration."""
        return [
            geom
            for geom in self._before
            if np.any([self._meetings[probe, geom].beyond for probe in self._probe], axis=0).all()
        ]

    @cached_property
    def _meetings(self) -> dict[tuple[int, int], Meeting]:
        """When each geom of the probe meets each one of the link before."""
        meetings = {}
        for probe, geom in product(self._probe, self._before):
            whole, beyond = np.zeros((2, 1 + N_CONFIGURATIONS), dtype=bool)
            for row, q in enumerate(self._configurations()):
                self._set(q)
                whole[row] = self._depth_m(self._model, [probe], geom) > LEAST_OVERLAP_M
                beyond[row] = whole[row] and self._depth_m(self._beyond, [probe], geom) > LEAST_OVERLAP_M
            meetings[probe, geom] = Meeting(whole, beyond)
        self._set(self._home_q)
        return meetings

    def _configurations(self) -> NDArray[np.float64]:
        """Home, and configurations that differ from it in the joints of the link that carries the probe."""
        model, rng = self._model, np.random.default_rng(0)
        q = np.tile(self._home_q, (1 + N_CONFIGURATIONS, 1))
        first = int(model.body_jntadr[self._carrier])
        for joint in range(first, first + int(model.body_jntnum[self._carrier])):
            column = int(model.jnt_qposadr[joint])
            low, high = model.jnt_range[joint] if model.jnt_limited[joint] else q[0, column] + (-np.pi, np.pi)
            q[1:, column] = rng.uniform(low, high, N_CONFIGURATIONS)
        return q

    def _depth_m(self, model: mujoco.MjModel, probe: list[int], geom: int) -> float:
        """How deep the present configuration has the probe in a geom [m]; its mount is left out with that model."""
        mujoco.mj_kinematics(model, self._data)
        return max(
            (
                self._strewn_depth_m(each, geom, is_beyond=model is self._beyond)
                if each in self._points_m
                else overlap_m(model, self._data, each, geom)
                for each in probe
                if each in self._points_m or model.geom_size[each, 0] > 0.0
            ),
            default=0.0,
        )

    def _strewn_depth_m(self, probe: int, geom: int, *, is_beyond: bool) -> float:
        """How deep a geom of the probe and another one stand in each other [m], by the points that stand for both."""
        model, data = self._model, self._data
        if mujoco.mj_geomDistance(model, data, probe, geom, FAR_M, None) >= 0.0:
            return 0.0
        points_m = self._points_beyond_m if is_beyond else self._points_m
        if geom not in self._others_m:
            self._others_m[geom] = strewn_points(model, geom)
        others_m = self._others_m[geom]
        if is_beyond:
            world_m = data.geom_xpos[geom] + others_m @ data.geom_xmat[geom].reshape(3, 3).T
            in_flange_m = (world_m - data.xpos[self._body]) @ data.xmat[self._body].reshape(3, 3)
            others_m = others_m[in_flange_m[:, 2] >= MOUNT_M]
        return max(
            depth_of_points_m(model, data, probe, points_m[probe], geom),
            depth_of_points_m(model, data, geom, others_m, probe),
        )

    def _flange_m(self) -> NDArray[np.float64]:
        return self._data.xpos[self._model.site_bodyid[self._tip]].copy()

    def _set(self, q: NDArray[np.float64]) -> None:
        self._data.qpos[:] = q
        mujoco.mj_kinematics(self._model, self._data)

    def _name(self, geom: int) -> str:
        name = self._model.geom(geom).name or self._model.body(self._model.geom_bodyid[geom]).name
        return name.removeprefix("arm_")


def colliding_geoms(model: mujoco.MjModel) -> list[int]:
    """Ids of the geoms of arm and probe that take part in collisions; a plane or a height field has no end and is none.

    A probe that no arm carries hangs from the world.
    """
    endless = (int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD))
    tops = [body for name in (MOUNT, PROBE) if (body := mujoco.mj_name2id(model, BODY, name)) >= 0]
    return [
        geom
        for geom in range(model.ngeom)
        if (model.geom_contype[geom] or model.geom_conaffinity[geom])
        and int(model.geom_type[geom]) not in endless
        and not set(tops).isdisjoint(bodies_above(model, int(model.geom_bodyid[geom])))
    ]
