"""An arm in a session: its controller, who carries the probe, and what is heard of the outside beside it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from sim.live.arm.messages import trajectory_of
from sim.live.arm.tcp_controller import TcpController
from sim.live.arm.timed_path import TimedPath
from sim.live.errors import RefusedError
from sim.live.reports import Report, TipMoved
from sim.live.ros.link import RosLink
from sim.live.service import Service
from sim.running.parts import EpisodeParts

if TYPE_CHECKING:
    from sim.episode.setup import Setup
    from sim.live.arm.arm_carrier import ArmCarrier


def carrier_of(
    parts: EpisodeParts,
    setup: Setup,
    controller: TcpController,
    *,
    simulates: bool,
    ros: RosLink | None = None,
) -> ArmCarrier:
    """Who carries the probe of a setup, standing where the arm is.

    Args:
        parts: Speeds, and with `simulates` the sensor and the seed of the truth.
        setup: The setup with the arm.
        controller: Drives it.
        simulates: Whether a simulated sensor reads at the arm's true tip.
        ros: Shows the paths that the arm is sent.

    Raises:
        WorldError: The arm is another, or no way leads off from where it stands.
    """
    # Imported here, since they need MuJoCo, which a session without an arm does not.
    from sim.live.arm.arm_carrier import ArmCarrier
    from sim.live.simulated_probe import SimulatedProbe

    def show(path: TimedPath) -> None:
        if ros is not None:
            ros.publish_path(trajectory_of(path))

    if not simulates:
        return ArmCarrier(setup, setup.scene.new_data(), controller, parts.motion_settings, show=show)
    probe = SimulatedProbe(setup, parts.sensor, seed=parts.seed)
    return ArmCarrier(setup, probe.data, controller, parts.motion_settings, sense=probe.sense_here, show=show)


def without_tip(service: Service) -> Callable[[Report], None]:
    """What takes reports of the outside where the arm alone says where the tip is."""

    def submit(report: Report) -> None:
        if isinstance(report, TipMoved):
            raise RefusedError(
                "unknown", "nobody listens to a Tip: the arm's controller says where the tip is"
            )
        service.submit(report)

    return submit


def carry(carrier: ArmCarrier, service: Service, stop: threading.Event, rate_hz: float) -> Callable[[], None]:
    """Have an arm carry the probe, in a thread of its own, and return what waits for the arm's rest after `stop`.

    It waits for some seconds: a thread that still plans then finds `stop` set and the controller closed, and sends
    nothing.
    """
    thread = threading.Thread(
        target=carrier.serve, args=(service, stop), kwargs={"rate_hz": rate_hz}, daemon=True
    )
    thread.start()
    return lambda: thread.join(timeout=5.0)
