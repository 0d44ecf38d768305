"""Loading an arm: its spec ready to be put into a scene, its home and its flange."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from .bystanders import leave_out_bystanders
from .checks import why_unusable
from .errors import ArmError
from .flange import find_flange
from .home import Keyframe, home_positions, take_keyframes, usable, within_limits
from .mujoco_messages import caught_warnings
from .reading import compiled, read_spec

USUAL_TIMESTEP_S, LEAST_TIMESTEP_S, MOST_TIMESTEP_S = 0.002, 1e-4, 0.01
"""Servos are simulated in the file's time steps, if these are neither so short that nothing gets done nor so long that
the arm becomes unstable."""


@dataclass(frozen=True, eq=False)
class LoadedArm:
    """An arm that can be put into a scene."""

    spec: mujoco.MjSpec
    """The arm without keyframes, which do not survive attachment, and bystanders; its bodies and joints have names."""
    home_q: NDArray[np.float64]
    """The home configuration [rad or m], shape (n_joints,)."""
    flange: str
    """The name of the site that carries the probe."""
    notices: tuple[str, ...]
    """What is unusual about the file, a sentence each."""


def load_arm(path: Path, flange: str | None = None) -> LoadedArm:
    """The arm of a file.

    Args:
        path: An MJCF or URDF file.
        flange: The site or body that carries the probe; None for the usual one, see `find_flange`.

    Raises:
        ArmError: The file is missing or broken, or holds no arm that can be used.
    """
    with caught_warnings() as said, _told_with_errors(said):
        spec, keyframes, model = _read(path)
        site, called = find_flange(spec, path, flange)
        good, remarks = usable(keyframes, model)
        home = home_positions(model, good)
        remarks += leave_out_bystanders(spec, site.parent)
        _drop_switched_off(spec, model)
        remarks += _mend_timestep(spec)
        model = compiled(spec, path)
        if why := why_unusable(model, int(model.site(site.name).bodyid[0]), called):
            raise ArmError(f"{path}: {why}")
        home_q, beyond = within_limits(model, home)
        # Its dynamics are looked at once: masses that cannot be simulated with are told here and not later.
        data = mujoco.MjData(model)
        data.qpos[:] = home_q
        mujoco.mj_forward(model, data)
    notices = [
        f"{path.name}: {text}" for text in (*(f"MuJoCo says: {text}." for text in said), *remarks, *beyond)
    ]
    return LoadedArm(spec, home_q, site.name, tuple(dict.fromkeys(notices)))


@contextmanager
def _told_with_errors(said: list[str]) -> Iterator[None]:
    """Adds to the error of a `with` block what MuJoCo warned of before: that may be its cause."""
    try:
        yield
    except ArmError as error:
        if said:
            raise ArmError(f"{error} MuJoCo warned: {'; '.join(said)}.") from error
        raise


def _read(path: Path) -> tuple[mujoco.MjSpec, list[Keyframe], mujoco.MjModel]:
    """The spec of a file with names given where there are none, its keyframes, and the model of all that it holds.

    Links that no joint moves keep their names, which fusing, usual for URDF, would take from them; files that MuJoCo
    loads only fused are fused.
    """
    errors: list[ArmError] = []
    for may_fuse in (False, True):
        spec = read_spec(path)
        keyframes = take_keyframes(spec)
        _give_names(spec)
        is_fused = bool(spec.compiler.fusestatic)
        spec.compiler.fusestatic = is_fused and may_fuse
        try:
            return spec, keyframes, compiled(spec, path)
        except ArmError as error:
            errors.append(error)
            if not is_fused:
                break
    raise errors[0]


def _give_names(spec: mujoco.MjSpec) -> None:
    """Give bodies and joints without a name one, by which messages, tables and exclusions can refer to them."""
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints)):
        taken = {element.name for element in elements}
        for number, element in enumerate(elements, 0 if kind == "body" else 1):
            if not element.name:
                name = f"{kind}{number}"
                while name in taken:
                    name += "_"
                element.name = name
                taken.add(name)


def _drop_switched_off(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Remove constraints that the file's own flags switch off: a scene, whose flags are others, would apply them."""
    off, flags = int(model.opt.disableflags), mujoco.mjtDisableBit
    if off & (int(flags.mjDSBL_EQUALITY) | int(flags.mjDSBL_CONSTRAINT)):
        for equality in list(spec.equalities):
            spec.delete(equality)
    if off & (int(flags.mjDSBL_LIMIT) | int(flags.mjDSBL_CONSTRAINT)):
        for tendon in spec.tendons:
            tendon.limited = mujoco.mjtLimited.mjLIMITED_FALSE


def _mend_timestep(spec: mujoco.MjSpec) -> list[str]:
    """Put the usual time step in the place of one that cannot be simulated with; says so."""
    timestep_s = spec.option.timestep
    if LEAST_TIMESTEP_S <= timestep_s <= MOST_TIMESTEP_S:
        return []
    spec.option.timestep = USUAL_TIMESTEP_S
    return [
        f"its time step of {timestep_s:g} s is not used; servos are simulated in steps of {USUAL_TIMESTEP_S:g} s."
    ]
