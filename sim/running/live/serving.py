"""The program behind `sounding serve`: a session with its folder and its link, and a simulated probe where wanted."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mapping import make_hilbert_map
from sim.episode.planned.planned_organ import PlannedOrgan, plan_organ
from sim.live.arm.tcp_controller import TcpController
from sim.live.igtl.link import IgtlLink, LinkSettings
from sim.live.igtl.wire import igtl
from sim.live.patient_frame import PatientFrame
from sim.live.reports import Report
from sim.live.ros.link import RosLink
from sim.live.service import Service, ServiceSettings
from sim.live.session import Session
from sim.live.session_folder import SessionFolder
from sim.live.snapshot import Snapshot
from sim.running.config import EpisodeConfig
from sim.running.config_file import inputs_of
from sim.running.fields import recorded
from sim.running.parts import EpisodeParts, make_parts

from .carrying import carrier_of, carry, without_tip

if TYPE_CHECKING:
    from sim.episode.setup import Setup
    from sim.live.arm.arm_carrier import ArmCarrier
    from sim.live.simulated_probe import SimulatedProbe

NOT_OF_A_SESSION = ("steps", "frames", "report", "keep_images", "rock_views")
"""Fields of an episode that a session has no use for, so that they do not decide whether it goes on."""


@dataclass(frozen=True, kw_only=True)
class Serving:
    """How a session is served."""

    folder: Path
    """Folder of the session; one that holds the same session goes on."""
    link: LinkSettings
    service: ServiceSettings
    simulates: bool = False
    """Whether a simulated probe takes the place of the outside."""
    speed: float = 1.0
    """How many times faster than a real probe the simulated one is; 0 jumps."""
    n_steps: int | None = None
    """Actions after which to end; None for never."""
    ros: tuple[str, int] | None = None
    """Host and port of a rosbridge that shows and reports too; None for none."""
    controller: tuple[str, int] | None = None
    """Host and port of the controller that drives the arm; None where somebody else carries the probe."""


class _Shown:
    """Whoever is shown what a service publishes."""

    def __init__(self, tell: Callable[[str], None], stop: threading.Event, n_steps: int | None) -> None:
        self.links: list[IgtlLink | RosLink] = []
        self._tell, self._stop, self._n_steps = tell, stop, n_steps

    def publish(self, snapshot: Snapshot) -> None:
        """Show a snapshot to all, and end after the last action."""
        for link in self.links:
            link.publish(snapshot)
        self._tell(_line(snapshot))
        if self._n_steps is not None and snapshot.n_sensed >= self._n_steps:
            self._stop.set()

    def publish_pose(self, T_world_probe: NDArray[np.float64]) -> None:
        """Show a pose as soon as it is known."""
        for link in self.links:
            link.publish_pose(T_world_probe)


def session_of(parts: EpisodeParts, organ: PlannedOrgan, folder: SessionFolder | None = None) -> Session:
    """The session of some parts.

    Args:
        parts: What an episode would be made of.
        organ: The organ of their scenario.
        folder: Keeps it.

    Raises:
        UsageError: The folder cannot be read.
    """
    return Session(
        organ,
        parts.planner,
        seed=parts.seed,
        map_settings=parts.map_settings,
        detail=parts.detail,
        trust=parts.trust,
        tumour_map=parts.make_map or make_hilbert_map,
        until_confident=parts.until_confident,
        miss_cost=parts.miss_cost,
        speeds=parts.motion_settings,
        folder=folder,
    )


def identity_of(config: EpisodeConfig, *, simulates: bool) -> dict[str, Any]:
    """What decides the proposals of a session, as plain data; simulated readings and real ones do not mix.

    Raises:
        UsageError: There is no such scenario, or a value is out of range.
    """
    told = {name: value for name, value in recorded(config).items() if name not in NOT_OF_A_SESSION}
    return {**told, "simulate": simulates, "inputs": inputs_of(config)}


def serve(config: EpisodeConfig, serving: Serving, tell: Callable[[str], None]) -> int:
    """Serve a session until its steps are done, and return how many actions it holds.

    Args:
        config: What the session plans and maps on; its arm is `none` unless a controller drives it.
        serving: How it is served.
        tell: Called with a sentence whenever something happened.

    Raises:
        UsageError, WorldError, PlannerError: Something cannot be done, for example for want of pyigtl.
        KeyboardInterrupt: Ctrl-C was pressed; all that was sensed is kept.
    """
    igtl()  # told before the organ is loaded
    parts, stop = make_parts(config), threading.Event()
    with ExitStack() as stack:
        controller = None
        if serving.controller is not None:
            controller = stack.enter_context(TcpController(*serving.controller))
        setup = _setup_of(parts) if serving.simulates or controller else None
        organ = setup or plan_organ(parts.scenario, parts.map_settings)
        folder = stack.enter_context(
            SessionFolder(serving.folder, identity_of(config, simulates=serving.simulates))
        )
        session = session_of(parts, organ, folder)
        if session.n_kept:
            tell(f"going on after {len(session.sensed)} actions in {serving.folder}")

        shown = _Shown(tell, stop, serving.n_steps)
        service = Service(session, shown.publish, serving.service, publish_pose=shown.publish_pose)
        link = stack.enter_context(_link(service, serving, PatientFrame(organ.T_world_organ)))
        ros = None if serving.ros is None else stack.enter_context(_ros_link(service, serving))
        shown.links += [link] if ros is None else [link, ros]
        tell(
            f"listening at {serving.link.host}:{link.server.port} (OpenIGTLink), written to {serving.folder}"
        )
        carrier: ArmCarrier | SimulatedProbe | None = None
        if setup is not None and controller is not None:
            carrier = carrier_of(parts, setup, controller, simulates=serving.simulates, ros=ros)
            stack.callback(carry(carrier, service, stop, serving.link.rate_hz))
        stack.callback(stop.set)
        if setup is not None and carrier is None:
            carrier = _flying(parts, setup, service, stop, serving)
        service.run(stop)
        if carrier is not None and carrier.error is not None:
            raise carrier.error
        return len(session.sensed)


def _link(service: Service, serving: Serving, frame: PatientFrame) -> IgtlLink:
    """The link of a service, which listens to what nobody else tells."""
    submit = _submit_of(service, serving)
    outside: dict[str, Any] = {} if submit is None else {"submit": submit}
    return IgtlLink(frame, serving.link, refuse=service.refuse, tip=service.tip, **outside)


def _ros_link(service: Service, serving: Serving) -> RosLink:
    assert serving.ros is not None
    host, port = serving.ros
    return RosLink(
        host,
        port,
        rate_hz=serving.link.rate_hz,
        submit=_submit_of(service, serving),
        refuse=service.refuse,
        tip=service.tip,
    )


def _submit_of(service: Service, serving: Serving) -> Callable[[Report], None] | None:
    """What takes reports of the outside; None where all is simulated."""
    if serving.simulates:
        return None
    return service.submit if serving.controller is None else without_tip(service)


def _setup_of(parts: EpisodeParts) -> Setup:
    # Imported here, since it needs MuJoCo, which a session does not.
    from sim.episode.setup import build_setup

    return build_setup(parts.scenario, parts.arm, parts.map_settings, probe=parts.probe)


def _flying(
    parts: EpisodeParts, setup: Setup, service: Service, stop: threading.Event, serving: Serving
) -> SimulatedProbe:
    """A simulated probe that flies in a thread of its own."""
    from sim.live.simulated_probe import Flight, SimulatedProbe

    probe = SimulatedProbe(setup, parts.sensor, seed=parts.seed)
    for pose in service.session.poses:
        probe.sense(service.session.pose_matrix(pose))  # the sensor's stream goes on where it was
    flight = Flight(rate_hz=serving.link.rate_hz, speed=serving.speed, settings=parts.motion_settings)
    threading.Thread(target=probe.serve, args=(service, stop, flight), daemon=True).start()
    return probe


def _line(snapshot: Snapshot) -> str:
    """How things stand, on a line."""
    proposal, text = snapshot.proposal, f"{snapshot.n_sensed} sensed"
    if proposal is not None:
        sure = "" if proposal.confidence is None else f", sure {proposal.confidence:.0%}"
        text += f"{sure}; next pose {proposal.pose_index}, advice {proposal.advice}"
    return f"{text}; {snapshot.note}" if snapshot.note else text
