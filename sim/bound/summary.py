"""What a bound says, in a few numbers and as a table for the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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


def bound_text(content: Mapping[str, Any]) -> str:
    """What bound.json says, for a terminal."""
    head = f"{content['case']['scenario']}, arm {content['case']['arm']}"
    return "\n".join([head, "-" * len(head), *_hindsight_lines(content["hindsight"])])


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
