"""A finer map in a box of a coarser one: it learns what is sensed in and near the box, and answers inside it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .boxes import Box
from .hilbert_map import HilbertMap
from .labelled_points import LabelledPoints
from .lattice import Lattice
from .settings import InsetSettings


@dataclass(frozen=True, eq=False)
class Inset:
    """A box and its finer map."""

    box: Box
    fine: HilbertMap
    """A map of its own, changed in place; its hinges reach one spacing beyond the box."""
    answers: NDArray[np.intp]
    """Where its query points stand among those of the coarse map, ascending, shape (N,)."""

    def learn(self, reading: LabelledPoints) -> None:
        """Takes in the part of a reading that lies in the box or within a spacing of it."""
        near = self.box.holds(reading.points_m, self.fine.settings.hinge_spacing_m)
        if near.any():
            self.fine.update(reading.points_m[near], reading.is_occupied[near])

    def settle(self) -> None:
        """Fits its readings again: the first of them were taken in without knowing of the others."""
        if self.fine.settings.form != "diagonal":
            self.fine.revise()

    @classmethod
    def lay_in(cls, box: Box, coarse: HilbertMap, settings: InsetSettings) -> Inset | None:
        """The inset of a box without readings; None where it would be no finer or would answer for nothing.

        Args:
            box: Where it lies.
            coarse: The map that it is laid into.
            settings: How fine it is to be.
        """
        coarse_m = coarse.settings.hinge_spacing_m
        spacing_m = settings.hinge_spacing_m
        while True:
            hinges = Lattice.from_box(box.low_m - spacing_m, box.high_m + spacing_m, spacing_m=spacing_m)
            if hinges.n_points <= settings.max_hinges or spacing_m >= coarse_m:
                break
            spacing_m *= 1.1
        inside = coarse.query.part(box.low_m, box.high_m)
        if spacing_m >= coarse_m or inside is None:
            return None
        query, answers = inside
        own = replace(
            coarse.settings,
            hinge_spacing_m=spacing_m,
            # The kernel narrows with the spacing: gamma spacing^2 stays what it is in the coarse map.
            gamma_per_m2=coarse.settings.gamma_per_m2 * (coarse_m / spacing_m) ** 2,
            tolerance=max(settings.tolerance, coarse.settings.tolerance),
        )
        return cls(box, HilbertMap(hinges, own, query=query.lattice, query_mask=query.mask), answers)

    @classmethod
    def from_state(cls, box: Box, coarse: HilbertMap, state: Mapping[str, NDArray]) -> Inset:
        """The inset of a box whose finer map gave these arrays.

        Args:
            box: Where it lies.
            coarse: The map that it is laid into.
            state: What `HilbertMap.state` of its finer map returned.

        Raises:
            KeyError: If an array is missing.
            ValueError: If the arrays make no map, or one that answers for other points than the box holds.
        """
        fine, inside = HilbertMap.from_state(state), coarse.query.part(box.low_m, box.high_m)
        if inside is None or not np.array_equal(inside[0].points_m(), fine.query_points_m()):
            raise ValueError(
                f"a finer map answers for other points than the box {box.low} to {box.high} holds"
            )
        return cls(box, fine, inside[1])
