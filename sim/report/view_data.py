"""The data of the three-dimensional view: surfaces, poses, arm and the map after each action."""

from __future__ import annotations

from typing import Any

import numpy as np

from sim.colours import trace_rgb
from sim.episode.scenario import PAPER_ORGAN
from sim.errors import UsageError
from sim.record.map_field import called_from
from sim.record.map_history import LOG_ODDS_STEP, to_bytes
from sim.record.recording import Recording, read_recording
from sim.record.run_record import RunRecord
from sim.world.anatomy.structures import Structure
from sim.world.errors import WorldError

from .arm_parts import arm_parts, body_poses, body_ways
from .mesh_thinning import thinned, thinned_together
from .packing import Pack, add_mesh

MOST_HISTORY_BYTES = 24_000_000
"""Room for the maps before compression, at a byte a point; some are left out where they take more."""
MOST_ORGAN_FACES = 10_000
"""Most triangles of the organ: without a graphics card, they take most of the time of a drawing."""
MOST_TUMOUR_FACES = 12_000
"""Most triangles of all tumours together."""
WAY_POSES, MOST_WAY_POSES = 14, 1400
"""Poses of the arm on its way to an action, and most of them in all."""
MOST_STRUCTURE_FACES = 14_000
"""Most triangles of all structures together."""


def view_data(record: RunRecord, pack: Pack) -> dict[str, Any]:
    """Everything that the view draws; arrays go to `pack`.

    The organ stands still in it. Where it truly lay elsewhere than planned, arm and tip are drawn as seen from it.
    """
    recording = _recording(record)
    anatomy = record.anatomy
    bounds_m = anatomy.organ.bounds_m
    base = None
    if recording is not None and not recording.scene.free_probe:
        base = recording.scene.T_world_base.tolist()
    return {
        "organ": add_mesh(pack, *thinned(anatomy.organ.vertices_m, anatomy.organ.faces, MOST_ORGAN_FACES)),
        "tumours": [add_mesh(pack, *mesh) for mesh in thinned_together(anatomy.tumours, MOST_TUMOUR_FACES)],
        "structures": _structures(anatomy.structures, pack),
        "bounds": bounds_m.tolist(),
        "T_world_organ": record.T_world_organ.tolist(),
        "is_patient": record.scenario["organ"] != PAPER_ORGAN,
        "base": base,
        "probe": pack.add(record.T_world_probe.astype(np.float32).ravel()),
        "cone": {"half_angle_rad": record.cone.half_angle_rad, "depth_m": record.cone.depth_m},
        "skipped": _skipped(record),
        "arm": None if recording is None else _arm(recording, pack),
        "paths": None if recording is None else _paths(recording, record.n_steps, pack),
        "trace": None if recording is None else _trace(record, recording, pack),
        "map": _map(record, pack),
        "target": _target(record.target, pack),
    }


def _structures(structures: tuple[Structure, ...], pack: Pack) -> list[dict[str, Any]]:
    """The surfaces of vessels and the like, thinned to what a page has room for."""
    meshes = thinned_together([structure.solid for structure in structures], MOST_STRUCTURE_FACES)
    return [
        {"name": structure.name, "is_keepout": structure.is_keepout, **add_mesh(pack, *mesh)}
        for structure, mesh in zip(structures, meshes, strict=True)
    ]


def _recording(record: RunRecord) -> Recording | None:
    """The recorded states; None where no states were recorded, or the arm's file is gone."""
    try:
        return read_recording(record.folder)
    except (UsageError, WorldError):
        return None


def _arm(recording: Recording, pack: Pack) -> dict[str, Any]:
    parts = arm_parts(recording)
    names = list(dict.fromkeys(name for name, *_ in parts))
    poses = body_poses(recording, names)
    ways = _ways(recording, names, pack)
    return {
        "n_bodies": len(names),
        "parts": [
            {"body": names.index(name), "colour": colour.tolist()} | add_mesh(pack, mesh.vertices, mesh.faces)
            for name, colour, mesh in parts
        ],
        "poses": pack.add(poses.ravel()),
        "ways": None if ways is None else ways,
    }


def _ways(recording: Recording, names: list[str], pack: Pack) -> dict[str, Any] | None:
    """The bodies' poses on the way to each action, in two bytes a number; None where the probe jumped."""
    n_motions = len(recording.motions)
    if all(len(motion.states) < 3 for motion in recording.motions.values()):
        return None
    n = int(np.clip(MOST_WAY_POSES // n_motions, 4, WAY_POSES))
    ways = body_ways(recording, names, n)
    metre = float(np.abs(ways[..., :3]).max()) / 32767
    ways[..., :3] /= metre
    ways[..., 3:] *= 32767
    return {
        "n": n,
        "n_motions": n_motions,
        "metre": metre,
        "poses": pack.add(np.rint(ways).astype(np.int16).ravel()),
    }


def _paths(recording: Recording, n_steps: int, pack: Pack) -> dict[str, Any]:
    """The tip's way to each action."""
    ways = [recording.tips_rest_m(step) for step in recording.motions][:n_steps]
    ends = np.cumsum([len(way) for way in ways])
    points = np.concatenate([*ways, np.empty((0, 3))]).astype(np.float32)
    return {"points": pack.add(points.ravel()), "ends": ends.tolist()}


def _trace(record: RunRecord, recording: Recording, pack: Pack) -> dict[str, Any] | None:
    """The way on the organ in pieces with their colours by time, and the readings on it; None without a sweep.

    `ends` and `read` are how many pieces there are, and how many readings, after each action.
    """
    if record.readings is None:
        return None
    trace, steps = recording.trace(), record.readings[0]
    lasts_s = [*recording.begins_s.values(), recording.duration_s][1:]
    shares = trace.end_s / max(recording.duration_s, 1e-9)
    colours = np.array([trace_rgb(float(share)) for share in shares]).reshape(-1, 3)
    return {
        "pieces": pack.add(trace.pieces_m.astype(np.float32).ravel()),
        "colours": pack.add(colours.astype(np.float32).ravel()),
        "ends": np.searchsorted(trace.end_s, np.array(lasts_s) + 1e-9)[: record.n_steps].tolist(),
        "readings": pack.add(record.readings[1][:, :3, 3].astype(np.float32).ravel()),
        "read": np.searchsorted(steps, np.arange(1, record.n_steps + 1), side="right").tolist(),
    }


def _skipped(record: RunRecord) -> list[list[float]]:
    """The step and the position of each pose that could not be taken, where the table tells them."""
    return [
        [int(row["step"]), *(float(row[f"position_{axis}_m"]) for axis in "xyz")]
        for row in record.skipped
        if "position_x_m" in row
    ]


def _target(record: RunRecord | None, pack: Pack) -> dict[str, Any] | None:
    """The second class: its name, bodies and map; None where none was mapped."""
    if record is None:
        return None
    anatomy = record.anatomy
    return {
        "name": anatomy.name,
        "bodies": [add_mesh(pack, solid.vertices_m, solid.faces) for solid in anatomy.tumours],
        "map": _map(record, pack),
    }


def _map(record: RunRecord, pack: Pack) -> dict[str, Any] | None:
    """The lattice, and the maps that were kept, each as its difference from the one after it."""
    field = record.field
    if field is None:
        return None
    last = to_bytes(field.log_odds[field.is_inside])
    history = {step: to_bytes(log_odds) for step, log_odds in record.history.items()} | {record.n_steps: last}
    steps = thinned_steps(sorted(history), MOST_HISTORY_BYTES // max(last.size, 1))
    # The page shows the last map first, so that one stands whole. Differences wrap around, as their sums will.
    places = []
    for step, after in zip(steps, [*steps[1:], None], strict=True):
        following = np.zeros_like(last) if after is None else history[after]
        places.append(pack.add(history[step] - following))
    prior = float(record.config["map"]["prior_prevalence"])
    return {
        "shape": list(field.is_inside.shape),
        "low": field.low_m.tolist(),
        "cell": field.cell_m.tolist(),
        "inside": pack.add(np.packbits(field.is_inside.ravel(), bitorder="little")),
        "n_inside": field.n_inside,
        "steps": steps,
        "maps": places,
        "deviation": _deviation(record, pack),
        "log_odds_step": LOG_ODDS_STEP,
        "called_from": called_from(prior),
    }


def _deviation(record: RunRecord, pack: Pack) -> dict[str, Any]:
    """The standard deviation of the last map's latent inside the organ, in a byte a point over its range."""
    n_inside = 0 if record.field is None else record.field.n_inside
    deviation = np.zeros(n_inside) if record.deviation is None else record.deviation
    low, high = float(deviation.min()), float(deviation.max())
    share = (deviation - low) / max(high - low, 1e-12)
    return {"values": pack.add(np.rint(255 * share).astype(np.uint8)), "range": [low, high]}


def thinned_steps(steps: list[int], most: int) -> list[int]:
    """At most `most` of the steps, evenly, with the last one among them."""
    if len(steps) <= max(most, 1):
        return steps
    chosen = np.unique(np.linspace(0, len(steps) - 1, max(most, 2)).round().astype(int))
    return [steps[i] for i in chosen]
