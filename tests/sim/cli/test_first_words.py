"""What a newcomer types first: the version, help with examples, and names that are nearly right."""

from __future__ import annotations

import importlib
import re
import shlex
from importlib import metadata

import pytest

from sim.cli.command_line import COMMANDS, main, parse_command
from sim.suggestions import did_you_mean


def test_the_version_is_told(capsys) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"sounding {metadata.version('sounding')}\n"


@pytest.mark.parametrize("command", COMMANDS)
def test_help_begins_with_examples_that_are_understood(command, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "100")
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    assert ended.value.code == 0
    head, _, rest = capsys.readouterr().out.partition("Examples:\n")
    lines = [line.strip() for line in rest.split("\n\n")[0].splitlines()]
    assert head.startswith(f"usage: sounding {command}")
    assert 1 <= len(lines) <= 10
    for line in lines:
        words = shlex.split(line, comments=True)
        assert words[:2] == ["sounding", command]
        # An earlier run's file is read as the line is.
        if "--config" not in words:
            module = importlib.import_module(f"sim.cli.{COMMANDS[command]}")
            assert isinstance(parse_command(words[1:]), module.Options)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["episod"], "no such command.*Did you mean episode\\?"),
        (["episode", "--scenario", "livr"], "Did you mean liver\\?"),
        (["episode", "--planner", "rndom"], "--planner rndom: .*Did you mean random\\?"),
        (["episode", "--arm", "defalt"], "--arm defalt: .*Did you mean default\\?"),
        (["trials", "--study", "papr"], "Did you mean paper\\?"),
        (["episode", "--scenario", "case/liver.nii.gz"], "organ's file and not a scenario.*--organ"),
        (["episode", "--scenario", "."], "is a folder"),
        (
            ["episode", "--planner", "random", "--until-confident", "0.9"],
            "--until-confident 0.9: the planner random does not tell how sure it is\\. find-and-outline and find-",
        ),
        (["episode", "--miss-cost", "-5"], "--miss-cost -5.0: must be above 0\\."),
        (["episode", "--cone-depth-mm", "0"], "--cone-depth-mm 0.0: must be from 5 to 1000 mm\\."),
        (["episode", "--keepout-mm", "200"], "--keepout-mm 200.0: must be from 0 to 100 mm\\."),
        (["reach", "--keepout-mm", "200"], "--keepout-mm 200.0: must be from 0 to 100 mm\\."),
        (["episode", "--press-mm", "90", "--motion", "servo"], "--press-mm 90.0: must be from 0 to 40 mm\\."),
        (["episode", "--sure-radius-mm", "-1"], "--sure-radius-mm -1.0: must be above 0 and finite\\."),
    ],
)
def test_what_is_nearly_right_is_told_in_one_line(words, said, capsys, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == 2
    error = capsys.readouterr().err.strip()
    assert re.search(said, error), error
    assert "\n" not in error
    assert not re.search(r"_m\b|_rad\b", error)
    assert not list(tmp_path.iterdir())


def test_a_word_that_is_like_nothing_brings_no_suggestion() -> None:
    assert did_you_mean("kidney", ("sphere", "liver")) == ""
    assert did_you_mean("LIVER", ("sphere", "liver")) == " Did you mean liver?"


def test_a_typo_in_a_flag_tells_of_this_command_alone(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["episode", "--plannr", "random"])
    told = capsys.readouterr().err
    assert "--planner" in told
    assert "sounding episode --help" in told
    assert "sounding trials" not in told
    assert len(told.splitlines()) <= 15


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["trials", "--planner", "random", "--planner", "multi-resolution"], "--planner is given 2 times"),
        (
            ["episode", "--tumour", "a.stl", "--tumour=b.stl", "--tumour", "c.stl"],
            "--tumour is given 3 times",
        ),
        (["reach", "--arm", "a.xml", "--arm", "b.xml"], "--arm A B"),
    ],
)
def test_a_list_that_is_given_twice_is_refused_and_not_cut_short(capsys, words, said) -> None:
    assert main(words) == 2
    assert said in capsys.readouterr().err
