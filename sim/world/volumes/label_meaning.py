"""What the labels of a volume at hand mean: as the user says, else as their names tell, else as their numbers do."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from sim.world.errors import VolumeError
from sim.world.names import is_generic, meaning_of, roles_of

from .label_coding import CODINGS, Coding, LabelChoice, describe_labels
from .label_guess import Guess, guess_by_numbers, remarks_on_shapes
from .volume import Volume

MOST_STRUCTURES = 12
"""Of more named labels that are neither organ nor tumours, as of a whole body, only the vessels are structures."""

UNLIKELY = {"vessel": "a vessel", "tumour": "a tumour", "part": "a part of an organ"}
"""What an organ is seldom called."""

MOST_TOLD = 8
"""Labels that a notice names before it counts the rest."""


def coding_of(volume: Volume, choice: LabelChoice, path: object) -> tuple[Coding, list[str]]:
    """The coding of a volume, and what was assumed.

    Args:
        volume: The labels.
        choice: What the user says.
        path: The file, for messages.

    Raises:
        VolumeError: The coding is not known, the labels are ambiguous, or the organ is not there.
    """
    if choice.coding != "auto" and choice.coding not in CODINGS:
        raise VolumeError(f"coding {choice.coding!r} is not known; use one of auto, {', '.join(CODINGS)}")
    remarks: list[str] = []
    if choice.coding != "auto":
        base = CODINGS[choice.coding]
    elif choice.organ:
        base = Coding(organ=choice.organ)
    else:
        base, remarks = _by_names(volume) or _by_numbers(volume, path)
    if choice.coding != "auto" and volume.label_names:
        base = replace(base, structures=_named(volume, base.structures.values()))
    structures = {name: label for name, label in base.structures.items() if label not in choice.targets}
    coding = Coding(
        organ=choice.organ or base.organ or tuple(volume.counts),
        tumours=choice.tumours or base.tumours,
        targets=choice.targets,
        structures={**structures, **_named(volume, choice.structures)},
        keepouts=_named(volume, choice.keepouts),
    )
    if choice.coding != "auto" and not volume.label_names:
        remarks += remarks_on_shapes(volume, base.structures)
    _check_present(volume, coding, choice, path)
    _check_targets(coding, path)
    return coding, [*remarks, *_remarks_on_rest(volume, coding)]


def _by_names(volume: Volume) -> tuple[Coding, list[str]] | None:
    """The coding that the labels' names tell, and what was assumed; None if they tell no organ."""
    names = {label: name for label, name in volume.label_names.items() if label in volume.counts}
    roles = roles_of(names)
    if not roles.organ:
        return None
    others = roles.others
    if len(others) > MOST_STRUCTURES:
        others = tuple(label for label in others if meaning_of(names[label]) == "vessel")
    why = " as the only one beside tumours" if roles.is_by_rest else ""
    texts = [f"{told(volume, roles.organ)} is taken for the organ{why}"]
    texts += [f"{told(volume, roles.tumours)} for tumours" if roles.tumours else "none for a tumour"]
    texts += [f"{told(volume, others)} for structures to show"] if others else []
    said = f"by the labels' names {', '.join(texts[:-1])} and {texts[-1]}"
    coding = Coding(organ=roles.organ, tumours=roles.tumours, structures=_named(volume, others))
    return coding, [said]


def _by_numbers(volume: Volume, path: object) -> tuple[Coding, list[str]]:
    """The coding that the labels' numbers tell, and what was assumed.

    Raises:
        VolumeError: They tell none, or their names tell that the numbers do not mean what they mean elsewhere.
    """
    names = [volume.label_names.get(label, "") for label in volume.counts]
    is_telling = any(not is_generic(name) and meaning_of(name) is not None for name in names)
    guess = Guess() if is_telling and len(names) > 1 else guess_by_numbers(volume)
    if guess.coding is not None:
        return guess.coding, list(guess.remarks)
    *others, last = CODINGS
    why = ", and their names tell none" if is_telling else "".join(f". {each}" for each in guess.remarks)
    raise VolumeError(
        f"{path}: which of its labels is the organ? It holds {describe_labels(volume)}{why}. Pass `organ_label` N, "
        f"and `tumour_label` M if there are tumours, or `coding` {', '.join(others)} or {last}"
    )


def _remarks_on_rest(volume: Volume, coding: Coding) -> list[str]:
    """What there is to say of labels that are taken for nothing, and of tumours that are named and not there."""
    named = (*coding.structures.values(), *coding.keepouts.values())
    taken = {*coding.organ, *coding.tumours, *coding.targets, *named}
    rest = [label for label in volume.counts if label not in taken]
    tumours = [label for label in rest if meaning_of(volume.label_names.get(label, "")) == "tumour"]
    plain = [label for label in rest if label not in tumours]
    remarks = []
    for label in coding.organ:
        if (meaning := meaning_of(volume.label_names.get(label, ""))) in UNLIKELY and len(coding.organ) == 1:
            remarks.append(
                f"the organ is {volume.label_text(label)}, which has the name of {UNLIKELY[meaning]}"
            )
    if tumours:
        verb = "has a tumour's name and is" if len(tumours) == 1 else "have tumours' names and are"
        numbers = " ".join(map(str, tumours))
        remarks.append(
            f"{told(volume, tumours)} {verb} taken for nothing: pass `tumour_label` {numbers} if tumours are meant"
        )
    if plain:
        noun, verb = ("label", "is") if len(plain) == 1 else ("labels", "are")
        remarks.append(f"the {noun} {told(volume, plain)} {verb} taken for nothing")
    for label, name in volume.label_names.items():
        if label not in volume.counts and meaning_of(name) == "tumour":
            remarks.append(f"the header names {label} {name!r}, but no voxel has that label")
    return remarks


def told(volume: Volume, labels: Iterable[int]) -> str:
    """Labels with their names, and how many more there are.

    Args:
        volume: Their volume.
        labels: At least one label.
    """
    texts = [volume.label_text(label) for label in labels]
    if len(texts) > MOST_TOLD:
        return f"{', '.join(texts[:MOST_TOLD])} and {len(texts) - MOST_TOLD} more"
    return " and ".join([", ".join(texts[:-1]), texts[-1]]) if len(texts) > 1 else texts[0]


def _named(volume: Volume, labels: Iterable[int]) -> dict[str, int]:
    """Labels by their names, each of which is made one of its own."""
    named: dict[str, int] = {}
    for label in labels:
        name = volume.label_names.get(label, "") or f"label {label}"
        named[name if name not in named else f"{name} (label {label})"] = label
    return named


def _check_present(volume: Volume, coding: Coding, choice: LabelChoice, path: object) -> None:
    """Nothing, if the organ's labels and all those that the user names are in the file.

    Raises:
        VolumeError: One is not.
    """
    wanted = {
        "organ_label": coding.organ,
        "tumour_label": choice.tumours,
        "target_label": choice.targets,
        "structure_label": choice.structures,
        "keepout_label": choice.keepouts,
    }
    for option, labels in wanted.items():
        if absent := [label for label in labels if label not in volume.counts]:
            raise VolumeError(
                f"{path}: `{option}` {' '.join(map(str, absent))} is not in the file, which holds "
                f"{describe_labels(volume)}; pass the right label"
            )


def _check_targets(coding: Coding, path: object) -> None:
    """Nothing, if the labels of the second class are not those of the tumours or of the whole organ.

    Raises:
        VolumeError: They are.
    """
    taken = {"tumours": coding.tumours}
    if set(coding.organ) <= set(coding.targets):
        taken["the whole organ"] = coding.organ
    for what, labels in taken.items():
        if shared := sorted(set(labels) & set(coding.targets)):
            raise VolumeError(
                f"{path}: `target_label` {' '.join(map(str, shared))} means {what} already; pass the label of another "
                "class"
            )
