"""Study files, which are TOML; the error of a mistake in a file tells its line."""

from __future__ import annotations

import itertools
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sim.errors import UsageError
from sim.running.fields import converted
from sim.suggestions import did_you_mean
from sim.world.text import read_text

from .study import Part, Study, option_names, parse_seeds

STUDIES_DIR = Path(__file__).parent / "studies"
TABLES = ("episode", "axes")


def study_names() -> tuple[str, ...]:
    """The names of the studies that Sounding brings along."""
    return tuple(sorted(path.stem for path in STUDIES_DIR.glob("*.toml")))


def load_study(name_or_path: str, overrides: Mapping[str, Any] | None = None) -> Study:
    """The study that a file describes, or one of those that Sounding brings along.

    A file holds `title`, the tables `[episode]` (one value per option) and `[axes]` (lists of values), and any number
    of `[[part]]`, each with tables `episode` and `axes` of its own that take precedence. Options are those of
    `sounding episode`, with - or _.

    Args:
        name_or_path: A name of `study_names()`, or the path of a .toml file.
        overrides: Lists of values that take precedence over those of the file.

    Raises:
        UsageError: The file cannot be read, a key, planner or scenario is unknown, or a value is out of range; the text
            tells the line.
    """
    path = STUDIES_DIR / f"{name_or_path}.toml" if name_or_path in study_names() else Path(name_or_path)
    if path.suffix != ".toml":
        raise UsageError(
            f"study {name_or_path!r}: not one of {', '.join(study_names())}, nor a .toml file."
            f"{did_you_mean(name_or_path, study_names())}"
        )
    try:
        text = read_text(path)
        table = tomllib.loads(text)
    except OSError as error:
        raise UsageError(f"{path}: cannot read this study file: {error.strerror}.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: not a valid TOML file: {error}") from error
    return _Reader(path, text, dict(overrides or {})).study(table)


class _Reader:
    """A reader of one file, which knows where in the file things stand."""

    def __init__(self, path: Path, text: str, overrides: dict[str, Any]) -> None:
        self._path, self._lines, self._overrides = path, text.splitlines(), overrides

    def study(self, table: dict[str, Any]) -> Study:
        self._expect(table, ("title", *TABLES, "part"), part=None)
        shared = self._values(table, part=None)
        tables = table.get("part", [{}])
        if not isinstance(tables, list):
            raise self._error("part", "parts are written [[part]], with two brackets.", part=None)
        parts = []
        for index, each in enumerate(tables):
            self._expect(each, TABLES, part=index)
            values = shared | self._values(each, part=index) | self._overrides
            parts.append(self._part(values, part=index if "part" in table else None))
        return Study(str(table.get("title", self._path.stem)), tuple(parts))

    def _values(self, table: Mapping[str, Any], part: int | None) -> dict[str, Any]:
        """The values of each option that the tables `episode` and `axes` name."""
        values: dict[str, Any] = {}
        for name, written, given in self._entries(table, part):
            if name in values:
                raise self._error(written, f"{written!r} is given twice.", part=part)
            try:
                values[name] = parse_seeds(given) if name == "seed" else self._converted(name, given)
            except UsageError as error:
                raise self._error(written, str(error), part=part) from error
        return values

    def _entries(self, table: Mapping[str, Any], part: int | None) -> list[tuple[str, str, Any]]:
        """The option, its name as it is written, and the list of its values, for all entries."""
        entries = []
        for section in TABLES:
            for written, given in table.get(section, {}).items():
                name = written.replace("-", "_")
                if name not in option_names():
                    known = ", ".join(option_names())
                    raise self._error(written, f"unknown key {written!r}. Known keys: {known}.", part=part)
                is_list = section == "axes" and isinstance(given, list)
                if section == "axes" and not is_list and name != "seed":
                    raise self._error(written, f"{written}: an axis is a list of values.", part=part)
                entries.append((name, written, given if is_list or name == "seed" else [given]))
        return entries

    def _converted(self, name: str, given: list[Any]) -> tuple[Any, ...]:
        return tuple(self._beside_file(name, converted(name, value)) for value in given)

    def _beside_file(self, name: str, value: Any) -> Any:
        """A value in which relative paths are relative to the file."""
        if isinstance(value, Path):
            return self._path.parent / value
        if isinstance(value, tuple):
            return tuple(self._beside_file(name, each) for each in value)
        if name in ("scenario", "arm", "probe") and Path(value).suffix:
            return str(self._path.parent / value)
        return value

    def _part(self, values: dict[str, Any], part: int | None) -> Part:
        try:
            return Part(values)
        # A planner raises ValueError where an option of its own is out of range.
        except (ValueError, UsageError) as error:
            raise self._error(self._word_at_fault(values, str(error)), str(error), part=part) from error

    def _word_at_fault(self, values: Mapping[str, Any], text: str) -> str:
        """The value that an error's text is about; the option where the text names no value."""
        for name in sorted(values, key=len, reverse=True):
            if re.search(rf"(?<![a-z]){name.replace('_', '[-_]')}(?![a-z])", text):
                told = [str(value) for value in values[name] if name != "seed"]
                is_told = (f"{value}:" in text or repr(value) in text for value in told)
                return next(itertools.compress(told, is_told), name)
        return ""

    def _expect(self, table: Mapping[str, Any], known: tuple[str, ...], part: int | None) -> None:
        for key in table:
            if key not in known:
                raise self._error(key, f"unknown key {key!r}. Known here: {', '.join(known)}.", part=part)
        for key in TABLES:
            if not isinstance(table.get(key, {}), dict):
                raise self._error(key, f"{key} is a table, written [{key}].", part=part)

    def _error(self, word: str, text: str, *, part: int | None) -> UsageError:
        line = self._line(word, part)
        return UsageError(f"{self._path}{f', line {line}' if line else ''}: {text}")

    def _line(self, word: str, part: int | None) -> int | None:
        """The number of the line that first names a key or a value, in the given part or, if not there, in the file."""
        starts = [i for i, line in enumerate(self._lines) if re.match(r"\s*\[\[\s*part\s*\]\]", line)]
        first = starts[part] if part is not None and part < len(starts) else 0
        pattern = re.compile(rf"(?<![\w-]){re.escape(word)}(?![\w-])".replace("_", "[-_]"))
        for lines in (range(first, len(self._lines)), range(first)):
            for index in lines:
                if word and pattern.search(self._lines[index].split("#")[0]):
                    return index + 1
        return None
