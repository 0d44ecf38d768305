"""A run with its motion as a USD stage; docs/report.md tells what is in it.

The world is the true one: the arm moves in it, and so does the patient, with organ, tumours and map below one prim.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.colours import KEEPOUT, MAP, ORGAN, PROBE, STRUCTURE, TARGET, TARGET_MAP, TRUTH, rgba, trace_rgb
from sim.findings.mapped_surface import surface_after
from sim.record.recording import Recording, set_state
from sim.record.run_record import RunRecord
from sim.report.arm_parts import arm_parts, table_parts
from sim.world.camera.viewpoint import Margins, viewpoint_of
from sim.world.solids.solid import Solid

from .stage import FRAMES_PER_S, Colour, Stage

PATIENT = "/World/Patient"
JUST_BEFORE = 1e-3
"""Time codes by which a map is held until the next one, so that no renderer blends the two."""
CURVES = ("sensed_fraction", "auprc", "target_sensed_fraction", "target_auprc")
ORGAN_OPACITY, TRUTH_OPACITY, CONE_OPACITY = 0.4, 0.7, 0.2
N_SIDES = 48
"""Sides of the cone."""
MARK_M, TRACE_M = 0.005, 0.0024
"""Diameter of the mark of a pose, and of the trace of a sweep [m]."""
ASPECT = 16.0 / 9.0
"""The picture's width over its height."""


def write_usd(record: RunRecord, recording: Recording, path: Path) -> int:
    """Write a .usdc, .usda, .usd or .usdz file, and return the number of actions in it.

    Raises:
        MissingPackageError: Pixar's library is not installed.
        FieldError: The file cannot be written.
    """
    text = f"A run of Sounding: {record.n_steps} actions in {recording.duration_s:.1f} s."
    stage = Stage(text, recording.duration_s)
    _put_measures(stage, record, recording)
    _put_patient(stage, record, recording)
    _put_sensed(stage, record, recording)
    _put_trace(stage, recording)
    _put_table(stage, recording)
    _put_arm(stage, recording)
    _put_cone(stage, record, recording)
    _put_camera(stage, record, recording)
    stage.write(path)
    return record.n_steps


def _ends(recording: Recording) -> list[float]:
    """The time code at which each action ended."""
    motions = recording.motions
    return [
        FRAMES_PER_S * (begin_s + motions[step].motion_s + recording.sensing_s)
        for step, begin_s in recording.begins_s.items()
    ]


def _times(recording: Recording) -> NDArray[np.float64]:
    """The time codes of the states of all motions, in order."""
    begins_s = recording.begins_s
    return FRAMES_PER_S * np.concatenate(
        [begins_s[step] + motion.time_s for step, motion in recording.motions.items()]
    )


def _put_measures(stage: Stage, record: RunRecord, recording: Recording) -> None:
    """How many actions are done, and the measures after each, as numbers in time on the world's prim."""
    ends = _ends(recording)
    done = stage.world.CreateAttribute("sounding:action", stage.kinds.Int, custom=True)
    for action, time in enumerate([0.0, *ends]):
        done.Set(action, time)
    for name in CURVES:
        values = record.numbers(name)
        if not np.isfinite(values).any():
            continue
        curve = stage.world.CreateAttribute(f"sounding:{name}", stage.kinds.Double, custom=True)
        for value, time in zip(values.tolist(), ends, strict=False):
            if np.isfinite(value):
                curve.Set(value, time)


def _put_patient(stage: Stage, record: RunRecord, recording: Recording) -> None:
    """Organ, tumours, structures and maps, which move with the organ."""
    anatomy, patient = record.anatomy, stage.group(PATIENT)
    if recording.places:
        T = np.concatenate([recording.places[step].T_world_rest for step in recording.motions])
        stage.move(patient, _times(recording), T[:, :3, 3], Rotation.from_matrix(T[:, :3, :3]))
    _put_solids(stage, "Organ", [("organ", anatomy.organ)], rgba(ORGAN, ORGAN_OPACITY))
    _put_solids(stage, "Tumours", _named("tumour", anatomy.tumours), rgba(TRUTH, TRUTH_OPACITY))
    for group, is_keepout, colour in (("Structures", False, STRUCTURE), ("NoPress", True, KEEPOUT)):
        some = [each for each in anatomy.structures if each.is_keepout == is_keepout]
        # Two names may be one as a name of a prim.
        named = [(f"{each.name}_{index}", each.solid) for index, each in enumerate(some, start=1)]
        _put_solids(stage, group, named, rgba(colour))
    _put_map(stage, "Map", record, _ends(recording), rgba(MAP))
    if record.target is not None:
        bodies = _named("target", record.target.anatomy.tumours)
        _put_solids(stage, "Targets", bodies, rgba(TARGET, TRUTH_OPACITY))
        _put_map(stage, "TargetMap", record.target, _ends(recording), rgba(TARGET_MAP))


def _named(name: str, solids: Sequence[Solid]) -> list[tuple[str, Solid]]:
    return [(f"{name}_{index}", solid) for index, solid in enumerate(solids, start=1)]


def _put_solids(stage: Stage, group: str, named: Sequence[tuple[str, Solid]], colour: Colour) -> None:
    if named:
        stage.group(f"{PATIENT}/{group}")
    for name, solid in named:
        stage.mesh(f"{PATIENT}/{group}/{stage.name(name)}", solid.vertices_m, solid.faces, colour)


def _put_map(stage: Stage, name: str, record: RunRecord, ends: list[float], colour: Colour) -> None:
    """The surface around what the map calls tumour, which is another after each action whose map was kept."""
    nothing = np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    kept = [(0.0, nothing)]
    for step, end in enumerate(ends[: record.n_steps], start=1):
        if (surface := surface_after(record, step)) is not None:
            kept.append((end, surface))
    if len(kept) == 1:
        return
    mesh = stage.mesh(f"{PATIENT}/{name}", *nothing, colour)
    for row, (begin, surface) in enumerate(kept):
        stage.set_surface(mesh, *surface, begin)
        if row + 1 < len(kept):
            stage.set_surface(mesh, *surface, kept[row + 1][0] - JUST_BEFORE)


def _put_sensed(stage: Stage, record: RunRecord, recording: Recording) -> None:
    """A mark at each pose that sensed, or at each reading of a sweep, from the end of its action on."""
    stage.group(f"{PATIENT}/Sensed")
    steps, T_world_probe = record.readings or (np.arange(1, record.n_steps + 1), record.T_world_probe)
    for action, end in enumerate(_ends(recording)[: record.n_steps], start=1):
        places_m = T_world_probe[steps == action, :3, 3]
        marks = stage.marks(f"{PATIENT}/Sensed/action_{action:04d}", places_m, MARK_M, rgba(PROBE))
        stage.show(marks, False, 0.0)
        stage.show(marks, True, end)


def _put_trace(stage: Stage, recording: Recording) -> None:
    """The way on the organ of a sweep, coloured by time, each piece from the end of its action on."""
    if recording.readings is None:
        return
    trace, begins_s = recording.trace(), np.array(list(recording.begins_s.values()))
    rows = np.searchsorted(begins_s, trace.end_s - 1e-9) - 1
    stage.group(f"{PATIENT}/Trace")
    for row, end in enumerate(_ends(recording)):
        if not (is_own := rows == row).any():
            continue
        colours = [trace_rgb(share) for share in (trace.end_s[is_own] / recording.duration_s).tolist()]
        path = f"{PATIENT}/Trace/action_{row + 1:04d}"
        lines = stage.lines(path, trace.pieces_m[is_own], TRACE_M, colours)
        stage.show(lines, False, 0.0)
        stage.show(lines, True, end)


def _put_table(stage: Stage, recording: Recording) -> None:
    """The operating table, which stands still."""
    stage.group("/World/Table")
    for index, (_, colour, mesh) in enumerate(table_parts(recording)):
        red, green, blue = colour.tolist()
        stage.mesh(f"/World/Table/part_{index}", mesh.vertices, mesh.faces, (red, green, blue, 1.0))


def _put_arm(stage: Stage, recording: Recording) -> None:
    """Arm and probe, body by body, with the motion of each, and the tip."""
    scene, parts = recording.scene, arm_parts(recording)
    names = list(dict.fromkeys(name for name, *_ in parts))
    data, bodies = scene.new_data(), [scene.model.body(name).id for name in names]
    poses, tips_m, R_tips = [], [], []
    for motion in recording.motions.values():
        for state in motion.states:
            set_state(scene, data, state)
            poses.append(np.hstack([data.xpos[bodies], data.xquat[bodies]]))
            tips_m.append(data.site(scene.tip_site).xpos.copy())
            R_tips.append(data.site(scene.tip_site).xmat.reshape(3, 3).copy())
    ways, times = np.array(poses), _times(recording)
    stage.group("/World/Arm")
    for index, name in enumerate(names):
        turns = Rotation.from_quat(ways[:, index, 3:], scalar_first=True)
        stage.move(stage.group(f"/World/Arm/{stage.name(name)}"), times, ways[:, index, :3], turns)
    for index, (name, colour, mesh) in enumerate(parts):
        path, (red, green, blue) = f"/World/Arm/{stage.name(name)}/part_{index}", colour.tolist()
        stage.mesh(path, mesh.vertices, mesh.faces, (red, green, blue, 1.0))
    stage.move(stage.group("/World/Tip"), times, np.array(tips_m), Rotation.from_matrix(np.array(R_tips)))


def _put_cone(stage: Stage, record: RunRecord, recording: Recording) -> None:
    """The side of the sensed cone at the tip, while it senses; all the time in a sweep."""
    cone, turn = record.cone, np.linspace(0.0, 2.0 * np.pi, N_SIDES, endpoint=False)
    radius_m = cone.base_radius_m
    rim_m = np.column_stack(
        [radius_m * np.cos(turn), radius_m * np.sin(turn), np.full(N_SIDES, cone.depth_m)]
    )
    first = np.arange(1, N_SIDES + 1)
    faces = np.column_stack([np.zeros(N_SIDES, dtype=np.int64), np.roll(first, -1), first])
    mesh = stage.mesh("/World/Tip/Cone", np.vstack([np.zeros(3), rim_m]), faces, rgba(PROBE, CONE_OPACITY))
    if recording.readings is None:
        for step, begin_s in recording.begins_s.items():
            stage.show(mesh, False, FRAMES_PER_S * begin_s)
            stage.show(mesh, True, FRAMES_PER_S * (begin_s + recording.motions[step].motion_s))


def _put_camera(stage: Stage, record: RunRecord, recording: Recording) -> None:
    """A camera that has the organ and the way of the tip, from the arm's far side."""
    scene, organ_m = recording.scene, record.anatomy.organ.vertices_m
    base_m = scene.T_world_base[:3, 3] - organ_m.mean(axis=0)
    base_rad = np.pi if scene.free_probe else float(np.arctan2(base_m[1], base_m[0]))
    tips_m = np.concatenate([motion.tips_m for motion in recording.motions.values()])
    view = viewpoint_of(organ_m, tips_m, aspect=ASPECT, base_rad=base_rad, margins=Margins())
    stage.camera_and_light(view)
