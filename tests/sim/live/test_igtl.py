"""OpenIGTLink: clients get what is known, what they report is learnt, and whatever else they send is refused."""

import json
import struct
import threading
import time

import numpy as np
import plain_igtl
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_igtl import PlainClient

from mapping import MapSettings
from planner import make_planner
from sim.episode.planned.planned_organ import plan_organ
from sim.episode.scenario import Scenario
from sim.live.igtl.link import IgtlLink, LinkSettings
from sim.live.igtl.wire import WireSettings
from sim.live.patient_frame import PatientFrame
from sim.live.service import Service
from sim.live.session import Session

pyigtl = pytest.importorskip("pyigtl")
COARSE = MapSettings(hinge_spacing_m=0.02)
SINGLE_MM = 1e-3
"""A thousandth of a millimetre: single precision holds some 100 mm to 1e-5 mm, which a turn multiplies."""


@pytest.fixture(scope="module")
def organ():
    """A ball of 50 mm that lies elsewhere, and turned, in the patient."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    ball.apply_translation([0.1, -0.2, 0.3])
    scenario = Scenario(organ=ball, n_poses=200, score_spacing_m=0.01, organ_turn_rad=(0.2, -0.1, 0.5))
    return plan_organ(scenario, COARSE)


class Served:
    """A service with its link, in threads."""

    def __init__(self, organ, **settings):
        self.session = Session(organ, make_planner("find-and-outline"), map_settings=COARSE)
        self.frame = PatientFrame(organ.T_world_organ)
        self.stop = threading.Event()
        self.service = Service(self.session, lambda snapshot: self.link.publish(snapshot))
        wire = WireSettings(most_bytes=2**20, patience_s=0.5)
        self.link = IgtlLink(
            self.frame,
            LinkSettings(port=0, rate_hz=50.0, wire=wire, **settings),
            submit=self.service.submit,
            refuse=self.service.refuse,
            tip=self.service.tip,
        )
        self.thread = threading.Thread(target=self.service.run, args=(self.stop,))
        self.thread.start()

    def client(self):
        return PlainClient(self.link.server.port)

    def close(self):
        self.stop.set()
        self.thread.join()
        self.link.close()

    def wait_until(self, holds):
        deadline = time.monotonic() + 20.0
        while not holds():
            assert time.monotonic() < deadline, self.service.refused
            time.sleep(0.005)


@pytest.fixture
def served(organ):
    served = Served(organ)
    yield served
    served.close()


def proposed_ras_mm(client):
    return plain_igtl.matrix_of(client.wait_for("SoundingProposed")[1])


def sensed_sphere(centre_ras_mm, n=9):
    """A labelled image about a place in RAS: seen in a cube, tumour within 10 mm of its middle."""
    axis = np.linspace(-20.0, 20.0, n)
    T = np.eye(4)
    T[:3, :3] *= axis[1] - axis[0]
    T[:3, 3] = centre_ras_mm - 20.0
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    return np.where(x**2 + y**2 + z**2 <= 100.0, 2, 1).astype(np.uint8), T


def test_frames_take_the_patients_millimetres_to_metres_of_the_world_and_back(organ):
    frame = PatientFrame(organ.T_world_organ)
    # By hand: the middle of the ball is at LPS (0.1, -0.2, 0.3) m, which is RAS (-100, 200, 300) mm.
    middle_m = np.mean(organ.organ.bounds_m, axis=0)
    np.testing.assert_allclose(frame.points_ras_mm(middle_m[None])[0], [-100.0, 200.0, 300.0], atol=0.3)
    T_lps = np.eye(4)
    T_lps[:3, 3] = [0.01, 0.02, 0.03]
    T_ras = frame.pose_ras_mm(organ.T_world_organ @ T_lps)
    np.testing.assert_allclose(T_ras[:3, 3], [-10.0, -20.0, 30.0], atol=1e-9)
    np.testing.assert_allclose(T_ras[:3, :3], np.diag([-1.0, -1.0, 1.0]), atol=1e-12)
    np.testing.assert_allclose(frame.pose_world_m(T_ras), organ.T_world_organ @ T_lps, atol=1e-12)
    points_m = np.random.default_rng(0).normal(size=(5, 3))
    np.testing.assert_allclose(frame.points_world_m(frame.points_ras_mm(points_m)), points_m, atol=1e-12)
    T_index = frame.grid_ras_mm(np.diag([0.003, 0.004, 0.005, 1.0]))
    np.testing.assert_allclose(np.linalg.norm(T_index[:3, :3], axis=0), [3.0, 4.0, 5.0], atol=1e-9)
    np.testing.assert_allclose(frame.grid_world_m(T_index), np.diag([0.003, 0.004, 0.005, 1.0]), atol=1e-12)


def test_a_client_by_the_letter_reads_poses_map_and_surface_where_they_are(served, organ):
    client = served.client()
    got = {}
    while len(got) < 6:
        kind, device, body = client.receive()
        got[device] = (kind, body)
    assert {device: kind for device, (kind, _) in got.items()} == {
        "SoundingProposed": "TRANSFORM",
        "SoundingDecision": "STRING",
        "SoundingStatus": "STATUS",
        "SoundingMap": "IMAGE",
        "SoundingTumour": "POLYDATA",
        "SoundingOrgan": "POLYDATA",
    }
    proposal = served.service.published.proposal
    T = plain_igtl.matrix_of(got["SoundingProposed"][1])
    np.testing.assert_allclose(served.frame.pose_world_m(T), proposal.T_world_probe, atol=SINGLE_MM * 1e-3)
    values, T_index = plain_igtl.image_of(got["SoundingMap"][1])
    probability = served.service.published.probability
    np.testing.assert_array_equal(values, np.rint(probability * 100).astype(np.uint8))
    corner_m = served.frame.grid_world_m(T_index) @ [*(n - 1 for n in values.shape), 1.0]
    np.testing.assert_allclose(corner_m[:3], organ.query.points_m()[-1], atol=SINGLE_MM * 1e-3)
    places, faces = plain_igtl.surface_of(got["SoundingOrgan"][1])
    np.testing.assert_allclose(
        served.frame.points_world_m(places), organ.organ.vertices_m, atol=SINGLE_MM * 1e-3
    )
    np.testing.assert_array_equal(faces, organ.organ.faces)
    code, subcode = struct.unpack(">Hq", got["SoundingStatus"][1][:10])
    assert (code, subcode) == (1, 0)
    text = got["SoundingDecision"][1]
    decision = json.loads(text[4 : 4 + struct.unpack(">H", text[2:4])[0]])
    assert decision["pose"] == proposal.pose_index
    np.testing.assert_allclose(decision["position_ras_mm"], T[:3, 3], atol=1e-3)
    client.close()


def test_pyigtls_client_reads_the_same(served):
    client = pyigtl.OpenIGTLinkClient(port=served.link.server.port)
    message = client.wait_for_message("SoundingProposed", timeout=20)
    T = served.frame.pose_world_m(message.matrix)
    np.testing.assert_allclose(T, served.service.published.proposal.T_world_probe, atol=SINGLE_MM * 1e-3)
    shown = client.wait_for_message("SoundingMap", timeout=20)
    assert shown.world_coordinate_system == "ras"
    assert shown.image.shape == served.session.organ.query.shape[::-1]
    client.stop()


@pytest.mark.parametrize("is_lps", [False, True])
def test_a_labelled_image_is_learnt_where_it_lies_and_the_next_pose_follows(organ, is_lps):
    served = Served(organ)
    client = served.client()
    T_tip = proposed_ras_mm(client)
    labels, T_ras = sensed_sphere(T_tip[:3, 3] + 25.0 * T_tip[:3, 2])
    T_index = np.diag([-1.0, -1.0, 1.0, 1.0]) @ T_ras if is_lps else T_ras
    client.socket.sendall(plain_igtl.transform("Tip", T_tip))
    client.socket.sendall(plain_igtl.image("Labels", labels, T_index, is_lps=is_lps))
    served.wait_until(lambda: served.session.sensed)
    served.wait_until(lambda: served.service.published.n_sensed == 1)
    assert served.service.refused == {}
    learnt = served.session.readings[0]
    tumour_ras = served.frame.points_ras_mm(learnt.points_m[learnt.is_occupied])
    off_mm = np.linalg.norm(tumour_ras - (T_tip[:3, 3] + 25.0 * T_tip[:3, 2]), axis=1)
    assert off_mm.max() < 10.0 + SINGLE_MM
    assert organ.organ.contains(learnt.points_m).all()
    assert len(learnt.points_m) > 100
    sensed_mm = plain_igtl.matrix_of(client.wait_for("SoundingTip")[1])
    np.testing.assert_allclose(sensed_mm, T_tip, atol=SINGLE_MM)
    places, _ = plain_igtl.surface_of(
        client.wait_for("SoundingTumour", lambda body: struct.unpack(">I", body[:4])[0] > 0)[1]
    )
    # The map's tumour lies where the image had it, to a cell of this coarse map.
    np.testing.assert_allclose(places.mean(axis=0), T_tip[:3, 3] + 25.0 * T_tip[:3, 2], atol=10.0)
    client.close()
    served.close()


def test_points_are_learnt_and_a_declined_pose_is_not_proposed_again(served):
    client = served.client()
    T_tip = proposed_ras_mm(client)
    first = served.service.published.proposal.pose_index
    client.socket.sendall(plain_igtl.packed("STRING", "Declined", _string(f"{first} a rib is in the way")))
    served.wait_until(lambda: first in served.session.declined)
    assert served.session.declined[first] == "a rib is in the way"
    served.wait_until(lambda: served.service.published.proposal.pose_index != first)
    middle = T_tip[:3, 3] + 25.0 * T_tip[:3, 2]
    places = middle + np.random.default_rng(0).uniform(-10.0, 10.0, (50, 3))
    client.socket.sendall(plain_igtl.transform("Tip", T_tip))
    client.socket.sendall(plain_igtl.points("Points", places, ["tumour"] * 20 + ["free"] * 30))
    served.wait_until(lambda: len(served.session.readings) == 1)
    assert int(served.session.readings[0].is_occupied.sum()) == 20
    client.close()


def _string(text):
    return struct.pack(">HH", 3, len(text)) + text.encode()


def test_what_cannot_be_right_is_refused_by_its_reason_and_changes_nothing(served):
    client = served.client()
    T_tip = proposed_ras_mm(client)
    far, mirrored, scaled = T_tip.copy(), T_tip.copy(), T_tip.copy()
    far[:3, 3] += 1e5
    mirrored[:3, 0] *= -1.0
    scaled[:3, :3] *= 1.1
    labels, T_index = sensed_sphere(T_tip[:3, 3])
    now = time.time()
    bad = [
        ("unusable", plain_igtl.image("Labels", labels, T_index)),  # no tip yet
        ("wrong frame", plain_igtl.transform("Tip", far)),
        ("wrong frame", plain_igtl.transform("Tip", mirrored)),
        ("wrong frame", plain_igtl.transform("Tip", scaled)),
        ("malformed", plain_igtl.transform("Tip", np.full((4, 4), np.nan))),
        ("malformed", plain_igtl.transform("Tip", T_tip, crc=1)),
        ("malformed", plain_igtl.packed("TRANSFORM", "Tip", b"short")),
        ("stale", plain_igtl.transform("Tip", T_tip, stamp_s=now - 60.0)),
        ("stale", plain_igtl.transform("Tip", T_tip, stamp_s=now + 60.0)),
        ("unknown", plain_igtl.transform("Needle", T_tip)),
        ("unknown", plain_igtl.packed("GET_CAPABIL", "", b"")),
        ("malformed", plain_igtl.packed("STRING", "Declined", _string("__import__('os')"))),
        ("malformed", plain_igtl.points("Points", T_tip[None, :3, 3], ["bone"])),
        ("malformed", plain_igtl.image("Labels", labels + 5, T_index)),
    ]
    for kind, message in bad:
        before = served.service.refused[kind]
        client.socket.sendall(message)
        served.wait_until(lambda kind=kind, before=before: served.service.refused[kind] == before + 1)
    assert served.service.tip() is None
    # The one client has been served all along, and what is right is still taken.
    client.socket.sendall(plain_igtl.transform("Tip", T_tip))
    client.wait_for("SoundingTip")
    assert served.session.n_kept == 0
    client.close()


def test_a_tip_that_is_older_than_the_last_is_refused(served):
    client = served.client()
    T_tip, now = proposed_ras_mm(client), time.time()
    client.socket.sendall(plain_igtl.transform("Tip", T_tip, stamp_s=now))
    client.wait_for("SoundingTip")
    client.socket.sendall(plain_igtl.transform("Tip", T_tip, stamp_s=now - 0.5))
    served.wait_until(lambda: served.service.refused["stale"] == 1)
    client.close()


def test_a_body_that_is_too_large_cuts_its_client_off_and_nobody_else(served):
    good, greedy = served.client(), served.client()
    greedy.socket.sendall(plain_igtl.packed("IMAGE", "Labels", b"", size=2**40))
    served.wait_until(lambda: served.service.refused["too large"] == 1)
    with pytest.raises(ConnectionError):
        greedy.wait_for("no device")
    good.wait_for("SoundingProposed")
    good.close()


def test_a_client_that_never_reads_holds_up_nobody(served):
    lazy, good = served.client(), served.client()
    for _ in range(3):
        good.wait_for("SoundingProposed")
    # All that waits for the lazy one is one message a device.
    assert all(len(client._pending) <= 7 for client in served.link.server._clients)
    lazy.close()
    good.close()


def test_clients_come_and_go(served):
    for _ in range(5):
        client = served.client()
        client.wait_for("SoundingOrgan")
        client.close()
    served.wait_until(lambda: served.link.server.n_clients == 0)


VALID = plain_igtl.transform("Tip", np.eye(4), stamp_s=0.0)


@st.composite
def broken_messages(draw):
    """Noise, a header with noise behind it, or a right message with some bytes changed, cut or doubled."""
    kind = draw(st.sampled_from(["noise", "header", "changed", "body"]))
    if kind == "noise":
        return draw(st.binary(min_size=1, max_size=300))
    if kind == "header":
        names = st.sampled_from(["TRANSFORM", "IMAGE", "POINT", "STRING", "POLYDATA", "X", "\x07"])
        size = draw(st.integers(0, 2**64 - 1) | st.integers(0, 200))
        return plain_igtl.packed(draw(names), "Labels", draw(st.binary(max_size=200)), stamp_s=0.0, size=size)
    if kind == "body":
        # The checksum is right, the content is not.
        pairs = [("IMAGE", "Labels"), ("POINT", "Points"), ("STRING", "Declined"), ("TRANSFORM", "Tip")]
        body = draw(st.binary(max_size=300))
        return plain_igtl.packed(*draw(st.sampled_from(pairs)), body, stamp_s=0.0)
    message = bytearray(VALID)
    for _ in range(draw(st.integers(1, 6))):
        message[draw(st.integers(0, len(message) - 1))] = draw(st.integers(0, 255))
    return bytes(message[: draw(st.integers(1, len(message)))])


def test_no_bytes_bring_the_service_down(organ):
    served = Served(organ)
    n_bad = 0

    @settings(max_examples=150, database=None, derandomize=True, deadline=None)
    @given(broken_messages())
    def fuzz(message):
        nonlocal n_bad
        client = served.client()
        client.socket.sendall(message)
        client.end()
        n_bad += 1

    fuzz()
    served.wait_until(lambda: served.link.server.n_clients == 0)
    assert served.thread.is_alive()
    assert served.session.n_kept == 0
    # Nearly all are told apart from a message; a changed time stamp or a pose that is still one are not broken.
    assert sum(served.service.refused.values()) > 0.5 * n_bad
    client = served.client()
    client.socket.sendall(plain_igtl.transform("Tip", proposed_ras_mm(client)))
    client.wait_for("SoundingTip")
    client.close()
    served.close()
