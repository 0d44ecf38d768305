"""Reading an arm's file as MuJoCo reads it."""

from __future__ import annotations

from pathlib import Path

import mujoco

from sim.world.errors import WorldError

from .errors import ArmError
from .mujoco_messages import MUJOCO_ERRORS, whole_message

SUFFIXES = (".xml", ".urdf")
"""How the names of an arm's files end."""
MISSING = "Error opening file"
"""What MuJoCo says of a mesh, or of a file that is included, where there is none."""


def read_spec(path: Path) -> mujoco.MjSpec:
    """The spec of an MJCF or URDF file, not compiled yet.

    Raises:
        ArmError: There is no such file, or MuJoCo cannot read it.
    """
    check_is_file(path, part="arm", formats="MJCF or URDF", error=ArmError)
    if path.suffix not in SUFFIXES:
        raise ArmError(
            f"{path}: MuJoCo tells files by their names, and reads arms from {' and '.join(SUFFIXES)}."
        )
    try:
        return mujoco.MjSpec.from_file(str(path))
    except MUJOCO_ERRORS as error:
        raise _refused(path, error) from error


def check_is_file(path: Path, *, part: str, formats: str, error: type[WorldError]) -> None:
    """Nothing, if a path is that of a file.

    Args:
        path: The path that a person gave.
        part: The part that the file is of, which is also the field that names it.
        formats: The formats that the part may have.
        error: The error of that part.

    Raises:
        WorldError: It is a folder, or nothing is there; of the class `error`.
    """
    try:
        is_folder, is_file = path.is_dir(), path.is_file()
    except OSError:  # a name that is too long for a file
        is_folder = is_file = False
    if is_folder:
        raise error(f"{path}: this is a folder. Give `{part}` the path of the {formats} file in it.")
    if not is_file:
        raise error(f"{path}: no such {part} file. Give `{part}` the path of an MJCF file, or `default`.")


def compiled(spec: mujoco.MjSpec, path: Path) -> mujoco.MjModel:
    """The model of a spec.

    Raises:
        ArmError: MuJoCo cannot compile it.
    """
    try:
        return spec.compile()
    except MUJOCO_ERRORS as error:
        raise _refused(path, error) from error


def _refused(path: Path, error: Exception) -> ArmError:
    said = whole_message(error)
    remedy = (
        " Put it there, or name its folder as meshdir in the file's <compiler>." if MISSING in said else ""
    )
    return ArmError(f"{path}: MuJoCo cannot compile this arm: {said}.{remedy}")
