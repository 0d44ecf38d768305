"""The comparison of contenders, case by case: the score of each, and how pairs do on the same seeds."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim.episode.measures import SENSED_GOAL

from .estimates import (
    Interval,
    MeanEstimate,
    PairedEstimate,
    mean_estimate,
    median_with_interval,
    paired_estimate,
)
from .lesions.scores import LesionScore, lesion_scores
from .trial_groups import TrialGroup


@dataclass(frozen=True)
class Measure:
    """A measure by which contenders are compared."""

    key: str
    """Column of the trials' rows that holds it."""
    label: str
    """What tables and figures call it."""
    lower_is_better: bool
    form: str = "{:.1f}"
    """Format of its values."""
    after_equal_steps: bool = False
    """Whether it compares only episodes that were not stopped by what they had sensed, or by their planner."""


STOPS = ("until_sensed", "until_confident", "miss_cost")
"""Options by which an episode may end before its last action."""
SENSINGS = Measure("sensings_to_95", "sensings to 95 %", True)
MEASURES = (
    SENSINGS,
    Measure("auprc", "AUPRC", False, "{:.3f}", after_equal_steps=True),
    Measure("sensed_fraction", "share sensed", False, "{:.3f}", after_equal_steps=True),
    Measure("dice", "Dice", False, "{:.3f}", after_equal_steps=True),
    Measure("lesions_found_fraction", "share of lesions found", False, "{:.3f}", after_equal_steps=True),
    Measure("n_false_findings", "false findings a run", True, "{:.2f}", after_equal_steps=True),
    Measure("log_loss", "log loss", True, "{:.4f}", after_equal_steps=True),
    Measure("expected_calibration_error", "calibration error", True, "{:.4f}", after_equal_steps=True),
    Measure("joint_travel_rad", "joint travel [rad]", True),
    Measure("tip_path_m", "tip path [m]", True, "{:.2f}"),
    Measure("procedure_s", "procedure [s]", True),
    Measure("n_skipped_poses", "poses skipped", True, "{:.2f}"),
)


@dataclass(frozen=True)
class Score:
    """The score of a contender by a measure."""

    case: str
    contender: str
    measure: Measure
    estimate: MeanEstimate
    """Estimate of the mean, which is restricted to the horizon where some contender of the case never got there."""
    median: float
    """Median of the trials; infinite where half of them never got there."""
    median_interval: Interval
    n_never: int
    """Number of trials that never got there, which count with the horizon in the restricted mean."""
    n_failed: int
    """Number of trials without a result, which the other figures leave out."""
    horizon: float
    """Number of actions after which the mean counts nothing; infinite where all trials got there."""


@dataclass(frozen=True)
class Pairing:
    """How a contender does against another by a measure."""

    case: str
    first: str
    second: str
    measure: Measure
    estimate: PairedEstimate


@dataclass(frozen=True, eq=False)
class Comparison:
    """All scores and pairings."""

    groups: tuple[TrialGroup, ...]
    scores: tuple[Score, ...]
    pairings: tuple[Pairing, ...]
    lesions: tuple[LesionScore, ...] = ()
    """What became of the lesions, of contenders whose trials tell of it."""

    @property
    def cases(self) -> list[str]:
        """The cases, in order."""
        return list(dict.fromkeys(group.case for group in self.groups))

    def groups_of(self, case: str) -> list[TrialGroup]:
        """The groups of a case."""
        return [group for group in self.groups if group.case == case]

    def score(self, case: str, contender: str, key: str) -> Score | None:
        """The score of a contender by a measure; None where the measure does not apply."""
        for score in self.scores:
            if (score.case, score.contender, score.measure.key) == (case, contender, key):
                return score
        return None


def compare_groups(groups: Sequence[TrialGroup], *, reference: str | None = None) -> Comparison:
    """The scores of all contenders and of all pairs of them.

    Args:
        groups: Groups that `load_groups` made.
        reference: Contender with which all others are paired; None for all pairs.
    """
    scores: list[Score] = []
    pairings: list[Pairing] = []
    for case in dict.fromkeys(group.case for group in groups):
        of_case = [group for group in groups if group.case == case]
        for measure in MEASURES:
            scored = [group for group in of_case if _applies(measure, group)]
            horizon = horizon_of(scored) if measure is SENSINGS else math.inf
            scores += [_score(group, measure, horizon) for group in scored]
            pairings += _pairings(scored, measure, horizon, reference)
    return Comparison(tuple(groups), tuple(scores), tuple(pairings), tuple(lesion_scores(groups)))


def horizon_of(groups: Sequence[TrialGroup]) -> float:
    """The fewest actions after which a trial of any contender was given up without getting there; infinite without one.

    Beyond it nothing is known about that contender, so the restricted means of all count up to here. A trial that its
    planner ended, or that had no pose left, was given up where it ended.
    """
    lacking = [
        group.values("n_sensings")[np.isinf(group.sensings_to_95())] for group in groups if group.entries
    ]
    return float(min((ended.min() for ended in lacking if ended.size), default=math.inf))


def measured(group: TrialGroup, measure: Measure, horizon: float) -> NDArray[np.float64]:
    """The values of a group by a measure, cut at the horizon, shape (n,)."""
    if measure is SENSINGS:
        return np.minimum(group.sensings_to_95(), horizon)
    return group.values(measure.key)


def _applies(measure: Measure, group: TrialGroup) -> bool:
    if not group.entries or (
        measure.after_equal_steps and any(group.setting(name) is not None for name in STOPS)
    ):
        return False
    if measure is SENSINGS:
        goal = group.setting("until_sensed")
        return (goal is None or goal >= SENSED_GOAL) and _is_defined(group.values("sensed_fraction"))
    values = group.values(measure.key)
    return _is_defined(values) and (measure.key != "n_skipped_poses" or bool(values.any()))


def _is_defined(values: NDArray[np.float64]) -> bool:
    return bool(np.isfinite(values).all())


def _score(group: TrialGroup, measure: Measure, horizon: float) -> Score:
    values = group.sensings_to_95() if measure is SENSINGS else group.values(measure.key)
    median, median_interval = median_with_interval(values)
    return Score(
        case=group.case,
        contender=group.contender,
        measure=measure,
        estimate=mean_estimate(measured(group, measure, horizon)),
        median=median,
        median_interval=median_interval,
        n_never=int(np.isinf(values).sum()),
        n_failed=len(group.failed),
        horizon=horizon,
    )


def _pairings(
    groups: Sequence[TrialGroup], measure: Measure, horizon: float, reference: str | None
) -> Iterator[Pairing]:
    for first, second in itertools.combinations(groups, 2):
        if reference is not None and reference not in (first.contender, second.contender):
            continue
        if second.contender == reference:
            first, second = second, first
        _, at_first, at_second = np.intersect1d(first.seeds, second.seeds, return_indices=True)
        if not at_first.size:
            continue
        a, b = (measured(group, measure, horizon) for group in (first, second))
        estimate = paired_estimate(a[at_first], b[at_second], lower_is_better=measure.lower_is_better)
        yield Pairing(first.case, first.contender, second.contender, measure, estimate)
