"""Studies: every combination once, every mistake with its line."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner import planner_names
from sim.campaign.study import NOT_AXES, Part, Study, key_of, option_names, parse_seeds
from sim.campaign.study_file import load_study, study_names
from sim.cli.trials import Options
from sim.episode.scenario import SCENARIOS
from sim.errors import UsageError
from sim.running.fields import config_of, field_names

GOOD = """
title = "mine"

[episode]
scenario = "sphere"
arm = "none"
until-sensed = 1

[axes]
planner = ["random", "multi-resolution"]
prior-prevalence = [0.5, 0.1]
seed = "5:8"

[[part]]

[[part]]
[part.episode]
steps = 7
[part.axes]
scenario = ["spheres", "liver"]
seed = [1, "10:12"]
"""


def study_of(tmp_path, text: str) -> Study:
    (tmp_path / "study.toml").write_text(text)
    return load_study(str(tmp_path / "study.toml"))


def test_every_option_of_an_episode_may_be_an_axis() -> None:
    assert set(option_names()) == set(field_names()) - set(NOT_AXES)


@settings(max_examples=30)
@given(
    scenarios=st.lists(st.sampled_from(sorted(SCENARIOS)), min_size=1, max_size=3, unique=True),
    planners=st.lists(st.sampled_from(planner_names()), min_size=1, max_size=3, unique=True),
    steps=st.lists(st.integers(1, 500), min_size=1, max_size=3, unique=True),
    first=st.integers(0, 1000),
    count=st.integers(1, 5),
)
def test_a_part_has_every_combination_once(scenarios, planners, steps, first, count) -> None:
    seeds = range(first, first + count)
    part = Part({"steps": steps, "seed": seeds, "planner": planners, "scenario": scenarios})
    trials = list(part.trials())
    found = [(t.config.scenario, t.config.planner, t.config.steps, t.config.seed) for t in trials]
    assert sorted(found) == sorted(itertools.product(scenarios, planners, steps, seeds))
    assert len(part) == len(trials) == len({trial.key for trial in trials})
    assert [name for name, _ in itertools.groupby(scenario for scenario, *_ in found)] == scenarios
    for trial in trials:
        assert config_of(trial.settings) == trial.config
        assert key_of(trial.settings) == trial.key


def test_parts_take_precedence_over_what_they_share(tmp_path) -> None:
    study = study_of(tmp_path, GOOD)
    first, second = study.parts
    assert len(study) == 2 * 2 * 3 + 2 * 2 * 2 * 3
    assert {trial.config.seed for trial in first.trials()} == {5, 6, 7}
    assert {trial.config.seed for trial in second.trials()} == {1, 10, 11}
    assert {trial.config.steps for trial in second.trials()} == {7}
    assert {trial.config.until_sensed for trial in study.trials()} == {1.0}
    assert {trial.config.scenario for trial in second.trials()} == {"spheres", "liver"}


@pytest.mark.parametrize(
    ("old", "new", "line", "text"),
    [
        ("until-sensed", "until-seen", 7, "unknown key 'until-seen'.*until_sensed"),
        ("title", "titel", 2, "unknown key 'titel'.*title, episode, axes, part"),
        ('"multi-resolution"', '\n  "greedy"', 11, "greedy: choose one of.*random"),
        ('"spheres"', '"kidney"', 20, "'kidney': not one of sphere"),
        ("steps = 7", "steps = 0", 18, "steps=0"),
        ("steps = 7", 'steps = "7"', 18, "steps='7': must be a whole number"),
        ("0.1]", "1.5]", 11, "prior_prevalence"),
        ("[0.5, 0.1]", "0.5", 11, "an axis is a list"),
        ('"5:8"', '"8:5"', 12, "the end must lie above"),
        ('"5:8"', "-1", 12, "a number from 0 on"),
        ("[[part]]\n\n", "[part]\n\n", None, "not a valid TOML file"),
        ('["random", "multi-resolution"]', "[]", 10, "no value"),
        ("[0.5, 0.1]", "[0.5, 0.5]", 11, "given twice"),
        ("arm = ", "planner = ", 6, "'planner' is given twice"),
    ],
)
def test_a_mistake_is_told_with_its_line(tmp_path, old, new, line, text) -> None:
    assert GOOD.count(old) == 1 or old == "title"
    with pytest.raises(UsageError, match=text) as caught:
        study_of(tmp_path, GOOD.replace(old, new, 1))
    if line is not None:
        assert f"line {line}:" in str(caught.value)


def test_paths_are_relative_to_the_study(tmp_path) -> None:
    (tmp_path / "case.toml").write_text('base = "sphere"')
    study = study_of(tmp_path, '[axes]\nscenario = ["case.toml"]\n[episode]\norgan = "organ.stl"')
    (trial,) = study.trials()
    assert trial.config.scenario == str(tmp_path / "case.toml")
    assert trial.config.organ == tmp_path / "organ.stl"


@pytest.mark.parametrize("name", study_names())
def test_the_studies_that_come_along_load(name: str) -> None:
    assert len(load_study(name)) > 3


def test_the_paper_s_study_has_its_trials() -> None:
    settings = [trial.settings for trial in load_study("paper").trials()]
    for planner in ("expected-improvement", "random", "multi-resolution"):
        sphere = [
            s for s in settings if (s["scenario"], s["planner"], s["arm"]) == ("sphere", planner, "none")
        ]
        assert [s["seed"] for s in sphere] == list(range(100))
        arms = ("none", "default") if planner == "expected-improvement" else ("none",)
        for scenario, arm in itertools.product(("spheres", "liver"), arms):
            found = [
                s for s in settings if (s["scenario"], s["planner"], s["arm"]) == (scenario, planner, arm)
            ]
            assert [s["seed"] for s in found] == list(range(10))


@pytest.mark.parametrize("text", ["3", "a:b", "5:", ":5", "5:5", "1.5", "-1:2", True])
def test_seeds_are_a_range_or_a_number(text) -> None:
    if text == "3":
        assert list(parse_seeds(text)) == [3]
        return
    with pytest.raises(UsageError, match="seeds"):
        parse_seeds(text)


def test_the_command_line_makes_a_study() -> None:
    options = Options(scenario=("sphere", "liver"), planner=("random",), trials=4, until_sensed=0.95)
    trials = list(options.make_study().trials())
    assert [(t.config.scenario, t.config.seed) for t in trials] == [
        *(("sphere", seed) for seed in range(4)),
        *(("liver", seed) for seed in range(4)),
    ]
    assert {t.config.mapping.map for t in trials} == {"when-needed"}
    [stopped] = Options(trials=1, miss_cost=90.0, until_confident=0.9).make_study().trials()
    assert (stopped.config.miss_cost, stopped.config.until_confident) == (90.0, 0.9)
    over = Options(study="quick", seeds="7:9", planner=("random",)).make_study()
    assert {(t.config.planner, t.config.seed) for t in over.trials()} == {("random", 7), ("random", 8)}


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"jobs": 0}, "jobs=0"),
        ({"trials": 0}, "trials=0"),
        ({"trials": 3, "seeds": "1:2"}, "give one of them"),
    ],
)
def test_options_out_of_range_are_named(given, text) -> None:
    with pytest.raises(UsageError, match=text):
        Options(**given)
