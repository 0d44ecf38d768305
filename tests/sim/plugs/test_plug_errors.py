"""Texts that lead nowhere are answered with the cause and the remedy, never with a traceback."""

from __future__ import annotations

import sys

import pytest
from own_plugs import OWN_PLANNER, add_package, error_of

from sim.plugs import PLANNER, SENSOR, PlugError, make_plug


def test_an_entry_point_that_leads_nowhere_is_named_with_its_place(folder, monkeypatch) -> None:
    add_package(folder / "site", "old", PLANNER.group, {"gone": "lost:Planner", "bare": "own_planner"})
    monkeypatch.setattr(sys, "path", [*sys.path, str(folder / "site"), str(folder)])
    assert error_of("gone").startswith("`planner` 'gone' (lost:Planner): there is no module lost, neither")
    assert "'bare' (own_planner): own_planner is a module; a planner is a class" in error_of("bare")


def test_a_name_that_two_packages_offer_is_not_guessed(folder, monkeypatch) -> None:
    add_package(folder / "site", "one", PLANNER.group, {"best": "own_planner:LastFirst"})
    add_package(folder / "site", "two", PLANNER.group, {"best": "own_planner:Silent"})
    monkeypatch.setattr(sys, "path", [*sys.path, str(folder / "site")])
    assert error_of("best") == (
        "`planner` 'best' is offered more than once, as own_planner:LastFirst and own_planner:Silent; "
        "write the one that you mean."
    )


def test_an_unknown_name_lists_those_that_exist(folder, monkeypatch) -> None:
    assert error_of("besst") == (
        "`planner` 'besst': no planner has this name; write package.module:Class for one of your own."
    )
    add_package(folder / "site", "one", PLANNER.group, {"best": "own_planner:LastFirst"})
    monkeypatch.setattr(sys, "path", [*sys.path, str(folder / "site")])
    assert "choose one of random, best, or write package.module:Class" in error_of(
        "besst", built_in=["random"]
    )


@pytest.mark.parametrize("text", ["own_planner.py:LastFirst", "./own_planner.py:LastFirst"])
def test_the_name_of_a_file_is_answered_with_that_of_its_module(folder, text: str) -> None:
    assert "names a file. Write the name of the module, own_planner:LastFirst, and run" in error_of(text)
    assert "own_planner:Class" in error_of("plans/own_planner.py")
    assert "own_planner:Mine" in error_of(r"C:\plans\own_planner.py:Mine")


@pytest.mark.parametrize("text", ["own_planner:", ":LastFirst", "own planner:A", "a:b:c", "own_planner:A()"])
def test_a_text_of_another_form_is_answered_with_the_form(folder, text: str) -> None:
    assert error_of(text) == (
        f"`planner` '{text}' has not the form package.module:Class; write it so, for example my_module:MyClass."
    )


def test_a_module_that_is_not_there(folder) -> None:
    assert error_of("lost:Planner") == (
        "`planner` 'lost:Planner': there is no module lost, neither installed nor in the current folder, "
        f"{folder}. Mend the name, install the module, or run in the folder that holds it."
    )
    assert "there is no module own_planner.inner" in error_of("own_planner.inner:A")


@pytest.mark.parametrize(
    ("code", "description"),
    [
        ("x = 1\n\nx / 0\n", "ZeroDivisionError: division by zero (broken.py, line 3)"),
        ("import lost_dependency\n", "ModuleNotFoundError: No module named 'lost_dependency' (broken.py, line 1)"),
        ("def f(:\n", "SyntaxError: invalid syntax (broken.py, line 1)"),
        ("import sys\nsys.exit(3)\n", "SystemExit: 3 (broken.py, line 2)"),
        ("def f():\n    assert False\nf()\n", "AssertionError (broken.py, line 2)"),
        ("import json\njson.loads('{')\n", "(broken.py, line 2)"),
    ],
)  # fmt: skip
def test_a_module_that_raises_is_named_with_its_error_and_line(folder, code: str, description: str) -> None:
    (folder / "broken.py").write_text(code)
    text = error_of("broken:A")
    assert text.startswith("`planner` 'broken:A': importing the module broken raised ")
    assert text.endswith(f"{description}. Mend the module.")


def test_a_class_that_the_module_lacks_is_answered_with_those_it_has(folder) -> None:
    assert error_of("own_planner:Lastfirst") == (
        f"`planner` 'own_planner:Lastfirst': the module own_planner ({folder / 'own_planner.py'}) has no Lastfirst. "
        "Choose from what the module defines: LastFirst, Careless."
    )
    assert error_of("own_planner:Blind", SENSOR).endswith(
        "has no Blind. The module defines no sensor; name another module, or define one in it."
    )
    assert "Choose from what the module defines: Blind, Free." in error_of("own_sensor:Seeing", SENSOR)


@pytest.mark.parametrize(
    ("text", "kind", "fault"),
    [
        (
            "own_planner:Holder",
            PLANNER,
            "Holder derives from another class; a planner is a class that derives",
        ),
        ("own_planner:make", PLANNER, "make is a function; a planner is"),
        ("own_planner:RATE", PLANNER, "RATE is an object of the type float; a planner is"),
        ("own_planner:Unfinished", PLANNER, "Unfinished does not define rank; a planner is"),
        ("own_planner:Silent", PLANNER, "Silent does not set needs_belief; a planner is"),
        ("own_sensor:Dumb", SENSOR, "Dumb has no method sense; a sensor is"),
        ("own_sensor:Open", SENSOR, "Open does not define sense; a sensor is"),
        ("own_planner:make", SENSOR, "make is a function; a sensor is"),
    ],
)
def test_what_is_of_another_kind_is_refused(folder, text: str, kind, fault: str) -> None:
    assert fault in error_of(text, kind)


def test_a_module_that_loads_its_names_on_first_use_may_raise_then(folder) -> None:
    (folder / "lazy.py").write_text("def __getattr__(name):\n    raise ImportError('no library')\n")
    assert error_of("lazy:A") == (
        "`planner` 'lazy:A': looking up A raised ImportError: no library (lazy.py, line 2). Mend the module."
    )


def test_options_that_the_class_does_not_take_are_answered_with_its_own(folder) -> None:
    assert error_of("own_planner:LastFirst", options={"stride": 2}) == (
        "`planner` 'own_planner:LastFirst' cannot be made with the options stride: got an unexpected keyword "
        "argument 'stride'. Its options are those of LastFirst(step=1)."
    )
    assert error_of("own_planner:Careless") == (
        "`planner` 'own_planner:Careless' cannot be made with no options: missing a required argument: 'n_poses'. "
        "Its options are those of Careless(n_poses, *, step=2)."
    )


def test_a_class_that_raises_as_it_is_made_is_named_with_its_error(folder) -> None:
    with pytest.raises(PlugError) as caught:
        make_plug("own_planner:LastFirst", PLANNER, {"step": 0})
    assert isinstance(caught.value.__cause__, ValueError)
    line = 1 + OWN_PLANNER.splitlines().index(
        '            raise ValueError(f"step={self.step}: must be 1 or more.")'
    )
    assert str(caught.value) == (
        "`planner` 'own_planner:LastFirst' raised ValueError: step=0: must be 1 or more "
        f"(own_planner.py, line {line}) as it was made. Mend it, or give it other options."
    )
    assert "raised KeyError: 'nowhere'" in error_of("own_planner:Careless", options={"n_poses": 3})
