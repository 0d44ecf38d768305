"""ROS by a rosbridge stand-in on loopback: what is shown, what is learnt, and what is refused."""

import base64
import struct
import threading
import time
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from rosbridge_stand_in import RosbridgeStandIn

from sim.errors import FieldError
from sim.live.errors import RefusedError
from sim.live.reports import MOST_LISTED
from sim.live.ros.link import (
    LATCHED,
    MAP,
    MOST_UNSENT_BYTES,
    PATH,
    PROPOSED,
    REPORTED_POINTS,
    REPORTED_TIP,
    SURFACES,
    TIP,
    RosLink,
    unsent_bytes,
)
from sim.live.ros.messages import points_of, tip_of

SINGLE_M = 1e-7
"""Single precision holds places of some 0.5 m to 6e-8 m."""


def matrix_of(pose):
    """The matrix of a geometry_msgs/Pose, by the formula of a unit quaternion."""
    x, y, z, w = (pose["orientation"][axis] for axis in "xyzw")
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = [pose["position"][axis] for axis in "xyz"]
    return T


def header(stamp_s=None, frame="world"):
    stamp_s = time.time() if stamp_s is None else stamp_s
    return {"stamp": {"sec": int(stamp_s), "nanosec": int(stamp_s % 1.0 * 1e9)}, "frame_id": frame}


def cloud(points_m, labels, **changes):
    """A cloud as other programs make it: labels of 4 bytes before the places, and some padding."""
    data = b"".join(
        struct.pack("<Ifff4x", int(label), *point) for label, point in zip(labels, points_m, strict=True)
    )
    fields = [("label", 0, 6), ("x", 4, 7), ("y", 8, 7), ("z", 12, 7)]
    return {
        "header": header(), "height": 1, "width": len(labels), "is_bigendian": False, "point_step": 20,
        "row_step": len(data), "is_dense": True, "data": base64.b64encode(data).decode(),
        "fields": [{"name": name, "offset": at, "datatype": kind, "count": 1} for name, at, kind in fields],
    } | changes  # fmt: skip


def test_poses_map_and_surfaces_are_where_the_session_has_them(served, bridge, organ) -> None:
    bridge.wait_for(lambda own: {PROPOSED, MAP, SURFACES} <= own.latest.keys())
    snapshot = served.service.published
    assert bridge.advertised[PROPOSED] == "geometry_msgs/PoseStamped"
    message = bridge.latest[PROPOSED]
    assert message["header"]["frame_id"] == "world"
    np.testing.assert_allclose(matrix_of(message["pose"]), snapshot.proposal.T_world_probe, atol=1e-12)
    markers = {marker["ns"]: marker for marker in bridge.latest[SURFACES]["markers"]}
    corners = np.array([[point[axis] for axis in "xyz"] for point in markers["organ"]["points"]])
    np.testing.assert_allclose(corners, organ.organ.vertices_m[organ.organ.faces].reshape(-1, 3))
    assert markers["map"]["action"] == 2  # nothing is likely tumour yet: the marker is taken away


def test_a_reading_of_the_topics_is_learnt_and_the_map_shows_it(served, bridge) -> None:
    bridge.wait_for(lambda own: PROPOSED in own.latest)
    pose, rng = bridge.latest[PROPOSED]["pose"], np.random.default_rng(0)
    T = matrix_of(pose)
    places = rng.uniform([-0.008, -0.008, 0.002], [0.008, 0.008, 0.06], (400, 3)) @ T[:3, :3].T + T[:3, 3]
    labels = np.where((places - T[:3, 3]) @ T[:3, 2] > 0.02, 2, 1)
    bridge.publish(REPORTED_TIP, {"header": header(), "pose": pose})
    served.wait_until(lambda: served.service.tip() is not None)
    bridge.publish(REPORTED_POINTS, cloud(places, labels))
    served.wait_until(lambda: len(served.session.sensed) == 1)
    (reading,) = served.session.readings
    assert 0 < len(reading.points_m) <= 400
    served.wait_until(lambda: served.service.published.n_sensed == 1)
    probability = served.service.published.probability
    bridge.wait_for(lambda own: own.latest[MAP]["width"] == int((probability >= 0.1).sum()))
    message = bridge.latest[MAP]
    rows = np.frombuffer(base64.b64decode(message["data"]), "<f4").reshape(-1, 4)
    query = served.session.organ.query
    shown = query.points_m()[(probability >= 0.1).ravel()]
    np.testing.assert_allclose(rows[:, :3], shown, atol=SINGLE_M)
    np.testing.assert_allclose(rows[:, 3], probability[probability >= 0.1], atol=SINGLE_M)
    assert rows[:, 3].max() > 0.5
    bridge.wait_for(lambda own: own.latest[SURFACES]["markers"][1]["action"] == 0)
    np.testing.assert_allclose(matrix_of(bridge.latest[TIP]["pose"]), T, atol=1e-9)


def test_a_bridge_that_is_restarted_gets_all_that_is_latched_again(served, bridge) -> None:
    trajectory = {"joint_names": ["a"], "points": []}
    served.link.publish_path(trajectory)
    bridge.wait_for(lambda own: {PROPOSED, *LATCHED} <= own.latest.keys())
    bridge.drop_clients()
    bridge.wait_for(lambda own: {PROPOSED, *LATCHED} <= own.latest.keys())
    assert bridge.latest[PATH]["joint_names"] == ["a"]
    assert bridge.n_clients == 2
    bridge.wait_for(lambda own: {REPORTED_TIP, REPORTED_POINTS} <= own._subscribers.keys())


def test_what_is_published_while_all_is_sent_again_is_sent_last(bridge) -> None:
    paths = [{"joint_names": [name], "points": []} for name in ("old", "new")]
    with RosLink("127.0.0.1", bridge.port) as link:
        link._send(SURFACES, {"markers": []})
        link.publish_path(paths[0])
        bridge.wait_for(lambda own: {SURFACES, PATH} <= own.latest.keys())
        publishing = threading.Thread(target=link.publish_path, args=(paths[1],))
        send = link._topics[SURFACES].publish

        def sent_again(message) -> None:
            send(message)
            publishing.start()
            publishing.join(timeout=0.5)  # it may have to wait for what is being sent again

        link._topics[SURFACES].publish = sent_again
        bridge.drop_clients()
        bridge.wait_for(lambda own: own.counts.get(PATH) == 2)
    assert bridge.latest[PATH]["joint_names"] == ["new"]


def test_a_bridge_that_is_gone_is_looked_for_every_two_seconds(bridge) -> None:
    with RosLink("127.0.0.1", bridge.port) as link:
        factory, waits_s = link._ros.factory, []
        factory._open_connection = lambda: None
        for _ in range(8):
            factory._schedule_reconnect()
            waits_s.append(factory._reconnect_delay)
    assert max(waits_s) == 2.0


def test_a_bridge_that_hangs_is_sent_nothing_more(bridge) -> None:
    """The transport is the real one, whose socket the other side does not read."""
    with RosLink("127.0.0.1", bridge.port) as link:
        assert unsent_bytes(link._ros) == 0
        transport, sent = link._ros.factory._proto.transport, []
        link._topics[SURFACES].publish = sent.append
        waiting = [MOST_UNSENT_BYTES - 1, MOST_UNSENT_BYTES]
        transport.get_write_buffer_size = lambda: waiting[0]
        link._send(SURFACES, {"markers": []})
        waiting.reverse()
        link._send(SURFACES, {"markers": []})
        assert len(sent) == 1
        waiting[0] = 0


def test_what_cannot_be_right_is_refused_and_counted(served, bridge) -> None:
    bridge.wait_for(lambda own: PROPOSED in own.latest)
    pose = bridge.latest[PROPOSED]["pose"]
    flat = pose | {"orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0}}
    far = pose | {"position": {"x": 900.0, "y": 0.0, "z": 0.0}}
    one = np.zeros((1, 3))
    for topic, message, kind in (
        (REPORTED_TIP, {"header": header(frame="odom"), "pose": pose}, "wrong frame"),
        (REPORTED_TIP, {"header": header(), "pose": far}, "wrong frame"),
        (REPORTED_TIP, {"header": header(), "pose": flat}, "malformed"),
        (REPORTED_TIP, {"header": header(time.time() - 60.0), "pose": pose}, "stale"),
        (REPORTED_TIP, {}, "malformed"),
        (REPORTED_POINTS, cloud(one, [1]), "unusable"),
        (REPORTED_POINTS, cloud(one, [7]), "malformed"),
        (REPORTED_POINTS, cloud(one, [1], data="#"), "malformed"),
        (REPORTED_POINTS, cloud(one, [1], width=30_000), "too large"),
        (REPORTED_POINTS, cloud(one, [1], width=2), "malformed"),
        (REPORTED_POINTS, cloud(one, [1], fields=[]), "malformed"),
        (REPORTED_POINTS, cloud(one, [1], point_step=0), "malformed"),
    ):
        before = served.service.refused[kind]
        bridge.publish(topic, message)
        served.wait_until(lambda kind=kind, before=before: served.service.refused[kind] == before + 1)
    assert served.session.sensed == []


JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 2**40) | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=8,
)


@settings(deadline=None, max_examples=300)
@given(key=st.sampled_from(["header", "height", "width", "is_bigendian", "point_step", "row_step", "data", "fields"]),
       value=JSON)  # fmt: skip
def test_a_cloud_with_anything_in_a_field_is_read_or_refused(key, value) -> None:
    with suppress(RefusedError):
        points_of(cloud(np.zeros((2, 3)), [1, 2], **{key: value}))


SIZES = st.integers(-2, 3) | st.integers(2**31, 2**40) | st.floats() | st.text(max_size=2)


@settings(deadline=None, max_examples=300)
@given(width=SIZES, height=SIZES, row_step=SIZES, data=st.sampled_from(["", "AAAA"]) | SIZES)
@example(width=0, height=4_000_000_000, row_step=0, data="")
@example(width="ab", height=2**40, row_step=0, data="")
def test_a_cloud_of_any_sizes_is_read_or_refused(width, height, row_step, data) -> None:
    changes = {"width": width, "height": height, "row_step": row_step, "data": data}
    with suppress(RefusedError):
        points_of(cloud(np.zeros((2, 3)), [1, 2], **changes))


def test_rows_without_points_are_limited_as_points_are() -> None:
    empty = cloud(np.zeros((0, 3)), [])
    assert len(points_of(empty | {"height": MOST_LISTED}).points_m) == 0
    with pytest.raises(RefusedError, match="more than"):
        points_of(empty | {"height": MOST_LISTED + 1})


@settings(deadline=None, max_examples=300)
@given(message=JSON, key=st.sampled_from(["position", "orientation", "header", None]))
def test_a_pose_with_anything_in_it_is_read_or_refused(message, key) -> None:
    turn = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    whole = {"header": header(), "pose": {"position": {"x": 0, "y": 0, "z": 0}, "orientation": turn}}
    if key == "header":
        whole["header"] = message
    elif key is not None:
        whole["pose"][key] = message
    with suppress(RefusedError):
        tip_of(message if key is None else whole)


def test_a_bridge_that_is_not_there_is_told(monkeypatch) -> None:
    monkeypatch.setattr("sim.live.ros.link.PATIENCE_S", 0.3)
    free = RosbridgeStandIn()
    port = free.port
    free.close()
    with pytest.raises(FieldError, match=f"ws://127.0.0.1:{port}: no rosbridge answers there"):
        RosLink("127.0.0.1", port)
    with pytest.raises(FieldError, match="^live=ws"):
        RosLink("127.0.0.1", port, field="live")
