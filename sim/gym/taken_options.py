"""Which options an environment takes: those of an episode that decide what happens in it."""

from __future__ import annotations

import math
import numbers
import operator
from collections.abc import Mapping
from typing import Any

from sim.episode.measures import SENSED_GOAL
from sim.errors import FieldError
from sim.running.config import WHEN_NEEDED
from sim.running.fields import default_of, plain

_NOT_WRITTEN = "Nothing is written; leave it out."
OF_THE_CALL = {
    "seed": "Give it to reset().",
    "steps": "Give max_steps.",
    "motion": "The probe gets to every pose that it reaches; leave it out.",
    "until_sensed": f"An episode ends at {SENSED_GOAL}; leave it out.",
    "until_confident": "The agent decides; leave it out.",
    "miss_cost": "The agent decides; leave it out.",
    "plan_for": "The reward is about tumours; leave it out.",
    "config": "Give the options that it holds by their names.",
    "out": _NOT_WRITTEN,
    "overwrite": _NOT_WRITTEN,
    "frames": _NOT_WRITTEN,
    "report": _NOT_WRITTEN,
    "live": "Nothing is shown; leave it out.",
}
"""Options of an episode that an environment does not take, and what to do."""


def check_options(
    options: Mapping[str, Any],
    *,
    keeps_map: bool,
    makes_readings: bool | None,
    max_steps: int,
    reward_per_tumour: float,
) -> None:
    """Check what an environment is given; see `SoundingEnv`.

    Raises:
        FieldError: It does not take an option, or has no use for it, or a value is out of range.
    """
    for name in options:
        if name in OF_THE_CALL:
            raise FieldError(name, options[name], f"is no option of an environment. {OF_THE_CALL[name]}")
    if keeps_map and makes_readings is False:
        raise FieldError("makes_readings", False, "a map is made of readings. Give keeps_map=False too.")
    for name, is_used, remedy in (
        ("map", keeps_map, "no map is kept. Leave it out, or leave keeps_map=False out."),
        (
            "sensor",
            keeps_map or makes_readings,
            "no readings are made. Leave it out, or give makes_readings=True.",
        ),
    ):
        if name in options and not is_used and plain(options[name]) not in (default_of(name), WHEN_NEEDED):
            raise FieldError(name, options[name], remedy)
    if whole_number(max_steps) is None or max_steps < 1:
        raise FieldError("max_steps", max_steps, "must be a whole number, 1 or more.")
    is_number = isinstance(reward_per_tumour, numbers.Real) and not isinstance(reward_per_tumour, bool)
    if not is_number or not math.isfinite(reward_per_tumour):
        raise FieldError("reward_per_tumour", reward_per_tumour, "must be a finite number.")


def whole_number(value: Any) -> int | None:
    """A whole number of Python or NumPy as an int; None for anything else, a boolean too."""
    if isinstance(value, bool):
        return None
    try:
        return operator.index(value)
    except TypeError:
        return None
