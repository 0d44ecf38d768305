"""A planner of one's own: it looks where the map is least sure.

From the command line, in the folder of this file:

    .venv/bin/sounding episode --scenario sphere --planner example_02_own_planner:LeastSure --planner-option n_drawn=200
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

import sounding


@dataclass(frozen=True, kw_only=True)
class LeastSure(sounding.Planner):
    """Ranks poses by p (1 - p), the variance of a label, summed over the points that their cone would see."""

    needs_belief = True
    n_drawn: int = 100
    """Poses that are looked at before each action."""

    def rank(self, situation: sounding.Situation) -> Iterator[int]:
        """Pose indices, best first."""
        poses = situation.rng.permutation(np.flatnonzero(situation.available(exclude_sensed=True)))
        drawn, others = poses[: self.n_drawn], poses[self.n_drawn :]
        doubts = np.array([doubt(situation, pose) for pose in drawn])
        yield from drawn[np.argsort(-doubts)].tolist()
        yield from others.tolist()


def doubt(situation: sounding.Situation, pose: int) -> float:
    """The sum of p (1 - p) over the points of the organ that lie in the cone of a pose."""
    assert situation.prediction is not None, "the planner says that it needs a belief"
    apex_m, axis = situation.workspace.positions_m[pose], situation.workspace.normals[pose]
    p = situation.prediction.probability[situation.cone.contains(situation.search_points_m, apex_m, axis)]
    return float(np.sum(p * (1.0 - p)))


def main() -> None:
    print(f"{'planner':<12} {'sensed':>7} {'AUPRC':>7}")
    for name, planner in {"least sure": LeastSure(), "random": "random"}.items():
        summary = sounding.run_episode(
            planner=planner,
            scenario="sphere",
            arm="none",
            steps=12,
            seed=3,
            out=f"renders/own-planner/{name.replace(' ', '-')}",
            overwrite=True,
            report=False,
            show_progress=False,
        )
        print(f"{name:<12} {summary['sensed_fraction']:>7.0%} {summary['auprc']:>7.3f}")


if __name__ == "__main__":
    main()
