"""What a bound says, in a few numbers and as a table for the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .hindsight import SeedBound


def hindsight_summary(bounds: Sequence[SeedBound]) -> dict[str, Any]:
    """The hindsight optima of some seeds in a few numbers; the means are of the seeds that can be sensed at all."""
    covers = [bound.cover for bound in bounds if bound.cover is not None]
    least, most = [cover.least for cover in covers], [cover.most for cover in covers]
    return {
        "n_seeds": len(bounds),
        "n_impossible": len(bounds) - len(covers),
        "n_proven": sum(a == b for a, b in zip(least, most, strict=True)),
        "least_mean": float(np.mean(least)) if covers else None,
        "most_mean": float(np.mean(most)) if covers else None,
        "counts": {str(n): least.count(n) for n in sorted(set(least))},
    }


def fewest_of(bounds: Sequence[SeedBound]) -> list[int | None]:
    """The proven hindsight optimum of each seed; None where no poses are enough."""
    return [None if bound.cover is None else bound.cover.least for bound in bounds]


def bound_text(content: Mapping[str, Any]) -> str:
    """What bound.json says, for a terminal."""
    case = content["case"]
    head = f"{Path(case.get('organ') or case['scenario']).name}, arm {Path(case['arm']).name}"
    lines = [*_hindsight_lines(content["hindsight"]), "", *_policy_lines(content)]
    return "\n".join([head, "-" * len(head), *lines]).rstrip()


def _hindsight_lines(found: Mapping[str, Any]) -> list[str]:
    n_possible = found["n_seeds"] - found["n_impossible"]
    lines = []
    if found["least_mean"] is not None:
        ends = [found["least_mean"], found["most_mean"]]
        shown = f"{ends[0]:.2f}" if ends[0] == ends[1] else f"from {ends[0]:.2f} to {ends[1]:.2f}"
        lines += [
            f"fewest poses in hindsight, mean of {n_possible} seeds   {shown}",
            f"seeds whose fewest is proven                 {found['n_proven']} of {n_possible}",
            "seeds by fewest poses                        "
            + ", ".join(f"{n}: {count}" for n, count in found["counts"].items()),
        ]
    if found["n_impossible"]:
        lines.append(f"seeds of which no poses sense enough         {found['n_impossible']}")
    return lines


def _policy_lines(content: Mapping[str, Any]) -> list[str]:
    policy = content["policy"]
    if policy is None:
        return [f"no bound on every policy: {content['no_policy']}"] if content["no_policy"] else []
    kinds = [
        ("generator", "tumours as the scenario plants them"),
        ("independent", "tumours in independent places"),
    ]
    if policy["n_tumours"] == 1:
        kinds = kinds[:1]
    lines = [f"fewest actions of any policy, in the mean; {policy['n_places']} places were drawn"]
    for name, meaning in kinds:
        if name in policy:
            own = policy[name]
            lines.append(
                f"  {meaning:<36}  {own['least_mean']:.2f}, with 95 % confidence at least {own['least_mean_95']:.2f}"
            )
    if policy["is_hindsight_alone"]:
        lines.append(
            "  the scenario keeps tumours apart, about which nothing is proven but the hindsight optimum"
        )
    return lines
