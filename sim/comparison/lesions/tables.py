"""The lesions of a comparison as tables: by diameter as Markdown, and all of their numbers as CSV."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from sim.tables import markdown_table

from ..estimates import ShareEstimate
from ..texts import interval_text
from .scores import CLASSES, DiameterClass, LesionScore, lesion_note

if TYPE_CHECKING:
    from ..comparison import Comparison

LESION_NOTE = (
    "A lesion is found where the last map calls at least two of the lattice points nearest to it tumour, whatever was "
    "sensed of it; a connected piece of what it calls tumour that touches none is a false finding. Classes go by the "
    "diameter of a ball of its volume. Intervals draw whole seeds, since the lesions of one organ share their fate; "
    "where all lesions of a class were found, or none, they are Wilson's with each seed for one lesion, and where no "
    "finding was false, those of Poisson counts."
)


def lesion_markdown(comparison: Comparison, case: str) -> list[str]:
    """The part of compare.md about a case's lesions; nothing where no trial tells of them or lacks them."""
    scores, note = scores_of(comparison, case), lesion_note(comparison.groups_of(case))
    if not scores:
        return ["### Lesions", note] if note else []
    classes = classes_in(scores)
    shares = (f"found, {each.label}" for each in classes)
    head = ("contender", "trials", *shares, "missed of the 95 % sensed", "false findings a run")
    table = markdown_table(head, [_cells_of(score, classes) for score in scores])
    return ["### Lesions", *([note] if note else []), table, LESION_NOTE]


def classes_in(scores: Sequence[LesionScore]) -> list[DiameterClass]:
    """The classes of which some contender had any lesion."""
    return [of for i, of in enumerate(CLASSES) if any(score.by_diameter[i] is not None for score in scores)]


def scores_of(comparison: Comparison, case: str) -> list[LesionScore]:
    """The scores of a case's contenders."""
    return [score for score in comparison.lesions if score.case == case]


def _cells_of(score: LesionScore, classes: Sequence[DiameterClass]) -> list[str]:
    shares = [_in_one_line(share_words(score.share_of(of))) for of in classes]
    return [
        score.contender,
        str(score.n_trials),
        *shares,
        sensed_missed_words(score),
        " ".join(false_words(score)),
    ]


def _in_one_line(words: tuple[str, ...]) -> str:
    return words[0] if len(words) == 1 else f"{words[0]}: {' '.join(words[1:])}"


def sensed_missed_words(score: LesionScore) -> str:
    """How many of the lesions that were sensed to 95 % were missed all the same, as text."""
    return f"{score.n_sensed_missed} of {score.n_sensed}"


def false_words(score: LesionScore) -> tuple[str, str]:
    """False findings a run as text, and their interval."""
    false = score.false_per_run
    return f"{false.mean:.2f}", interval_text(false.interval, "{:.2f}")


def share_words(share: ShareEstimate | None) -> tuple[str, ...]:
    """A share as text: how many of how many, the percentage and its interval; a dash where there are no lesions."""
    if share is None:
        return ("–",)
    low, high = (100 * end for end in share.interval)
    n_found = round(share.share * share.n)
    return f"{n_found} of {share.n}", f"{share.share:.0%}", interval_text((low, high), "{:.0f}")


def lesion_rows(comparison: Comparison) -> Iterator[dict[str, Any]]:
    """All numbers about lesions as rows of one CSV file: by diameter, by threshold and by action."""
    for score in comparison.lesions:
        name = {"case": score.case, "contender": score.contender}
        for of, share in zip(CLASSES, score.by_diameter, strict=True):
            if share is not None:
                yield name | {"share": "found", "diameter": of.label} | _cells(share)
        missed = {"n_lesions": score.n_sensed, "fraction": _ratio(score.n_sensed_missed, score.n_sensed)}
        yield name | {"share": "missed of the 95 % sensed"} | missed
        response = score.response
        if response is not None:
            for p, share, false in zip(
                response.probability, response.found, response.false_per_run, strict=True
            ):
                row = name | {"share": "found", "called_from_probability": p} | _cells(share)
                yield row | {"n_false_findings_per_run": false}
        for what, shares in (("seen", score.seen), ("mapped", score.mapped)):
            for action, share in zip(score.actions, shares, strict=True):
                yield name | {"share": what, "action": int(action)} | _cells(share)


def _ratio(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def _cells(share: ShareEstimate) -> dict[str, Any]:
    return {
        "n_lesions": share.n,
        "n_seeds": share.n_clusters,
        "fraction": share.share,
        "low": share.interval[0],
        "high": share.interval[1],
    }


LESION_COLUMNS = (
    *("case", "contender", "share", "diameter", "called_from_probability", "action"),
    *("n_lesions", "n_seeds", "fraction", "low", "high", "n_false_findings_per_run"),
)
"""The columns of these rows."""
