"""OpenIGTLink: what cannot be right is refused, counted, and brings nothing down."""

import time

import numpy as np
import plain_igtl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from igtl_service import Served, igtl_string, proposed_ras_mm, sensed_sphere

pytest.importorskip("pyigtl")


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
        ("malformed", plain_igtl.packed("STRING", "Declined", igtl_string("__import__('os')"))),
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
