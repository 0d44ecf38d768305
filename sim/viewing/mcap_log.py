"""A run as an MCAP file of ROS 2 messages, which Foxglove and `ros2 bag` read; docs/ros.md has its topics."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from mapping.storage import replacing
from sim.colours import KEEPOUT, ORGAN, STRUCTURE, TARGET, TRUTH
from sim.live.ros.messages import SHOWN_FROM, joint_state, point_cloud, pose_stamped, surface_marker
from sim.record.recording import Recording, set_state
from sim.record.run_record import RunRecord
from sim.world.frames import rigid_inverse
from sim.world.ik.chain import Chain
from sim.world.optional import optional_module
from sim.world.solids.solid import Solid

from .ros_definitions import KINDS, definition

POSE, JOINTS, CLOUD, MARKERS, NUMBER = KINDS
CURVES = ("auprc", "sensed_fraction", "target_auprc", "target_sensed_fraction")
NS = 1_000_000_000


class _Log:
    """An MCAP file that is being written."""

    def __init__(self, writer: Any) -> None:
        self._writer = writer
        self._schemas = {kind: writer.register_msgdef(kind, definition(kind)) for kind in KINDS}

    def put(self, topic: str, kind: str, message: dict[str, Any], time_s: float) -> None:
        """Write a message of a time of the procedure [s]."""
        ns = round(time_s * NS)
        self._writer.write_message(topic, self._schemas[kind], message, log_time=ns, publish_time=ns)


def write_mcap(record: RunRecord, recording: Recording, path: Path) -> int:
    """Write a .mcap file, and return the number of actions in it.

    Raises:
        MissingPackageError: Foxglove's library is not installed.
    """
    writing = optional_module("mcap_ros2.writer", "mcap", "`mcap`")
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        writer = writing.Writer(file)
        log, began_s = _Log(writer), 0.0
        log.put("/surfaces", MARKERS, {"markers": _surfaces(record)}, 0.0)
        for index, T in enumerate(record.T_world_probe):
            _put_motion(log, recording, index + 1, began_s)
            _put_sensed(log, recording, index + 1, T, began_s)
            began_s += recording.motions[index + 1].motion_s + recording.sensing_s
            _put_map(log, record, index + 1, began_s)
            for name in CURVES:
                if np.isfinite(value := record.numbers(name)[index]):
                    log.put(f"/{name}", NUMBER, {"data": float(value)}, began_s)
        writer.finish()
    return record.n_steps


def _put_motion(log: _Log, recording: Recording, step: int, began_s: float) -> None:
    """Write the joints at each state of a motion, and the tip as seen from the organ, which is drawn as planned."""
    scene, motion = recording.scene, recording.motions[step]
    data = scene.new_data()
    chain = None if scene.free_probe else Chain(scene)
    place = recording.places.get(step)
    for index, (time_s, state) in enumerate(zip(motion.time_s.tolist(), motion.states, strict=True)):
        at_s = began_s + time_s
        set_state(scene, data, state)
        T_tip = _tip(data, scene.tip_site)
        if place is not None:
            T_tip = rigid_inverse(place.T_world_rest[index]) @ T_tip
        log.put("/tip", POSE, pose_stamped(T_tip, at_s), at_s)
        if chain is not None:
            log.put("/joint_states", JOINTS, joint_state(chain.names, state[chain.columns], at_s), at_s)


def _put_sensed(
    log: _Log, recording: Recording, step: int, T_world_probe: NDArray[np.float64], began_s: float
) -> None:
    """Write where an action's readings were taken from: its pose, or those along the way."""
    readings = recording.readings
    if readings is None:
        at_s = began_s + recording.motions[step].motion_s + recording.sensing_s
        log.put("/sensed", POSE, pose_stamped(T_world_probe, at_s), at_s)
        return
    is_own = readings.steps == step
    for time_s, T in zip(readings.time_s[is_own].tolist(), readings.T_world_probe[is_own], strict=True):
        log.put("/sensed", POSE, pose_stamped(T, began_s + time_s), began_s + time_s)


def _tip(data: mujoco.MjData, site: str) -> NDArray[np.float64]:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = data.site(site).xmat.reshape(3, 3), data.site(site).xpos
    return T


def _put_map(log: _Log, record: RunRecord, step: int, time_s: float) -> None:
    """Write the map after an action, where it was kept."""
    field = record.field
    if field is None or step not in record.history:
        return
    probability = expit(record.history[step].astype(np.float64))
    is_shown = probability >= SHOWN_FROM
    places = np.argwhere(field.is_inside)[is_shown]
    points_m = np.column_stack([axis[places[:, i]] for i, axis in enumerate(field.axes_m)])
    log.put("/map", CLOUD, point_cloud(points_m, probability[is_shown], time_s), time_s)


def _surfaces(record: RunRecord) -> list[dict[str, Any]]:
    """Markers of what stays as it is during the run."""
    anatomy = record.anatomy
    named: list[tuple[str, Solid, str, float]] = [("organ", anatomy.organ, ORGAN, 0.25)]
    named += [(f"tumour {i}", solid, TRUTH, 0.7) for i, solid in enumerate(anatomy.tumours, start=1)]
    targets = record.target.anatomy.tumours if record.target else ()
    named += [(f"target {i}", solid, TARGET, 0.7) for i, solid in enumerate(targets, start=1)]
    for i, structure in enumerate(anatomy.structures, start=1):
        colour = KEEPOUT if structure.is_keepout else STRUCTURE
        named.append((f"structure {i} {structure.name}", structure.solid, colour, 1.0))
    return [
        surface_marker(name, solid.vertices_m, solid.faces, colour=colour, opacity=opacity, time_s=0.0)
        for name, solid, colour, opacity in named
    ]
