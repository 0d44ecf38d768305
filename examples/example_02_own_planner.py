"""A planner of one's own: it looks where the map is least sure.

From the command line, beside this file:

    sounding episode --scenario sphere --planner example_02_own_planner:LeastSure --planner-option n_drawn=200
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import sounding


@dataclass(frozen=True, kw_only=True)
class LeastSure(sounding.Planner):
    """Ranks poses by the variance of the labels that their cone would return, p (1 - p) summed over its points."""

    needs_belief = True
    n_drawn: int = 60
    """Poses that are looked at before each action."""

    def rank(self, situation: sounding.Situation) -> Iterator[int]:
        """Pose indices, best first."""
        workspace, prediction = situation.workspace, situation.prediction
        assert prediction is not None
        p = prediction.probability
        taken = {*situation.sensed, *situation.skipped}
        poses = [i for i in situation.rng.permutation(workspace.n_poses).tolist() if i not in taken]
        gains = [
            np.sum(
                (p * (1.0 - p))[
                    situation.cone.contains(
                        situation.search_points_m, workspace.positions_m[i], workspace.normals[i]
                    )
                ]
            )
            for i in poses[: self.n_drawn]
        ]
        yield from (poses[k] for k in np.argsort(gains)[::-1])
        yield from poses[self.n_drawn :]


def main() -> None:
    for planner in (LeastSure(), "random"):
        summary = sounding.run_episode(
            scenario="spheres", planner=planner, arm="none", steps=6, seed=1, report=False,
            out="renders/own-planner", overwrite=True, show_progress=False,
        )  # fmt: skip
        print(
            f"{summary['planner']:<40} sensed {summary['sensed_fraction']:.0%}, AUPRC {summary['auprc']:.3f}"
        )


if __name__ == "__main__":
    main()
