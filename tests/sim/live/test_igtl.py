"""OpenIGTLink: clients get what is known, and what they report is learnt."""

import json
import struct
import time

import numpy as np
import plain_igtl
import pytest
from igtl_service import Served, igtl_string, proposed_ras_mm, sensed_sphere

from sim.live.igtl.server import IgtlServer
from sim.live.patient_frame import PatientFrame

pyigtl = pytest.importorskip("pyigtl")
SINGLE_MM = 1e-3
"""A thousandth of a millimetre: single precision holds some 100 mm to 1e-5 mm, which a turn multiplies."""


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
    client.socket.sendall(
        plain_igtl.packed("STRING", "Declined", igtl_string(f"{first} a rib is in the way"))
    )
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


def test_a_client_that_never_reads_holds_up_nobody(served):
    lazy, good = served.client(), served.client()
    for _ in range(3):
        good.wait_for("SoundingProposed")
    # All that waits for the lazy one is one message a device.
    assert all(len(client._pending) <= 7 for client in served.link.server._clients)
    lazy.close()
    good.close()


def test_what_was_published_last_reaches_clients_before_the_server_leaves():
    server = IgtlServer(lambda message: None, lambda error: None, port=0)
    client = plain_igtl.PlainClient(server.port)
    deadline = time.monotonic() + 60.0
    while server.n_clients == 0:
        assert time.monotonic() < deadline
    large = "x" * 60_000
    for number in range(5):
        server.publish(f"Text{number}", plain_igtl.packed("STRING", f"Text{number}", igtl_string(large)))
    server.close()
    _, body = client.wait_for("Text4")
    assert len(body) > len(large)
    client.close()


def test_clients_come_and_go(served):
    for _ in range(5):
        client = served.client()
        client.wait_for("SoundingOrgan")
        client.close()
    served.wait_until(lambda: served.link.server.n_clients == 0)
