"""What every sensor is, and what it may look at."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from planner import Cone
from sim.world.scene.scene import Scene

from .rays import SurfaceRays
from .reading import Reading


class PointLabels(NamedTuple):
    """What lies at points, without error."""

    is_in_organ: NDArray[np.bool_]
    """Whether each point lies in the organ, shape (N,)."""
    is_tumour: NDArray[np.bool_]
    """Whether each point lies in the organ and a tumour, shape (N,)."""
    is_target: NDArray[np.bool_] | None
    """Whether each point lies in the organ and a body of the second class, shape (N,); None without such a class."""


@dataclass(frozen=True, eq=False)
class SceneState:
    """What a sensor may look at: the scene as it stands when the sensor is called.

    One is made per episode and serves it to the end: the episode moves `data` on, and all that is read here follows.
    """

    scene: Scene
    """Model, anatomy and cone; the truth is `scene.anatomy`."""
    data: mujoco.MjData
    """The state of the scene's model, forwarded. A sensor reads it and writes nothing."""
    T_rest_world: NDArray[np.float64] | None = None
    """Takes the world to the frame in which the organ lies as it was planned, shape (4, 4); None where it does lie so.
    All that a sensor is told, and all that it returns, is in that frame: where the organ has moved, the probe has moved
    the other way."""

    def seen_from(self, T_rest_world: NDArray[np.float64]) -> SceneState:
        """The same state with the organ elsewhere; it shares the prepared rays."""
        moved = replace(self, T_rest_world=T_rest_world)
        moved.__dict__["rays"] = self.rays
        return moved

    @property
    def cone(self) -> Cone:
        """The sensed volume, whose apex is the tip and whose axis is the tip's +z."""
        return self.scene.cone

    @property
    def T_world_probe(self) -> NDArray[np.float64]:
        """The pose of the probe's tip now, a fresh copy, shape (4, 4); +z points along the beam."""
        tip = self.data.site(self.scene.tip_site)
        T_world_probe = np.eye(4)
        T_world_probe[:3, :3] = tip.xmat.reshape(3, 3)
        T_world_probe[:3, 3] = tip.xpos
        return T_world_probe if self.T_rest_world is None else self.T_rest_world @ T_world_probe

    @cached_property
    def rays(self) -> SurfaceRays:
        """Rays at the surfaces of the scene, prepared on first use; give them `data`."""
        return SurfaceRays(self.scene)

    def to_world_m(self, points_probe_m: ArrayLike) -> NDArray[np.float64]:
        """Points given in the probe's frame, now in the world frame [m], in the same shape.

        Args:
            points_probe_m: Points in the frame of the tip [m], shape (..., 3).
        """
        T_world_probe = self.T_world_probe
        return np.asarray(points_probe_m) @ T_world_probe[:3, :3].T + T_world_probe[:3, 3]

    def labels(self, points_m: ArrayLike) -> PointLabels:
        """What lies at points, by the solids of the anatomy.

        The rays say the same, but for points within 1e-7 m of a surface: MuJoCo keeps meshes in single precision.

        Args:
            points_m: Any points, world frame [m], shape (N, 3).

        Raises:
            ValueError: Points of another shape, or values that are not finite.
        """
        anatomy = self.scene.anatomy
        is_target = anatomy.target.is_tumour(points_m) if anatomy.target is not None else None
        return PointLabels(anatomy.is_inside_organ(points_m), anatomy.is_tumour(points_m), is_target)

    def exact_reading(self, points_m: ArrayLike) -> Reading:
        """The reading of a sensor that sees these points without error; those outside the organ are left out.

        Args:
            points_m: The points that are seen, world frame [m], shape (N, 3).

        Raises:
            ValueError: Points of another shape, or values that are not finite.
        """
        points_m, labels = np.asarray(points_m, dtype=np.float64), self.labels(points_m)
        is_seen = labels.is_in_organ
        is_target = labels.is_target[is_seen] if labels.is_target is not None else None
        return Reading(points_m[is_seen], labels.is_tumour[is_seen], self.T_world_probe, is_target)


class Sensor(ABC):
    """Turns a contact of the probe into a reading. It holds settings only: one sensor serves any number of episodes.

    A sensor of one's own derives from this class, or is any class with such a `sense`. It must hold to four rules:

    - It draws from `rng` only, and keeps nothing from one call to the next. The same state and the same `rng` then
      give the same reading, to the byte.
    - All points of its reading lie inside the organ.
    - A point that the probe cannot see, in a shadow for example, is left out. Returned with the label free, it would
      teach the map that there is no tumour.
    - Where the scene has a second class (`scene.anatomy.target` is not None), `is_target` labels the points for it;
      in all other scenes `is_target` is None.

    This is a whole sensor. It sees a ball about the middle of the cone's axis, and gets a share of the labels wrong:

        @dataclass(frozen=True, kw_only=True)
        class BallSensor(Sensor):
            radius_m: float = 0.02
            error_rate: float = 0.05

            def sense(self, state: SceneState, rng: np.random.Generator) -> Reading:
                points_probe_m = rng.uniform(-self.radius_m, self.radius_m, (1000, 3))
                points_probe_m = points_probe_m[np.linalg.norm(points_probe_m, axis=1) < self.radius_m]
                points_probe_m[:, 2] += state.cone.depth_m / 2.0
                exact = state.exact_reading(state.to_world_m(points_probe_m))
                is_wrong = rng.random(len(exact.points_m)) < self.error_rate
                return replace(exact, is_occupied=exact.is_occupied ^ is_wrong)
    """

    @abstractmethod
    def sense(self, state: SceneState, rng: np.random.Generator) -> Reading:
        """The reading of the probe where it is now.

        Args:
            state: The scene now, with the tip where the probe really is.
            rng: The sensor's own stream of the episode, the only source of randomness.
        """
