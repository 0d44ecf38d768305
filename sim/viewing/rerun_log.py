"""A run as a Rerun recording: organ, tumours, map, probe, cone and curves on two timelines, actions and seconds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.colours import trace_rgb
from sim.findings.mapped_surface import surface_after
from sim.record.recording import Recording
from sim.record.run_record import RunRecord
from sim.world.optional import optional_module
from sim.world.solids.solid import Solid

ORGAN, TRUTH, MAP, PROBE = (165, 138, 131, 60), (213, 94, 0, 160), (0, 114, 178, 255), (0, 158, 115, 255)
SECOND, SECOND_MAP = (204, 121, 167, 160), (230, 159, 0, 255)
STRUCTURE, KEEPOUT = (84, 96, 110, 255), (240, 228, 66, 255)
CURVES = ("sensed_fraction", "auprc", "target_sensed_fraction", "target_auprc", "expected_improvement")
N_SIDES = 32


def write_rerun(record: RunRecord, recording: Recording, path: Path) -> int:
    """Write a .rrd file, and return the number of actions in it.

    Raises:
        MissingPackageError: Rerun is not installed.
    """
    rr = optional_module("rerun", "rerun", "`rerun`")
    path.parent.mkdir(parents=True, exist_ok=True)
    stream = rr.RecordingStream("sounding", recording_id=record.folder.resolve().name)
    stream.save(str(path))
    _log_scene(rr, stream, record)
    began_s = 0.0
    for index, T in enumerate(record.T_world_probe):
        motion = recording.motions[index + 1]
        for time_s, tip_m in zip(motion.time_s, recording.tips_rest_m(index + 1), strict=True):
            _set_time(stream, index + 1, began_s + float(time_s))
            stream.log("world/tip", rr.Points3D([tip_m], radii=0.003, colors=[PROBE]))
        began_s += motion.motion_s
        _set_time(stream, index + 1, began_s)
        _log_action(rr, stream, record, index, T)
        began_s += recording.sensing_s
    _log_trace(rr, stream, recording)
    stream.flush()
    return record.n_steps


def _log_scene(rr: Any, stream: Any, record: RunRecord) -> None:
    """Log what stays as it is during the run."""
    stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("world/organ", _mesh(rr, record.anatomy.organ, ORGAN), static=True)
    for i, tumour in enumerate(record.anatomy.tumours):
        stream.log(f"world/tumours/{i + 1}", _mesh(rr, tumour, TRUTH), static=True)
    for i, target in enumerate(record.target.anatomy.tumours if record.target else ()):
        stream.log(f"world/targets/{i + 1}", _mesh(rr, target, SECOND), static=True)
    for i, structure in enumerate(record.anatomy.structures):
        colour = KEEPOUT if structure.is_keepout else STRUCTURE
        entity: list[object] = ["world", "structures", f"{i + 1} {structure.name}"]
        stream.log(entity, _mesh(rr, structure.solid, colour), static=True)
    stream.log("world/probe/cone", _cone(rr, record), static=True)


def _set_time(stream: Any, action: int, time_s: float) -> None:
    stream.set_time("action", sequence=action)
    stream.set_time("procedure", duration=time_s)


def _log_action(rr: Any, stream: Any, record: RunRecord, index: int, T: NDArray[np.float64]) -> None:
    stream.log("world/probe", rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3]))
    stream.log(
        "world/poses", rr.Points3D(record.T_world_probe[: index + 1, :3, 3], radii=0.0025, colors=[PROBE])
    )
    for name, each, colour in (("map", record, MAP), ("target_map", record.target, SECOND_MAP)):
        surface = None if each is None else surface_after(each, index + 1)
        if surface is not None:
            vertices_m, faces = surface
            vertices_m = vertices_m if len(faces) else np.zeros((1, 3))  # Rerun refuses a mesh of nothing
            mesh = rr.Mesh3D(vertex_positions=vertices_m, triangle_indices=faces, albedo_factor=colour)
            stream.log(f"world/{name}", mesh)
    for name in CURVES:
        value = record.numbers(name)[index]
        if np.isfinite(value):
            stream.log(f"curves/{name}", rr.Scalars(float(value)))
    frame = record.folder / "frames" / f"{index + 1:04d}.png"
    if frame.is_file():
        stream.log("frame", rr.EncodedImage(path=frame))


def _log_trace(rr: Any, stream: Any, recording: Recording) -> None:
    """Log the way on the organ, coloured by time, piece by piece as it was gone."""
    trace, begins_s = recording.trace(), list(recording.begins_s.values())
    steps = list(recording.motions)
    for row, (piece_m, end_s) in enumerate(zip(trace.pieces_m, trace.end_s.tolist(), strict=True)):
        action = steps[int(np.searchsorted(begins_s, end_s)) - 1]
        _set_time(stream, action, end_s)
        colour = [round(255 * each) for each in trace_rgb(end_s / recording.duration_s)]
        stream.log(f"world/trace/{row}", rr.LineStrips3D([piece_m], radii=0.0012, colors=[colour]))


def _mesh(rr: Any, solid: Solid, colour: tuple[int, int, int, int]) -> Any:
    return rr.Mesh3D(
        vertex_positions=solid.vertices_m, triangle_indices=solid.faces, albedo_factor=colour,
        vertex_normals=solid.to_trimesh().vertex_normals,
    )  # fmt: skip


def _cone(rr: Any, record: RunRecord) -> Any:
    """The cone's rim and four of its sides, in the probe's frame."""
    turn = np.linspace(0.0, 2 * np.pi, N_SIDES + 1)
    cone = record.cone
    rim = np.column_stack(
        [
            cone.base_radius_m * np.cos(turn),
            cone.base_radius_m * np.sin(turn),
            np.full_like(turn, cone.depth_m),
        ]
    )
    sides = [np.array([[0.0, 0.0, 0.0], rim[i]]) for i in range(0, N_SIDES, N_SIDES // 4)]
    return rr.LineStrips3D([rim, *sides], radii=0.0006, colors=[PROBE])
