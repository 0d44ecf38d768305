"""The card of a dataset: what it holds, how it was made, and what it is not."""

from __future__ import annotations

from .plan import DatasetPlan
from .record import EPISODE_FIELDS, STEP_FIELDS

_PLACES = {
    "parquet": "`steps/shard-*.parquet` has a row an action, `episodes/shard-*.parquet` a row an episode.",
    "hdf5": (
        "`shard-*.h5` has a group an episode. What is told of the episode stands in its attributes and datasets, what "
        "is told of its actions in the group `steps`. Rows of different length stand one after the other, and "
        "`<name>_length` tells their lengths."
    ),
    "lerobot": (
        "`meta/` and `data/` are a LeRobotDataset of version 3.0, with the fields of one length. `shards/` holds all "
        "fields: `steps/shard-*.parquet` a row an action, `episodes/shard-*.parquet` a row an episode."
    ),
}


def card_of(plan: DatasetPlan) -> str:
    """The text of the card, in Markdown with the head that dataset hubs read."""
    options = {
        name: value for name, value in plan.identity()["episodes"].items() if value not in (None, [], False)
    }
    lines = [
        "---",
        "tags: [robotics, ultrasound, active-sensing, simulation]",
        f"size_categories: [{_size(len(plan.seeds))}]",
        "---",
        "",
        f"# Sounding: {len(plan.seeds)} episodes of `{plan.config.scenario}`",
        "",
        "Simulated episodes in which a probe looks for hidden tumours: where it sensed, what it saw, what was believed "
        "afterwards, and the truth. Nothing of it was measured on a patient or a robot.",
        "",
        _PLACES[plan.format],
        "",
        f"Seeds {plan.seeds[0]} to {plan.seeds[-1]}, {plan.shard_size} episodes a shard. The same options give the "
        "same episodes. Their options, in the units of `sounding episode`:",
        "",
        *(f"- `{name}`: {value}" for name, value in options.items()),
        "",
        "## An action",
        "",
        *(f"- `{name}`: {text}" for name, text in STEP_FIELDS.items()),
        "",
        "## An episode",
        "",
        *(f"- `{name}`: {text}" for name, text in EPISODE_FIELDS.items()),
        "",
        "## Limits",
        "",
        "The planner chose the actions, so that they are no sample of all poses. Organs, tumours and sensors are those "
        "of the simulation, and so are their errors. Split by seed, not by action.",
        "",
    ]
    return "\n".join(lines)


def _size(n: int) -> str:
    """The size of a dataset as hubs sort them."""
    for most, text in ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K")):
        if n < most:
            return text
    return "n>100K"
