"""What is said over OpenIGTLink: snapshots as messages, and messages as reports. docs/live.md has the table."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from time import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mapping import Lattice

from ..errors import RefusedError
from ..mapped_tumour import tumour_surface
from ..patient_frame import PatientFrame
from ..reports import (
    MOST_LISTED,
    MOST_POINTS,
    PointsSensed,
    PoseDeclined,
    Report,
    TipMoved,
    points_of_image,
)
from ..snapshot import Snapshot
from .wire import RawMessage, igtl

TIP, LABELS, POINTS, DECLINED = "Tip", "Labels", "Points", "Declined"
"""Devices that are listened to."""
SENSED_TIP, PROPOSED, MAP, ORGAN, TUMOUR = (
    "SoundingTip",
    "SoundingProposed",
    "SoundingMap",
    "SoundingOrgan",
    "SoundingTumour",
)
STATUS, DECISION = "SoundingStatus", "SoundingDecision"
"""Devices that are sent."""
POINT_BYTES = 136
"""Bytes of a point in a message of points."""
STATUS_OK = 1
"""Code of a STATUS message that says that all is well."""
MAP_SCALE = 100
"""The map is sent as whole per cent."""
_GROUPS = {"tumour": True, "tumor": True, "free": False}
_BROKEN = (ValueError, KeyError, TypeError, IndexError, struct.error, NotImplementedError, OverflowError)
"""What pyigtl raises where a body is not what its type says."""


def transform_message(device: str, T_world: NDArray[np.float64], frame: PatientFrame) -> bytes:
    """A TRANSFORM of a pose in the world [m]."""
    return igtl().TransformMessage(frame.pose_ras_mm(T_world), device_name=device, timestamp=time()).pack()


def image_message(device: str, values: NDArray[Any], lattice: Lattice, frame: PatientFrame) -> bytes:
    """An IMAGE of values on a lattice, shape (X, Y, Z)."""
    T_world_index = np.eye(4)
    for axis, ticks_m in enumerate(lattice.axes_m):
        T_world_index[axis, axis] = ticks_m[1] - ticks_m[0]
        T_world_index[axis, 3] = ticks_m[0]
    return (
        igtl()
        .ImageMessage(
            np.ascontiguousarray(np.transpose(values)),
            ijk_to_world_matrix=frame.grid_ras_mm(T_world_index),
            world_coordinate_system="ras",
            device_name=device,
            timestamp=time(),
        )
        .pack()
    )


def surface_message(
    device: str, vertices_m: NDArray[np.float64], faces: NDArray[np.integer], frame: PatientFrame
) -> bytes:
    """A POLYDATA of a closed surface in the world [m]; vertices of shape (V, 3), faces (F, 3)."""
    cells = np.column_stack([np.full(len(faces), 3), faces]).astype(np.uint32).ravel()
    body = struct.pack("> 10I", len(vertices_m), 0, 0, 0, 0, len(faces), 4 * len(cells), 0, 0, 0)
    body += frame.points_ras_mm(vertices_m).astype(">f4").tobytes() + cells.astype(">u4").tobytes()
    return _packed("POLYDATA", device, body)


def status_message(device: str, code: int, name: str, text: str) -> bytes:
    """A STATUS: code, subcode 0, the name of the code, and a text."""
    body = struct.pack("> H q 20s", code, 0, name.encode("ascii", "replace")[:20])
    return _packed("STATUS", device, body + text.encode("ascii", "replace") + b"\0")


def string_message(device: str, text: str) -> bytes:
    """A STRING."""
    return igtl().StringMessage(text, device_name=device, timestamp=time()).pack()


def _packed(kind: str, device: str, body: bytes) -> bytes:
    """A message of a kind that pyigtl does not pack, or packs one number at a time."""
    message = igtl().messages.MessageBase(timestamp=time(), device_name=device)
    message._message_type, message._pack_content = kind, lambda: body
    return message.pack()


def messages_of(snapshot: Snapshot, frame: PatientFrame, *, with_organ: bool) -> Iterator[tuple[str, bytes]]:
    """The messages that show a snapshot, the pressing ones first, each with its device.

    Args:
        snapshot: What to show.
        frame: Where the patient lies.
        with_organ: Whether the organ's surface is sent too, which stays the same.
    """
    yield from pose_messages(snapshot, frame)
    decision = decision_of(snapshot, frame)
    yield DECISION, string_message(DECISION, json.dumps(decision))
    text = snapshot.note or f"{snapshot.n_sensed} sensed, advice: {decision['advice']}"
    yield STATUS, status_message(STATUS, STATUS_OK, "OK", text)
    if snapshot.probability is not None:
        per_cent = np.rint(snapshot.probability * MAP_SCALE).astype(np.uint8)
        yield MAP, image_message(MAP, per_cent, snapshot.query, frame)
        yield TUMOUR, surface_message(TUMOUR, *tumour_surface(snapshot.probability, snapshot.query), frame)
    if with_organ:
        yield ORGAN, surface_message(ORGAN, snapshot.organ.vertices_m, snapshot.organ.faces, frame)


def pose_messages(snapshot: Snapshot, frame: PatientFrame) -> Iterator[tuple[str, bytes]]:
    """The poses of a snapshot, which are sent again and again."""
    if snapshot.proposal is not None and snapshot.proposal.T_world_probe is not None:
        yield PROPOSED, transform_message(PROPOSED, snapshot.proposal.T_world_probe, frame)
    if snapshot.T_world_tip is not None:
        yield SENSED_TIP, transform_message(SENSED_TIP, snapshot.T_world_tip, frame)


def decision_of(snapshot: Snapshot, frame: PatientFrame) -> dict[str, Any]:
    """What was decided, as plain data: poses in RAS [mm]."""
    decision: dict[str, Any] = {"sensed": snapshot.n_sensed, "refused": snapshot.refused, "advice": "sense"}
    proposal = snapshot.proposal
    if proposal is not None:
        decision |= {
            "action": proposal.number,
            "pose": proposal.pose_index,
            "advice": proposal.advice,
            "confidence": proposal.confidence,
            "plan_s": proposal.plan_s,
        }
    if proposal is not None and proposal.T_world_probe is not None:
        T = frame.pose_ras_mm(proposal.T_world_probe)
        decision |= {"position_ras_mm": T[:3, 3].round(3).tolist(), "beam_ras": T[:3, 2].round(6).tolist()}
    return decision


def report_of(raw: RawMessage, frame: PatientFrame) -> Report:
    """What a message reports.

    Raises:
        RefusedError: It is broken, or nobody listens to it.
    """
    readers = {
        ("TRANSFORM", TIP): _tip,
        ("IMAGE", LABELS): _image,
        ("POINT", POINTS): _points,
        ("STRING", DECLINED): _declined,
    }
    reader = readers.get((raw.kind, raw.device))
    if reader is None:
        raise RefusedError("unknown", f"nobody listens to {raw.kind} {raw.device!r}")
    if raw.kind == "POINT" and len(raw.body) > MOST_LISTED * POINT_BYTES:
        raise RefusedError("too large", f"a message holds more than {MOST_LISTED} points")
    message = igtl().messages.MessageBase.create_message(raw.kind)
    fields = {"header_version": raw.version, "message_type": raw.kind, "device_name": raw.device}
    try:
        message.unpack(fields | {"timestamp": raw.stamp_s or 0.0}, raw.body)
        return reader(message, raw, frame)
    except RefusedError:
        raise
    except _BROKEN as error:
        raise RefusedError("malformed", f"the body of a {raw.kind} cannot be read ({error})") from error


def _tip(message: Any, raw: RawMessage, frame: PatientFrame) -> TipMoved:
    return TipMoved(T_world_probe=frame.pose_world_m(message.matrix), stamp_s=raw.stamp_s)


def _image(message: Any, raw: RawMessage, frame: PatientFrame) -> PointsSensed:
    image, T_index = message.image, message.ijk_to_world_matrix
    if image.ndim != 3 or image.dtype.kind not in "iu" or 0 in image.shape:
        raise RefusedError("malformed", "the image of labels has no whole numbers, one a voxel")
    if not np.isfinite(T_index).all() or abs(np.linalg.det(T_index[:3, :3])) < 1e-9:
        raise RefusedError("malformed", "the place of the image is none")
    T_ras_index = (
        T_index if message.world_coordinate_system == "ras" else np.diag([-1.0, -1.0, 1.0, 1.0]) @ T_index
    )
    return points_of_image(np.transpose(image), frame.grid_world_m(T_ras_index), stamp_s=raw.stamp_s)


def _points(message: Any, raw: RawMessage, frame: PatientFrame) -> PointsSensed:
    groups = [group.lower() for group in message.groups]
    if unknown := sorted(set(groups) - set(_GROUPS)):
        raise RefusedError("malformed", f"a point is of the group {unknown[0]!r}; groups are tumour and free")
    points_m = frame.points_world_m(np.array(message.positions, dtype=np.float64).reshape(-1, 3))
    is_occupied = np.array([_GROUPS[group] for group in groups], dtype=np.bool_)
    return PointsSensed(points_m=points_m, is_occupied=is_occupied, stamp_s=raw.stamp_s, most=MOST_POINTS)


def _declined(message: Any, raw: RawMessage, frame: PatientFrame) -> PoseDeclined:
    number, _, reason = message.string.strip().partition(" ")
    if not (number.isascii() and number.isdecimal() and len(number) < 8):
        raise RefusedError(
            "malformed", "a pose that is declined is named by its number, and a reason may follow"
        )
    return PoseDeclined(pose_index=int(number), reason=reason[:200], stamp_s=raw.stamp_s)
