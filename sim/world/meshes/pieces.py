"""Separate pieces, of which one is the organ: the same rule for the bodies of a mesh and the parts of a label.

The largest piece is the organ. Pieces close to it that are no debris belong to it, as an outline that a slit cuts in
two. All else is left out, with a notice. Where another piece is far away and nearly as large, as the second kidney is,
only a person can tell.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

LEAST_SHARE = 0.05
"""Pieces with a smaller share of the volume of all are debris."""

RIVAL_SHARE = 0.3
"""A piece far from the largest that has at least this share of its volume could be the organ as well."""

NEAR_M = 0.010
"""Pieces with a wider gap [m] to the largest are no part of the organ: two slices of a CT that lie apart."""

LEAST_TOLD_M3 = 1e-6
"""The place of islands is told from this volume on [m^3]."""


class PieceError(ValueError):
    """No piece can be told to be the organ; the text names them and the option to choose."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Piece:
    """A separate piece.

    Attributes:
        volume_m3: Its volume [m^3].
        middle_m: Middle of its bounding box, LPS [m], shape (3,).
        is_within: Whether it lies wholly inside the largest.
        name: What the file calls it; empty where it does not.
    """

    volume_m3: float
    middle_m: NDArray[np.float64]
    is_within: bool = False
    name: str = ""


@dataclass(frozen=True, kw_only=True)
class KeptPieces:
    """Which pieces are the organ.

    Attributes:
        indices: Indices of the pieces that are, the main one first.
        remarks: What there is to say of the rest.
    """

    indices: tuple[int, ...]
    remarks: tuple[str, ...]


def keep_pieces(
    pieces: Sequence[Piece], gap_m: Callable[[int, int], float], wanted: str | None
) -> KeptPieces:
    """The pieces that are the organ.

    Args:
        pieces: All pieces; their numbers in names as `piece 2` follow their volumes, the largest first.
        gap_m: The distance of a piece to another [m], 0 where they touch; called for few.
        wanted: The name of the piece to take, as `piece 2`; None for the rule.

    Raises:
        PieceError: The piece wanted is not there, or another could be the organ as well.
    """
    order = [int(i) for i in np.argsort([-piece.volume_m3 for piece in pieces], kind="stable")]
    if wanted is not None:
        main = order[_number_of(wanted, pieces, order) - 1]
        return KeptPieces(indices=(main,), remarks=tuple(_on_dropped(pieces, main, [main], gap_m)))
    main, total_m3 = order[0], sum(piece.volume_m3 for piece in pieces)
    kept, rivals = [main], []
    for i in order[1:]:
        volume_m3 = pieces[i].volume_m3
        if pieces[i].is_within or volume_m3 < LEAST_SHARE * total_m3:
            continue
        if gap_m(i, main) <= NEAR_M:
            kept.append(i)
        elif volume_m3 >= RIVAL_SHARE * pieces[main].volume_m3:
            rivals.append(i)
    if rivals:
        raise PieceError(_question(pieces, order, [main, *rivals]))
    return KeptPieces(
        indices=tuple(kept),
        remarks=(*_on_kept(pieces, kept, gap_m), *_on_dropped(pieces, main, kept, gap_m)),
    )


def is_piece_name(name: str) -> bool:
    """Whether a name is that of a piece by its number, as `piece 2`."""
    return re.fullmatch(r"piece \d+", name.strip().lower()) is not None


def _number_of(wanted: str, pieces: Sequence[Piece], order: list[int]) -> int:
    """The number in a name as `piece 2`."""
    number = int(wanted.split()[-1]) if is_piece_name(wanted) else 0
    if not 1 <= number <= len(pieces):
        told = " and ".join(f"'piece {n}' ({describe(pieces[i])})" for n, i in enumerate(order[:5], start=1))
        raise PieceError(
            f"holds no object {wanted!r}; it is of {told}: pass one of these names as `organ_object`"
        )
    return number


def _question(pieces: Sequence[Piece], order: list[int], able: list[int]) -> str:
    names = {i: f"piece {order.index(i) + 1}" for i in able}
    told = " and ".join(f"{names[i]} ({describe(pieces[i])})" for i in able)
    return (
        f"is of separate pieces that lie apart, of which several could be the organ: {told}. Pass `organ_object` "
        f"{' or '.join(repr(name) for name in names.values())}"
    )


def _on_kept(pieces: Sequence[Piece], kept: list[int], gap_m: Callable[[int, int], float]) -> list[str]:
    apart = [(i, gap_m(i, kept[0])) for i in kept[1:]]
    apart = [(i, gap) for i, gap in apart if gap > 0.0]
    if not apart:
        return []
    told = " and ".join(f"{describe(pieces[i])}, {gap * 1e3:.1f} mm from the largest" for i, gap in apart[:3])
    return [f"the organ is of {len(kept)} separate pieces, all of which are kept: {told}"]


def _in_all(volume_m3: float) -> str:
    return f"{volume_m3 * 1e6:.2g} ml" if volume_m3 < 1e-4 else millilitres(volume_m3)


def _on_dropped(
    pieces: Sequence[Piece], main: int, kept: list[int], gap_m: Callable[[int, int], float]
) -> list[str]:
    """Sentences on the islands and inner bodies that are left out."""
    rest = [i for i in range(len(pieces)) if i not in kept]
    remarks = []
    if islands := [i for i in rest if not pieces[i].is_within]:
        total_m3 = sum(pieces[i].volume_m3 for i in islands)
        largest = max(islands, key=lambda i: pieces[i].volume_m3)
        noun = f"{len(islands):,} islands were" if len(islands) > 1 else "an island was"
        text = f"{noun} dropped beside the organ, {_in_all(total_m3)} in all"
        if pieces[largest].volume_m3 >= LEAST_TOLD_M3:
            which = ", the largest of them" if len(islands) > 1 else ","
            text += f"{which} {gap_m(largest, main) * 1e3:.0f} mm from it {place(pieces[largest].middle_m)}"
        remarks.append(text)
    for i in sorted((i for i in rest if pieces[i].is_within), key=lambda i: -pieces[i].volume_m3)[:3]:
        remarks.append(
            f"a body of {describe(pieces[i])}, lies wholly inside the organ and is left out: if it is a tumour, give "
            "it as a file of its own with `tumour`"
        )
    return remarks


def describe(piece: Piece) -> str:
    """The volume and the place of a piece."""
    return f"{millilitres(piece.volume_m3)} {place(piece.middle_m)}"


def millilitres(volume_m3: float) -> str:
    """A volume in words."""
    ml = volume_m3 * 1e6
    return f"{ml:,.0f} ml" if ml >= 100.0 else f"{ml:.3g} ml"


def place(middle_m: NDArray[np.float64]) -> str:
    """A place in words."""
    return "about LPS " + " ".join(f"{each + 0.0:.0f}" for each in np.round(middle_m * 1e3)) + " mm"
