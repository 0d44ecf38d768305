"""Trajectory files: the states of a run and the anatomy around them, so that a replay needs nothing else."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.episode.moving.motion import Motion
from sim.episode.truth import Truth
from sim.errors import UsageError
from sim.world.anatomy.anatomy import Anatomy, build_anatomy
from sim.world.anatomy.structures import Structure
from sim.world.errors import WorldError
from sim.world.probes.probe import ProbeModel
from sim.world.solids.solid import Solid

from .run_folder import RunFolder

ANATOMY = "anatomy.npz"
PROBE = "probe.xml"
"""A user's probe as the run had it, with its meshes, whatever becomes of the user's own file."""
KEYS = ("time_s", "states", "tips_m", "phases")
"""Fields of a motion that are kept."""


def write_motion(
    folder: RunFolder, step: int, motion: Motion, truly: Mapping[str, NDArray[np.float64]] | None = None
) -> None:
    """Write the states of one step's motion to motion/<step>.npz.

    Args:
        folder: The run's.
        step: The action, from 1.
        motion: Its motion.
        truly: Of an organ that does not lie as planned, the arrays that `read_places` reads.
    """
    arrays = {key: getattr(motion, key) for key in KEYS} | dict(truly or {})
    folder.write_arrays(f"motion/{step:05d}.npz", compressed=True, **arrays)


def write_anatomy(folder: RunFolder, truth: Truth) -> None:
    """Write the surfaces of organ, tumours, targets and structures, and the detection points, world frame [m]."""
    anatomy = truth.anatomy
    structures, target = anatomy.structures, anatomy.target
    solids = {"organ": anatomy.organ} | {f"tumour{i}": tumour for i, tumour in enumerate(anatomy.tumours)}
    solids |= {f"structure{i}": structure.solid for i, structure in enumerate(structures)}
    if target is not None:
        solids |= {f"target{i}": body for i, body in enumerate(target.tumours)}
    arrays = {f"{name}_vertices_m": solid.vertices_m for name, solid in solids.items()}
    arrays |= {f"{name}_faces": solid.faces.astype(np.int32) for name, solid in solids.items()}
    arrays |= {
        "detection_points_m": anatomy.detection_points_m,
        "detection_tumours": anatomy.detection_tumours,
        "detection_is_attainable": truth.is_attainable,
        "structure_names": np.array([structure.name for structure in structures], dtype=np.str_),
        "structure_is_keepout": np.array([structure.is_keepout for structure in structures], dtype=np.bool_),
    }
    if target is not None and truth.target is not None:
        arrays |= {
            "target_name": np.array(target.name),
            "target_detection_points_m": target.detection_points_m,
            "target_detection_tumours": target.detection_tumours,
            "target_detection_is_attainable": truth.target.is_attainable,
        }
    folder.write_arrays(ANATOMY, compressed=True, **arrays)


def write_probe(folder: RunFolder, probe: ProbeModel) -> None:
    """Write a probe of the user's to probe.xml, so that a replay has it; nothing for the embedded one.

    Raises:
        ProbeError: Its file cannot be used any more.
    """
    rigid = probe.load()
    if rigid is not None:
        folder.write_text(PROBE, rigid.mjcf())


def read_anatomy(folder: Path) -> Anatomy:
    """The anatomy of a run without detection points, and without structures where an older run kept none.

    Raises:
        UsageError: The file is missing or broken.
    """
    try:
        with np.load(folder / ANATOMY, allow_pickle=False) as arrays:
            names = [key.removesuffix("_faces") for key in arrays.files if key.endswith("_faces")]
            solids = {name: Solid(arrays[f"{name}_vertices_m"], arrays[f"{name}_faces"]) for name in names}
            target = None
            if "target_name" in arrays.files:
                target = _bare(str(arrays["target_name"]), solids, "target")
            return _bare(folder.name, solids, "tumour", target, _structures(arrays, solids))
    except FileNotFoundError as error:
        raise UsageError(
            f"{folder / ANATOMY}: missing; only runs that recorded motion can be replayed."
        ) from error
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, WorldError) as error:
        raise UsageError(f"{folder / ANATOMY}: cannot be read ({error}). Run the episode again.") from error


def _bare(
    name: str,
    solids: Mapping[str, Solid],
    kind: str,
    target: Anatomy | None = None,
    structures: tuple[Structure, ...] = (),
) -> Anatomy:
    """The organ with all bodies of a kind, without detection points."""
    bodies = tuple(solids[f"{kind}{i}"] for i in range(sum(each.startswith(kind) for each in solids)))
    return build_anatomy(
        solids["organ"], bodies, name=name, rng=np.random.default_rng(0), n_detection_points=0, target=target,
        structures=structures,
    )  # fmt: skip


def _structures(arrays: Mapping[str, NDArray[Any]], solids: Mapping[str, Solid]) -> tuple[Structure, ...]:
    """The structures of an anatomy's file; none where an older run kept none."""
    if "structure_names" not in arrays:
        return ()
    marks = zip(arrays["structure_names"], arrays["structure_is_keepout"], strict=True)
    return tuple(
        Structure(name=str(name), solid=solids[f"structure{i}"], is_keepout=bool(is_keepout))
        for i, (name, is_keepout) in enumerate(marks)
    )


def read_motions(folder: Path) -> dict[int, Motion]:
    """The recorded motions of a run by step, in order.

    Raises:
        UsageError: There are none, or a file is broken.
    """
    files = sorted((folder / "motion").glob("*.npz"))
    if not files:
        raise UsageError(f"{folder}: holds no motion/*.npz, so there is nothing to replay.")
    return {_step_of(file): _read_motion(file) for file in files}


@dataclass(frozen=True, eq=False)
class Places:
    """Where the organ of a run truly was that did not lie as planned."""

    T_world_rest: NDArray[np.float64]
    """Maps the world as it was planned to where the organ was at each state of a motion, shape (S, 4, 4)."""
    T_rest_probe: NDArray[np.float64]
    """Where the tip truly was in the planned organ when it sensed, before it pressed, shape (4, 4)."""


def read_places(folder: Path) -> dict[int, Places]:
    """Where the organ was during the motions of a run, by step; empty where it lay as planned.

    Raises:
        UsageError: A file is broken.
    """
    places = {}
    for file in sorted((folder / "motion").glob("*.npz")):
        with _opened(file) as arrays:
            if "T_world_rest" not in arrays:
                continue
            place = Places(arrays["T_world_rest"], arrays["T_rest_probe"])
            n_states = len(arrays["time_s"])
        if place.T_world_rest.shape != (n_states, 4, 4) or place.T_rest_probe.shape != (4, 4):
            raise UsageError(f"{file}: places and times do not fit together. Run the episode again.")
        places[_step_of(file)] = place
    return places


@contextmanager
def _opened(file: Path) -> Iterator[Mapping[str, NDArray[Any]]]:
    """The arrays of a motion's file.

    Raises:
        UsageError: It is broken, or lacks an array that is asked for.
    """
    try:
        with np.load(file, allow_pickle=False) as arrays:
            yield arrays
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise UsageError(f"{file}: cannot be read ({error}). Run the episode again.") from error


def _step_of(file: Path) -> int:
    if not file.stem.isdecimal():
        raise UsageError(f"{file}: is not named by the number of a step; remove it.")
    return int(file.stem)


def _read_motion(file: Path) -> Motion:
    with _opened(file) as arrays:
        time_s, states, tips_m, phases = (arrays[key] for key in KEYS)
    shapes_fit = states.ndim == 2 and time_s.shape == phases.shape == states.shape[:1] != (0,)
    if not (
        shapes_fit
        and np.isfinite(states).all()
        and np.isfinite(time_s).all()
        and (np.diff(time_s) >= 0).all()
    ):
        raise UsageError(f"{file}: times and states do not fit together. Run the episode again.")
    return Motion(time_s=time_s, states=states, tips_m=tips_m, phases=phases, joint_travel_rad=None)
