"""A snapshot: how a session stands, for whoever shows it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mapping import Lattice
from sim.world.solids.solid import Solid

from .proposal import Proposal


@dataclass(frozen=True, eq=False, kw_only=True)
class Snapshot:
    """How things stand after an action."""

    n_sensed: int
    """Sensing actions so far."""
    T_world_tip: NDArray[np.float64] | None
    """Where the tip is, shape (4, 4) [m]; None where nobody has said."""
    proposal: Proposal | None
    """What is proposed; None where nothing is, as of a run that is only shown."""
    query: Lattice
    """The map's lattice, world frame."""
    probability: NDArray[np.float64] | None
    """Probability of tumour on the whole lattice, 0 outside the organ, shape (X, Y, Z); None without a map."""
    organ: Solid
    """The organ's surface, world frame [m]."""
    refused: dict[str, int]
    """How many messages were refused, by reason."""
    note: str = ""
    """What was last refused, as a sentence."""

    @property
    def wanted(self) -> tuple[int, int | None]:
        """How many actions there are, and from which pose the next is proposed; None where it is advised to end.

        A reading that was refused leads to a snapshot that wants the same as the one before.
        """
        proposal = self.proposal
        if proposal is None or proposal.advice != "sense":
            return self.n_sensed, None
        return self.n_sensed, proposal.pose_index

    def proposing(self, T_world_probe: NDArray[np.float64]) -> Snapshot:
        """The same with another pose proposed, shape (4, 4) [m], of which no more is known yet."""
        if self.proposal is None:
            return self
        return replace(self, proposal=replace(self.proposal, T_world_probe=T_world_probe))
