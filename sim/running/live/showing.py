"""Showing an episode to clients as it happens."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from sim.live.address import live_address

if TYPE_CHECKING:
    from sim.episode.episode import Episode
    from sim.episode.step import Step
    from sim.live.igtl.link import IgtlLink
    from sim.live.ros.link import RosLink
    from sim.live.snapshot import Snapshot


@contextmanager
def shown(episode: Episode, address: str | None) -> Iterator[Callable[[Step], None]]:
    """A context with what shows a step of an episode to all clients at an address; nothing where there is none.

    Args:
        episode: The episode.
        address: Where clients come to, such as `igtl://127.0.0.1:18944`, or a rosbridge is, such as
            `ws://127.0.0.1:9090`; None shows it to nobody.

    Raises:
        MissingPackageError, UsageError: The address cannot be listened at.
    """
    if address is None:
        yield lambda step: None
        return
    with _link(episode, address) as link:
        link.publish(_snapshot(episode, None))
        yield lambda step: link.publish(_snapshot(episode, step))


def _link(episode: Episode, address: str) -> IgtlLink | RosLink:
    # Imported here, since hardly any run is shown.
    from sim.live.igtl.link import IgtlLink, LinkSettings
    from sim.live.patient_frame import PatientFrame
    from sim.live.ros.link import RosLink

    kind, host, port = live_address(address, "live")
    if kind == "ws":
        return RosLink(host, port, field="live")
    return IgtlLink(PatientFrame(episode.setup.T_world_organ), LinkSettings(host=host, port=port))


def _snapshot(episode: Episode, step: Step | None) -> Snapshot:
    """How an episode stands after a step; before the first one where that is None."""
    from sim.live.snapshot import Snapshot

    probability = None
    if episode.prediction is not None:
        probability = episode.setup.on_lattice(episode.prediction.probability, outside=0.0)
    return Snapshot(
        n_sensed=0 if step is None else step.step,
        T_world_tip=None if step is None else step.reading.T_world_probe,
        proposal=None,
        query=episode.setup.query,
        probability=probability,
        organ=episode.setup.organ,
        refused={},
        note="" if step is None else f"action {step.step}: pose {step.pose_index}",
    )
