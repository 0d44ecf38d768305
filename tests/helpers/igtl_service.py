"""A service with its link on loopback, and what its tests send it."""

import struct
import threading
import time

import numpy as np
import plain_igtl
from plain_igtl import PlainClient

from mapping import MapSettings
from planner import make_planner
from sim.live.igtl.link import IgtlLink, LinkSettings
from sim.live.igtl.wire import WireSettings
from sim.live.patient_frame import PatientFrame
from sim.live.service import Service
from sim.live.session import Session

COARSE = MapSettings(hinge_spacing_m=0.02)


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


def igtl_string(text):
    return struct.pack(">HH", 3, len(text)) + text.encode()
