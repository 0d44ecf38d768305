"""An arm: the MJCF file that it comes from, its flange, where it stands, and its home configuration."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.world.errors import WorldError

_SIM_DIR = Path(__file__).resolve().parents[2]
_PLACES = (_SIM_DIR / "_models", _SIM_DIR.parent / "models")
MODELS_DIR = next((folder for folder in _PLACES if folder.is_dir()), _PLACES[-1])
"""The project's MJCF files and meshes: inside `sim` where a wheel was installed, beside it in a checkout."""

HOME_KEYFRAMES = ("home", "ready", "stow")
"""Names under which robot models keep their rest configuration; the first one found is used."""
FLANGE_SITES = ("flange", "attachment_site")
"""Names under which robot models keep the site that carries a tool; the first one found is used."""


class ArmError(WorldError):
    """An arm's MJCF that cannot be used as it is."""


@dataclass(frozen=True, kw_only=True)
class ArmModel:
    """An arm: the file it comes from, the site that carries the probe, and where it stands."""

    path: Path = MODELS_DIR / "arm.xml"
    """MJCF file of the arm."""
    flange: str | None = None
    """Site at the end of the chain; the probe is attached there, its +z along the site's +z. By default the first of
    `FLANGE_SITES` that the arm has."""
    base_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the file's origin stands in the world [m]."""
    base_yaw_rad: float = 0.0
    """How the file is turned about the world's vertical [rad]."""

    @property
    def T_world_base(self) -> NDArray[np.float64]:
        """Maps the file's coordinates to the world, shape (4, 4)."""
        return base_frame(self.base_m, self.base_yaw_rad)

    def load(self) -> tuple[mujoco.MjSpec, NDArray[np.float64]]:
        """The arm's spec and its home configuration.

        Returns:
            The spec (without keyframes: those do not survive attachment to a scene) and the home joint
            positions [rad or m], shape (n_joints,).

        Raises:
            ArmError: The file is missing or broken, has no joints, a mobile base, or no such flange site.
        """
        if not self.path.is_file():
            raise ArmError(
                f"{self.path}: no such arm file. Give `arm` the path of an MJCF file, or `default`."
            )
        try:
            spec = mujoco.MjSpec.from_file(str(self.path))
            _drop_bad_keyframes(spec)
            model = spec.compile()
        except ValueError as error:
            raise ArmError(f"{self.path}: MuJoCo cannot compile this arm: {_first_line(error)}") from error
        self._check(model)
        self.flange_of(spec)
        home_q = _home_configuration(model)
        for key in list(spec.keys):
            spec.delete(key)
        return spec, home_q

    def flange_of(self, spec: mujoco.MjSpec) -> str:
        """The name of the flange's site in the arm's spec.

        Raises:
            ArmError: There is no such site.
        """
        sites = [site.name for site in spec.sites if site.name]
        wanted = FLANGE_SITES if self.flange is None else (self.flange,)
        for name in wanted:
            if name in sites:
                return name
        raise ArmError(
            f"{self.path}: no site named {' or '.join(map(repr, wanted))} to carry the probe "
            f"(sites: {', '.join(sites) or 'none'}). Name one with `flange`, or add a <site> to the last link."
        )

    def _check(self, model: mujoco.MjModel) -> None:
        if model.njnt == 0:
            raise ArmError(f"{self.path}: this model has no joints, so it is not an arm.")
        kinds = {int(kind) for kind in model.jnt_type}
        hinge, slide = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
        if not kinds <= {hinge, slide}:
            raise ArmError(
                f"{self.path}: a free or ball joint was found. Sounding needs a fixed base and hinge or slide "
                "joints; remove the <freejoint> of the base."
            )
        is_endless = (model.jnt_type == slide) & (model.jnt_limited == 0)
        if is_endless.any():
            name = model.joint(int(np.argmax(is_endless))).name or "a joint"
            raise ArmError(
                f"{self.path}: {name} slides without limits, as a mobile base does. Sounding needs a fixed base: "
                "give the joint a range, or remove it and place the arm with `base_mm`."
            )


def base_frame(base_m: tuple[float, float, float], yaw_rad: float) -> NDArray[np.float64]:
    """The frame of a base that stands upright at a position [m], turned by a yaw [rad], shape (4, 4)."""
    T = np.eye(4)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    T[:2, :2] = [[cos, -sin], [sin, cos]]
    T[:3, 3] = base_m
    return T


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__


def _drop_bad_keyframes(spec: mujoco.MjSpec) -> None:
    """Remove keyframes whose size does not fit the model, which would make the compiler refuse all of it."""
    n_q = sum(_joint_width(joint) for joint in spec.joints)
    for key in list(spec.keys):
        if len(key.qpos) not in (0, n_q):
            spec.delete(key)


def _joint_width(joint: mujoco.MjsJoint) -> int:
    widths = {mujoco.mjtJoint.mjJNT_FREE: 7, mujoco.mjtJoint.mjJNT_BALL: 4}
    return widths.get(joint.type, 1)


def _home_configuration(model: mujoco.MjModel) -> NDArray[np.float64]:
    """The keyframe named home or the like; without one the first keyframe, and without any the middle of the ranges."""
    names = [model.key(i).name for i in range(model.nkey)]
    for name in (*HOME_KEYFRAMES, *names[:1]):
        if name in names:
            return np.array(model.key(name).qpos, dtype=np.float64)
    low, high = model.jnt_range.T
    return np.where(model.jnt_limited.astype(bool), (low + high) / 2.0, model.qpos0)
