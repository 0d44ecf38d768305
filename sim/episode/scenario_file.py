"""Scenario files: TOML that describes a scenario, and the scenario as the plain data that a run's files keep."""

from __future__ import annotations

import dataclasses
import hashlib
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sim.errors import UsageError
from sim.suggestions import did_you_mean
from sim.world.anatomy.case_files import CaseFiles
from sim.world.text import read_text
from sim.world.volumes.label_coding import LabelChoice

from .scenario import LIVER, NAMED_ORGANS, SCENARIOS, Scenario

if TYPE_CHECKING:
    from sim.world.anatomy.case_files import Body

ORGAN_SUFFIXES = (
    *(".stl", ".obj", ".ply", ".glb", ".gltf", ".off", ".vtk", ".vtp", ".nii", ".nii.gz", ".nrrd", ".nhdr"),
    *(".mha", ".mhd", ".mgz", ".hdr", ".img", ".dcm"),
)
"""How the names of files end that may hold an organ and no scenario."""
FILE_KEYS = {
    "tumour_files": "tumours",
    "target_files": "targets",
    "structure_files": "structures",
    "keepout_files": "keepouts",
}
LABEL_KEYS = {
    "organ_labels": "organ",
    "tumour_labels": "tumours",
    "target_labels": "targets",
    "structure_labels": "structures",
    "keepout_labels": "keepouts",
}
READING_KEYS = {
    "organ_object": "organ_object",
    "organ_unit": "unit",
    "organ_frame": "frame",
    "voxel_spacing_m": "spacing_m",
    "voxel_axes": "voxel_axes",
}
"""Keys of a scenario file that describe the case's files, and the fields of `CaseFiles` and `LabelChoice` they set."""


def load_scenario(name_or_path: str) -> Scenario:
    """The scenario of that name, or the one that a TOML file describes.

    A file holds fields of `Scenario`, and may start from a named one with `base = "sphere"`. Relative paths are
    relative to the file.

    Raises:
        UsageError: The name or a key is unknown, the file cannot be read, or a value is out of range.
    """
    if name_or_path in SCENARIOS:
        return SCENARIOS[name_or_path]
    path = Path(name_or_path)
    if path.is_dir():
        raise UsageError(f"scenario {name_or_path!r}: is a folder. Name a scenario file (.toml) in it.")
    if path.suffix != ".toml":
        raise _no_scenario(name_or_path)
    try:
        table = tomllib.loads(read_text(path))
    except OSError as error:
        raise UsageError(f"{path}: cannot read this scenario file: {error.strerror}.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: not a valid TOML file: {error}") from error
    return _from_table(path, table)


def _no_scenario(text: str) -> UsageError:
    """The error of a text that names no scenario, with what may have been meant."""
    if text.lower().endswith(ORGAN_SUFFIXES):
        return UsageError(
            f"scenario {text!r}: is an organ's file and not a scenario. Give it as `organ`, beside or without a "
            "`scenario`."
        )
    return UsageError(
        f"scenario {text!r}: not one of {', '.join(SCENARIOS)}, nor a .toml file."
        f"{did_you_mean(text, SCENARIOS)} A scenario that a script made in memory has no file: give it as an object "
        "again."
    )


def _from_table(path: Path, table: dict[str, Any]) -> Scenario:
    base = table.pop("base", None)
    if base is not None and base not in SCENARIOS:
        raise UsageError(f"{path}: base = {base!r}: not one of {', '.join(SCENARIOS)}.")
    keys = (*FILE_KEYS, *LABEL_KEYS, *READING_KEYS, "label_coding")
    known = [field.name for field in dataclasses.fields(Scenario) if field.name != "files"]
    for key in table:
        if key not in (*known, *keys):
            raise UsageError(f"{path}: unknown key {key!r}. Known keys: base, {', '.join([*known, *keys])}.")
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in table.items()}
    values.setdefault("name", path.stem)
    of_files = {key: values.pop(key) for key in keys if key in values}
    try:
        if values.get("organ", LIVER) not in NAMED_ORGANS:
            values["files"] = _files_of(path.parent, str(values.pop("organ")), of_files)
        else:
            organ = str(values.get("organ", SCENARIOS[base].organ if base else LIVER))
            _check_of_named_organ(organ, _files_of(path.parent, organ, of_files))
        return dataclasses.replace(SCENARIOS[base] if base else Scenario(), **_without_organ(values))
    except (TypeError, UsageError) as error:
        raise UsageError(f"{path}: {error}") from error


def _check_of_named_organ(organ: str, files: CaseFiles) -> None:
    """Check that keys about files may stand beside an organ that Sounding brings along, which has no files."""
    # A scenario checks what is said of its files.
    Scenario(files=files)
    held = [key for key, field in FILE_KEYS.items() if getattr(files, field)]
    held += [key for key, field in LABEL_KEYS.items() if getattr(files.labels, field)]
    if held:
        raise UsageError(f"{', '.join(held)}: go with an organ's own file, not with organ={organ!r}.")


def _without_organ(values: dict[str, Any]) -> dict[str, Any]:
    """The values, without the organ of a base scenario where there are files."""
    return values | ({"organ": LIVER} if "files" in values else {})


def _files_of(folder: Path, organ: str, values: dict[str, Any]) -> CaseFiles:
    """The files that the keys of a scenario file name; relative paths are relative to its folder."""
    labels = {LABEL_KEYS[key]: value for key, value in values.items() if key in LABEL_KEYS}
    if "label_coding" in values:
        labels["coding"] = values["label_coding"]
    named = {
        FILE_KEYS[key]: tuple(str(folder / file) for file in value)
        for key, value in values.items()
        if key in FILE_KEYS
    }
    reading = {READING_KEYS[key]: value for key, value in values.items() if key in READING_KEYS}
    return CaseFiles(organ=str(folder / organ), labels=LabelChoice(**labels), **named, **reading)


def scenario_record(scenario: Scenario) -> dict[str, Any]:
    """A scenario as plain data. A surface in memory is told by its size and a checksum, and cannot be read back."""
    files = scenario.case_files
    of_files = None
    if files is not None:
        of_files = {field.name: _plain(getattr(files, field.name)) for field in dataclasses.fields(files)}
    fields = [field.name for field in dataclasses.fields(scenario) if field.name not in ("organ", "files")]
    return {
        "organ": scenario.organ if files is None else of_files and of_files["organ"],
        "files": of_files,
        **{name: getattr(scenario, name) for name in fields},
    }


def _plain(value: Any) -> Any:
    if isinstance(value, LabelChoice):
        return dataclasses.asdict(value)
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    return value if value is None or isinstance(value, str | float) else _described(value)


def _described(body: Body) -> str:
    """The size and the checksum of a surface in memory, as a text."""
    assert not isinstance(body, str)
    vertices = getattr(body, "vertices_m", None)
    content = (body.vertices if vertices is None else vertices).tobytes() + body.faces.tobytes()  # type: ignore[union-attr]
    return f"in memory: {len(body.faces)} triangles, SHA-256 {hashlib.sha256(content).hexdigest()[:16]}"
