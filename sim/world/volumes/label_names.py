"""Names of labels that the files themselves give: in NRRD's keys, or in the extensions of a NIfTI header."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterable, Mapping
from typing import Any

from sim.world.text import decoded

MOST_SEGMENTS = 1000

MOST_EXTENSION_BYTES = 4 << 20
"""Longer extensions are not looked at: names of a thousand labels take some hundred thousand bytes."""

XML_LABEL = re.compile(r"<Label\b([^>]*)>(.*?)</Label>", re.DOTALL)
XML_KEY = re.compile(r"""\bKey\s*=\s*["'](\d{1,5})["']""")

AFNI_TABLE = re.compile(r"VALUE_LABEL_DTABLE.*?</AFNI_atr>", re.DOTALL)
AFNI_ROW = re.compile(r'"(\d{1,5})"\s+"([^"\n]*)"')

JSON_KEYS = ("labels", "label_map", "label_names", "labelmap", "segments", "labelgroups", "groups")
"""Under which programs keep names in JSON."""


def segment_names(header: Mapping[str, Any]) -> dict[int, str]:
    """The names that an NRRD header gives the labels: those of 3D Slicer's segments, or of MITK's labels.

    Args:
        header: Its fields, keys and values.
    """
    names = {}
    for index in range(MOST_SEGMENTS):
        name, value = header.get(f"Segment{index}_Name"), header.get(f"Segment{index}_LabelValue")
        if name is None:
            break
        if value is not None and str(value).isdecimal():
            names[int(value)] = unescaped(str(name))
    for key, value in header.items():
        if not names and key.startswith("org.mitk.multilabel"):
            names = _names_in_json(_parsed(unescaped(str(value))))
    return names


def unescaped(value: str) -> str:
    """The value of an NRRD key, in which line breaks and backslashes are written with a backslash before them."""
    return value.replace("\\\\", "\0").replace("\\n", " ").replace("\0", "\\").strip()


def extension_names(contents: Iterable[bytes]) -> dict[int, str]:
    """The names that the extensions of a NIfTI header give the labels.

    TotalSegmentator and Connectome Workbench write a table of labels in XML, AFNI a table of its own, others JSON.

    Args:
        contents: The bytes of each extension.
    """
    names: dict[int, str] = {}
    for content in contents:
        if len(content) > MOST_EXTENSION_BYTES:
            continue
        text = decoded(content).strip("\0 \t\r\n")
        found = _names_in_xml(text) or _names_in_table(text) or _names_in_json(_parsed(text))
        names = {**found, **names}
    return {label: name for label, name in names.items() if label > 0 and name}


def _names_in_xml(text: str) -> dict[int, str]:
    """The names of a label table as Caret and Connectome Workbench write it."""
    names = {}
    for attributes, body in XML_LABEL.findall(text):
        key = XML_KEY.search(attributes)
        if key is not None:
            plain = re.fullmatch(r"\s*<!\[CDATA\[(.*?)\]\]>\s*", body, flags=re.DOTALL)
            names[int(key[1])] = (plain[1] if plain else html.unescape(body)).strip()
    return names


def _names_in_table(text: str) -> dict[int, str]:
    """The names of AFNI's table of values."""
    table = AFNI_TABLE.search(text)
    rows = AFNI_ROW.findall(html.unescape(table[0])) if table else ()
    return {int(label): name.strip() for label, name in rows}


def _parsed(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return None
    except RecursionError:
        return None


def _names_in_json(tree: Any) -> dict[int, str]:
    """Names in JSON: numbers to names, names to numbers, or lists of objects with a name and a value."""
    if isinstance(tree, list):
        return {label: name for each in tree for label, name in _names_in_json(each).items()}
    if not isinstance(tree, dict):
        return {}
    for key in JSON_KEYS:
        if isinstance(tree.get(key), dict | list):
            return _names_in_json(tree[key])
    if isinstance(tree.get("name"), str):
        value = next((tree[key] for key in ("value", "label", "id", "labelID") if key in tree), None)
        return {value: tree["name"]} if isinstance(value, int) else {}
    names = {}
    for key, value in tree.items():
        if str(key).isdecimal() and isinstance(value, str):
            names[int(key)] = value
        elif isinstance(value, int) and not isinstance(value, bool):
            names[value] = str(key)
    return names
