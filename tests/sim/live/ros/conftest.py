"""A ball in the world, and a service of it on a rosbridge stand-in."""

import threading
import time

import pytest
import trimesh

pytest.importorskip("roslibpy")
pytest.importorskip("websockets")

from rosbridge_stand_in import RosbridgeStandIn

from mapping import MapSettings
from planner import make_planner
from sim.episode.planned.planned_organ import plan_organ
from sim.episode.scenario import Scenario
from sim.live.ros.link import RosLink
from sim.live.service import Service
from sim.live.session import Session

COARSE = MapSettings(hinge_spacing_m=0.02)


@pytest.fixture(scope="module")
def organ():
    """A ball of 50 mm."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    return plan_organ(Scenario(organ=ball, n_poses=200, score_spacing_m=0.01), COARSE)


@pytest.fixture
def bridge():
    bridge = RosbridgeStandIn()
    yield bridge
    bridge.close()


class OnTopics:
    """A service with its link to a bridge, in threads."""

    def __init__(self, organ, bridge):
        self.bridge, self.stop = bridge, threading.Event()
        self.session = Session(organ, make_planner("find-and-outline"), map_settings=COARSE)
        self.service = Service(self.session, lambda snapshot: self.link.publish(snapshot))
        self.link = RosLink(
            "127.0.0.1",
            bridge.port,
            submit=self.service.submit,
            refuse=self.service.refuse,
            tip=self.service.tip,
        )
        self.thread = threading.Thread(target=self.service.run, args=(self.stop,))
        self.thread.start()

    def wait_until(self, holds):
        deadline = time.monotonic() + 60.0
        while not holds():
            assert time.monotonic() < deadline, self.service.refused
            time.sleep(0.005)

    def close(self):
        self.stop.set()
        self.thread.join()
        self.link.close()


@pytest.fixture
def served(organ, bridge):
    served = OnTopics(organ, bridge)
    yield served
    served.close()
