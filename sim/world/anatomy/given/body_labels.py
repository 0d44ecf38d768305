"""Which labels of a file of tumours or of a second class are meant: as the user says, else by their names."""

from __future__ import annotations

from typing import Literal

from sim.world.names import meaning_of
from sim.world.volumes.label_coding import CODINGS, Coding, LabelChoice
from sim.world.volumes.label_meaning import told
from sim.world.volumes.volume import Volume


def labels_of_bodies(
    volume: Volume, choice: LabelChoice, role: Literal["tumour", "target"]
) -> tuple[tuple[int, ...], list[str]]:
    """The labels of a volume that are tumours, or bodies of the second class, and what was assumed.

    Args:
        volume: The volume of a file that is named for them.
        choice: What the user says of labels; numbers that the file does not hold are those of other files.
        role: Whether tumours are wanted or the second class.
    """
    every = tuple(volume.counts)
    coded = CODINGS.get(choice.coding, Coding(organ=())).tumours if role == "tumour" else ()
    named = choice.tumours if role == "tumour" else choice.targets
    for wanted in (named, coded):
        if present := tuple(each for each in wanted if each in every):
            return present, _on_rest(volume, present)
    remarks = []
    if named:
        numbers = " ".join(map(str, named))
        remarks.append(f"has no label of `{role}_label` {numbers}, which are taken to be another file's")
    taken, said = _by_names(volume, role)
    return taken, [*remarks, *said]


def _by_names(volume: Volume, role: str) -> tuple[tuple[int, ...], list[str]]:
    """The labels that are meant by their names, all where these do not tell, and what is said of that."""
    every = tuple(volume.counts)
    meanings = {each: meaning_of(volume.label_names.get(each, "")) for each in every}
    if role == "tumour":
        meant = tuple(each for each in every if meanings[each] == "tumour")
    else:
        meant = tuple(each for each in every if meanings[each] not in ("tumour", "liver", "other organ"))
    taken = meant or tuple(each for each in every if meanings[each] is None) or every
    is_one = len(taken) == 1
    if len(every) == 1 and not volume.label_names:
        return taken, []
    noun = f"a {role}" if is_one else f"{role}s"
    why = "by the labels' names " if len(taken) < len(every) or (meant and role == "tumour") else ""
    said = [f"{why}{told(volume, taken)} {'is' if is_one else 'are'} taken for {noun}"]
    return taken, [*said, *_on_rest(volume, taken)]


def _on_rest(volume: Volume, taken: tuple[int, ...]) -> list[str]:
    rest = [each for each in volume.counts if each not in taken]
    if not rest:
        return []
    noun, verb = ("label", "is") if len(rest) == 1 else ("labels", "are")
    return [f"the {noun} {told(volume, rest)} {verb} left out"]
