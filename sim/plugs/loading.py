"""From a text to the class that it names, and to what the class makes."""

from __future__ import annotations

import importlib
import inspect
import sys
import traceback
from collections.abc import Mapping, Sequence
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from .errors import PlugError
from .kinds import PlugKind

PLACE = "package.module:Class"
"""How the place of a plug is written."""


def load_plug(text: str, kind: PlugKind, *, built_in: Sequence[str] = ()) -> Any:
    """The class (or, for a map, the function) that a text names.

    A module that is named by its place may lie in the current folder. The folder stays on Python's path, at the end,
    so that the plug can import its neighbours later on.

    Args:
        text: `package.module:Class`, where a dotted name may follow the colon, or the name of an entry point.
        kind: What the text must name.
        built_in: Names that the caller knows already; an error for an unknown name lists them too.

    Raises:
        PlugError: The text names nothing, the module raised as it was imported, or what it names is of no such kind.
    """
    label = f"`{kind.name}` '{text}'"
    if ":" in text:
        module_name, _, attribute = text.rpartition(":")
        _check_place(label, module_name, attribute)
        _add_current_folder()
    else:
        entry_point = _find_entry_point(label, text, kind, built_in)
        module_name, attribute = entry_point.module, entry_point.attr
        label = f"{label} ({entry_point.value})"
    module = _import(label, module_name)
    plug = _find_attribute(label, module, attribute, kind) if attribute else module
    fault = kind.fault(plug)
    if fault is not None:
        name = attribute or module_name
        raise PlugError(
            f"{label}: {name} {fault}; a {kind.name} is {kind.expected}. {_candidates(module, kind)}"
        )
    return plug


def make_plug(
    text: str, kind: PlugKind, options: Mapping[str, Any], *arguments: Any, built_in: Sequence[str] = ()
) -> Any:
    """What the class named by a text makes of options.

    Args:
        text: See `load_plug`.
        kind: What the text must name.
        options: Passed to the class by keyword.
        arguments: Passed before them: for a map the space that it is made for.
        built_in: See `load_plug`.

    Raises:
        PlugError: See `load_plug`; also, the class takes other options, or raised as it was called.
    """
    plug = load_plug(text, kind, built_in=built_in)
    label = f"`{kind.name}` '{text}'"
    signature = _signature(plug)
    if signature is not None:
        try:
            signature.bind(*arguments, **options)
        except TypeError as error:
            given = f"the options {', '.join(options)}" if options else "no options"
            raise PlugError(
                f"{label} cannot be made with {given}: {error}. Its options are those of "
                f"{plug.__name__}{signature}."
            ) from error
    try:
        return plug(*arguments, **options)
    # It is the user's own code, which may raise anything; whatever it is, the user is told.
    except (Exception, SystemExit) as error:
        raise PlugError(
            f"{label} raised {_description(error)} as it was made. Mend it, or give it other options."
        ) from error


def plug_names(kind: PlugKind) -> tuple[str, ...]:
    """The names of all installed entry points of a kind, in alphabetical order."""
    return tuple(sorted({entry_point.name for entry_point in entry_points(group=kind.group)}))


def is_plug(text: str, kind: PlugKind) -> bool:
    """Whether a text is meant as a plug: it names a place, or an installed entry point."""
    return ":" in text or text in plug_names(kind)


def _check_place(label: str, module_name: str, attribute: str) -> None:
    _refuse_file(label, module_name, attribute)
    parts = [*module_name.split("."), *attribute.split(".")]
    if not all(part.isidentifier() for part in parts):
        raise PlugError(f"{label} has not the form {PLACE}; write it so, for example my_module:MyClass.")


def _refuse_file(label: str, name: str, attribute: str = "") -> None:
    name = name.replace("\\", "/")
    if name.endswith(".py") or "/" in name:
        module = name.rpartition("/")[2].removesuffix(".py")
        raise PlugError(
            f"{label} names a file. Write the name of the module, {module}:{attribute or 'Class'}, and run in the "
            "folder that holds the file."
        )


def _add_current_folder() -> None:
    """Put the current folder at the end of Python's path, unless modules are looked for there already."""
    folder = str(Path.cwd())
    if not {folder, ""} & set(sys.path):
        sys.path.append(folder)


def _find_entry_point(label: str, name: str, kind: PlugKind, built_in: Sequence[str]) -> EntryPoint:
    found = {entry.value: entry for entry in entry_points(group=kind.group, name=name)}
    if len(found) > 1:
        raise PlugError(
            f"{label} is offered more than once, as {' and '.join(sorted(found))}; write the one that you mean."
        )
    if found:
        return next(iter(found.values()))
    _refuse_file(label, name)
    known = list(dict.fromkeys([*built_in, *plug_names(kind)]))
    choice = f"choose one of {', '.join(known)}, or " if known else ""
    raise PlugError(f"{label}: no {kind.name} has this name; {choice}write {PLACE} for one of your own.")


def _import(label: str, name: str) -> ModuleType:
    # A file that was written a moment ago may be missing from what Python remembers of the folder.
    importlib.invalidate_caches()
    try:
        return importlib.import_module(name)
    # A module may raise anything as it is imported, and a script without a guard may exit.
    except (Exception, SystemExit) as error:
        if isinstance(error, ModuleNotFoundError) and f"{name}.".startswith(f"{error.name}."):
            raise PlugError(
                f"{label}: there is no module {error.name}, neither installed nor in the current folder, "
                f"{Path.cwd()}. Mend the name, install the module, or run in the folder that holds it."
            ) from error
        raise PlugError(
            f"{label}: importing the module {name} raised {_description(error)}. Mend the module."
        ) from error


def _find_attribute(label: str, module: ModuleType, attribute: str, kind: PlugKind) -> Any:
    found: Any = module
    for part in attribute.split("."):
        try:
            found = getattr(found, part)
        except AttributeError as error:
            file = getattr(module, "__file__", None)
            place = f"{module.__name__} ({file})" if file else module.__name__
            raise PlugError(
                f"{label}: the module {place} has no {attribute}. {_candidates(module, kind)}"
            ) from error
        # Modules that load their names on first use may raise whatever an import may.
        except (Exception, SystemExit) as error:
            raise PlugError(
                f"{label}: looking up {attribute} raised {_description(error)}. Mend the module."
            ) from error
    return found


def _candidates(module: ModuleType, kind: PlugKind) -> str:
    """A sentence about the plugs of a kind that a module defines."""
    names = [
        name
        for name, value in vars(module).items()
        if not name.startswith("_")
        and f"{getattr(value, '__module__', '')}.".startswith(f"{module.__name__}.")
        and kind.fault(value) is None
    ]
    if not names:
        return f"The module defines no {kind.name}; name another module, or define one in it."
    return f"Choose from what the module defines: {', '.join(names)}."


def _signature(plug: Any) -> inspect.Signature | None:
    """Names and defaults of what a callable takes; None where Python cannot tell."""
    try:
        signature = inspect.signature(plug)
    except (TypeError, ValueError):
        return None
    bare = [p.replace(annotation=inspect.Parameter.empty) for p in signature.parameters.values()]
    return inspect.Signature(bare)


def _description(error: BaseException) -> str:
    """An error's type and text in one line, with the line of the user's file where it arose."""
    text = f"{type(error).__name__}: {' '.join(str(error).split()).rstrip('.')}".removesuffix(": ")
    ours = (__file__, "<", str(Path(importlib.__file__).parent))
    frames = [
        frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith(ours)
    ]
    # A syntax error names its own line, and code that is no file has none.
    if not frames or isinstance(error, SyntaxError):
        return text
    line = [frame.lineno for frame in frames if frame.filename == frames[0].filename][-1]
    return f"{text} ({Path(frames[0].filename).name}, line {line})"
