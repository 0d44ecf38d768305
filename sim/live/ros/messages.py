"""ROS messages as plain data, in the field names of ROS 2; bytes are bytes. docs/ros.md has the table."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.colours import MAP, ORGAN, rgba

from ..errors import RefusedError
from ..mapped_tumour import tumour_surface
from ..reports import FREE, MOST_LISTED, MOST_POINTS, TUMOUR, PointsSensed, TipMoved
from ..snapshot import Snapshot

WORLD = "world"
"""The frame of all messages: the arm's base is its origin unless it was placed."""
NS = 1_000_000_000
TRIANGLE_LIST = 11
"""The type of a visualization_msgs/Marker that is a list of triangles."""
FLOAT32, UINT8 = 7, 2
"""Data types of a sensor_msgs/PointField."""
CLOUD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
SHOWN_FROM = 0.1
"""Points of the map whose probability is below this are left out of the cloud."""

Message = dict[str, Any]


def header(time_s: float) -> Message:
    """The header of a message of a time [s]."""
    ns = round(time_s * NS)
    return {"stamp": {"sec": ns // NS, "nanosec": ns % NS}, "frame_id": WORLD}


def pose(T: NDArray[np.float64]) -> Message:
    """A geometry_msgs/Pose of a rigid map, shape (4, 4)."""
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
    return {
        "position": dict(zip("xyz", T[:3, 3].tolist(), strict=True)),
        "orientation": {"x": x, "y": y, "z": z, "w": w},
    }


def pose_stamped(T_world: NDArray[np.float64], time_s: float) -> Message:
    """A geometry_msgs/PoseStamped."""
    return {"header": header(time_s), "pose": pose(T_world)}


def point_cloud(points_m: NDArray[np.float64], probability: NDArray[np.float64], time_s: float) -> Message:
    """A sensor_msgs/PointCloud2 of points with a probability each; points of shape (N, 3)."""
    names = ("x", "y", "z", "probability")
    rows = np.column_stack([points_m, probability]).astype("<f4")
    fields = [
        {"name": name, "offset": 4 * i, "datatype": FLOAT32, "count": 1} for i, name in enumerate(names)
    ]
    return {
        "header": header(time_s),
        "height": 1,
        "width": len(rows),
        "fields": fields,
        "is_bigendian": False,
        "point_step": 16,
        "row_step": 16 * len(rows),
        "data": rows.tobytes(),
        "is_dense": True,
    }


def surface_marker(
    name: str,
    vertices_m: NDArray[np.float64],
    faces: NDArray[np.integer],
    *,
    colour: str,
    opacity: float,
    time_s: float,
) -> Message:
    """A visualization_msgs/Marker of a surface; without triangles it takes the one that was there away."""
    red, green, blue, alpha = rgba(colour, opacity)
    corners = vertices_m[faces.reshape(-1)].tolist()
    return {
        "header": header(time_s),
        "ns": name,
        "id": 0,
        "type": TRIANGLE_LIST,
        "action": 0 if corners else 2,
        "pose": pose(np.eye(4)),
        "scale": {"x": 1.0, "y": 1.0, "z": 1.0},
        "color": {"r": red, "g": green, "b": blue, "a": alpha},
        "points": [{"x": x, "y": y, "z": z} for x, y, z in corners],
        "frame_locked": False,
    }


def joint_trajectory(trajectory: Message, time_s: float) -> Message:
    """A trajectory_msgs/JointTrajectory of a path's names and points."""
    points = [{"accelerations": [], "effort": []} | point for point in trajectory["points"]]
    return {"header": header(time_s), "joint_names": trajectory["joint_names"], "points": points}


def joint_state(names: Sequence[str], q: NDArray[np.float64], time_s: float) -> Message:
    """A sensor_msgs/JointState of positions alone."""
    return {
        "header": header(time_s), "name": list(names), "position": q.tolist(), "velocity": [], "effort": []
    }  # fmt: skip


def cloud_of(snapshot: Snapshot, time_s: float) -> Message | None:
    """The map of a snapshot, where it is not all but free; None without a map."""
    if snapshot.probability is None:
        return None
    is_shown = snapshot.probability >= SHOWN_FROM
    places = [axis[index] for axis, index in zip(snapshot.query.axes_m, np.nonzero(is_shown), strict=True)]
    return point_cloud(np.column_stack(places), snapshot.probability[is_shown], time_s)


def markers_of(snapshot: Snapshot, time_s: float) -> Message:
    """The surfaces of a snapshot: the organ's, and that about what the map takes for tumour."""
    organ = surface_marker(
        "organ", snapshot.organ.vertices_m, snapshot.organ.faces, colour=ORGAN, opacity=0.3, time_s=time_s
    )
    if snapshot.probability is None:
        return {"markers": [organ]}
    vertices_m, faces = tumour_surface(snapshot.probability, snapshot.query)
    tumour = surface_marker("map", vertices_m, faces, colour=MAP, opacity=1.0, time_s=time_s)
    return {"markers": [organ, tumour]}


def tip_of(message: Any) -> TipMoved:
    """The report of a geometry_msgs/PoseStamped.

    Raises:
        RefusedError: It is none, or in another frame.
    """
    stamp_s = _stamp_of(message)
    try:
        place, turn = message["pose"]["position"], message["pose"]["orientation"]
        quaternion = np.array([turn[axis] for axis in "xyzw"], dtype=np.float64)
        T = np.eye(4)
        T[:3, 3] = [place[axis] for axis in "xyz"]
        if not abs(np.linalg.norm(quaternion) - 1.0) < 1e-2:
            raise ValueError("its orientation is no unit quaternion")
        T[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    except (KeyError, TypeError, ValueError) as error:
        raise RefusedError("malformed", f"a pose cannot be read ({error})") from error
    return TipMoved(T_world_probe=T, stamp_s=stamp_s)


def points_of(message: Any) -> PointsSensed:
    """The report of a sensor_msgs/PointCloud2 whose points have a `label`: 0 not seen, 1 free, 2 tumour.

    Raises:
        RefusedError: It is none, too large, or in another frame.
    """
    stamp_s = _stamp_of(message)
    try:
        n_columns, n_rows = int(message["width"]), int(message["height"])
        # Rows without points cost nothing on the wire, and so are limited too.
        if max(n_columns, 1) * n_rows > MOST_LISTED:
            raise RefusedError("too large", f"a cloud holds more than {MOST_LISTED} points")
        rows = _rows_of(message)
        points_m = np.column_stack([rows[axis].astype(np.float64) for axis in "xyz"])
        labels = rows["label"]
    except RefusedError:
        raise
    except (KeyError, TypeError, ValueError, binascii.Error, OverflowError) as error:
        raise RefusedError("malformed", f"a cloud cannot be read ({error})") from error
    if not np.isin(labels, (0, FREE, TUMOUR)).all():
        raise RefusedError("malformed", f"labels are 0 not seen, {FREE} free, {TUMOUR} tumour")
    seen = np.flatnonzero(labels)
    return PointsSensed(
        points_m=points_m[seen], is_occupied=labels[seen] == TUMOUR, stamp_s=stamp_s, most=MOST_POINTS
    )


def _rows_of(message: Any) -> NDArray[Any]:
    """The points of a cloud as an array with a field for each of theirs."""
    order = ">" if message["is_bigendian"] else "<"
    fields = {field["name"]: field for field in message["fields"]}
    wanted = {name: fields[name] for name in ("x", "y", "z", "label")}
    kind = np.dtype(
        {
            "names": list(wanted),
            "formats": [order + CLOUD_TYPES[field["datatype"]] for field in wanted.values()],
            "offsets": [int(field["offset"]) for field in wanted.values()],
            "itemsize": int(message["point_step"]),
        }
    )
    data = message["data"]
    if not isinstance(data, str | bytes | list):
        raise TypeError("its data are no bytes")
    content = base64.b64decode(data, validate=True) if isinstance(data, str) else bytes(data)
    n, n_rows, row_step = (int(message[key]) for key in ("width", "height", "row_step"))
    if n < 0 or n_rows < 0 or len(content) != row_step * n_rows or row_step < n * kind.itemsize:
        raise ValueError("its data are not as many as it says")
    if n == 0:
        return np.empty(0, kind)
    rows = [np.frombuffer(content, kind, n, row * row_step) for row in range(n_rows)]
    return np.concatenate(rows) if rows else np.empty(0, kind)


def _stamp_of(message: Any) -> float | None:
    """The time of a message in our frame [s]; None where its header has none."""
    try:
        frame, stamp = message["header"]["frame_id"], message["header"]["stamp"]
        stamp_s = float(stamp["sec"]) + float(stamp["nanosec"]) / NS
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise RefusedError("malformed", f"a header cannot be read ({error})") from error
    if frame.lstrip("/") != WORLD if isinstance(frame, str) else True:
        raise RefusedError("wrong frame", f"a message is in the frame {frame!r}; the frame here is {WORLD}")
    return stamp_s or None


def for_bridge(message: Message) -> Message:
    """A message as rosbridge takes it, whose bytes are base64; of a cloud alone there are any."""
    if isinstance(message.get("data"), bytes):
        return message | {"data": base64.b64encode(message["data"]).decode("ascii")}
    return message
