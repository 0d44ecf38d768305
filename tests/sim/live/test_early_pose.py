"""A pose is told before the confidence is known, and the disk is waited for while the map learns."""

import threading
import time
from dataclasses import dataclass, field

import numpy as np
import plain_igtl
import pytest
from igtl_service import COARSE, proposed_ras_mm, sensed_sphere
from plain_igtl import PlainClient

from mapping.belief.dense_covariance import DenseCovariance
from planner import make_planner
from planner.find_and_outline.planner import FindAndOutline
from sim.live.igtl.link import IgtlLink, LinkSettings
from sim.live.patient_frame import PatientFrame
from sim.live.service import Service
from sim.live.session import Session
from sim.live.session_folder import SessionFolder
from sim.world.sensing.reading import Reading

pytest.importorskip("pyigtl")


@dataclass(frozen=True)
class Hesitant(FindAndOutline):
    """The default planner, whose confidence comes only when it is let."""

    may_tell: threading.Event = field(default_factory=threading.Event)

    def confidence(self, situation):
        assert self.may_tell.wait(60.0)
        return super().confidence(situation)


def reading_at(T_world_probe):
    """A reading of free points below a pose."""
    away = np.random.default_rng(0).uniform([-0.008, -0.008, 0.002], [0.008, 0.008, 0.06], (300, 3))
    points_m = away @ T_world_probe[:3, :3].T + T_world_probe[:3, 3]
    return Reading(points_m, away[:, 2] > 0.04, T_world_probe)


def test_a_pose_reaches_clients_while_the_confidence_is_still_to_come(organ) -> None:
    planner, stop = Hesitant(), threading.Event()
    planner.may_tell.set()
    frame, session = PatientFrame(organ.T_world_organ), Session(organ, planner, map_settings=COARSE)
    links = []
    service = Service(
        session,
        lambda snapshot: links[0].publish(snapshot),
        publish_pose=lambda T: links[0].publish_pose(T) if links else None,
    )
    with IgtlLink(
        frame,
        LinkSettings(port=0, rate_hz=100.0),
        submit=service.submit,
        refuse=service.refuse,
        tip=service.tip,
    ) as link:
        links.append(link)
        thread = threading.Thread(target=service.run, args=(stop,))
        thread.start()
        client = PlainClient(link.server.port)
        before = proposed_ras_mm(client)
        planner.may_tell.clear()
        image, T_image = sensed_sphere(before[:3, 3] + 25.0 * before[:3, 2])
        client.socket.sendall(plain_igtl.transform("Tip", before))
        client.socket.sendall(plain_igtl.image("Labels", image, T_image))
        # The planner still hesitates: nothing but the pose can have been told.
        _, body = client.wait_for(
            "SoundingProposed", lambda body: np.abs(plain_igtl.matrix_of(body) - before).max() > 1e-3
        )
        early = plain_igtl.matrix_of(body)
        assert service.published.n_sensed == 0
        again = [proposed_ras_mm(client) for _ in range(5)]
        assert all(np.array_equal(each, early) for each in again)
        planner.may_tell.set()
        deadline = time.monotonic() + 60.0
        while service.published.n_sensed == 0:
            assert time.monotonic() < deadline
        told = frame.pose_ras_mm(service.published.proposal.T_world_probe)
        np.testing.assert_allclose(early, told, atol=1e-3)
        client.close()
        stop.set()
        thread.join()


def test_poses_and_confidences_are_the_same_whether_poses_are_told_early_or_not(organ) -> None:
    runs = []
    for tells in (False, True):
        session, told, found = Session(organ, make_planner("find-and-outline"), map_settings=COARSE), [], []
        for _ in range(5):
            proposal = session.propose(told.append) if tells else session.propose()
            found.append((proposal.pose_index, proposal.confidence))
            session.observe(reading_at(proposal.T_world_probe))
        runs.append(found)
        if tells:
            assert len(told) == 5
            np.testing.assert_array_equal(told[-1], proposal.T_world_probe)
    assert runs[0] == runs[1]


def test_the_map_does_what_it_put_off_once_the_pose_is_told(organ, monkeypatch) -> None:
    heard, settle = [], DenseCovariance.settle

    def heard_settling(self):
        heard.append("settled" if self._owed else "nothing owed")
        settle(self)

    session = Session(organ, make_planner("find-and-outline"), map_settings=COARSE)
    session.observe(reading_at(session.propose().T_world_probe))
    monkeypatch.setattr(DenseCovariance, "settle", heard_settling)
    session.propose(lambda T: heard.append("told"))
    assert heard[:2] == ["told", "settled"]
    assert set(heard[2:]) <= {"nothing owed"}


def test_an_event_is_on_the_disk_when_it_was_observed_however_slow_the_disk_is(
    organ, tmp_path, monkeypatch
) -> None:
    append = SessionFolder.append

    def slowly(self, event):
        time.sleep(0.3)
        append(self, event)

    monkeypatch.setattr(SessionFolder, "append", slowly)
    with SessionFolder(tmp_path / "out", {}) as folder:
        session = Session(organ, make_planner("find-and-outline"), map_settings=COARSE, folder=folder)
        session.observe(reading_at(session.propose().T_world_probe))
        assert (tmp_path / "out" / "events" / "00001.npz").is_file()


def test_a_disk_that_is_full_is_told(organ, tmp_path, monkeypatch) -> None:
    def full(self, event):
        raise OSError(28, "No space left on device")

    with SessionFolder(tmp_path / "out", {}) as folder:
        session = Session(organ, make_planner("find-and-outline"), map_settings=COARSE, folder=folder)
        proposal = session.propose()
        monkeypatch.setattr(SessionFolder, "append", full)
        with pytest.raises(OSError, match="No space left"):
            session.observe(reading_at(proposal.T_world_probe))
