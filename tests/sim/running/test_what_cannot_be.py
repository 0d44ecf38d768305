"""Values, objects and maps that cannot be: each is told by the name that people use, and none runs as another."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from mapping import Prediction
from planner import FindAndOutline, LesionPrior, Planner, RandomOrder
from sim.campaign.study import make_study
from sim.cli.command_line import main
from sim.episode.scenario import SCENARIOS
from sim.errors import FieldError, UsageError
from sim.running.fields import config_of, default_of, field_names, read_config
from sim.running.parts import check_config, make_parts
from sim.running.run_episode import run_episode
from sim.world.scene.named_arms import named_arm

QUICK = {"arm": "none", "motion": "none", "steps": 2, "report": False, "show_progress": False}
FLOATS = [name for name in field_names() if isinstance(default_of(name), float)] + [
    *("until_sensed", "cone_depth_mm", "cone_half_angle_deg", "keepout_mm", "joint_speed", "prior_prevalence")
]


@pytest.mark.parametrize("name", FLOATS)
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_number_that_is_none_is_refused_by_the_name_of_its_field(name, value) -> None:
    with pytest.raises(FieldError) as error:
        config_of({name: value})
    assert error.value.field == name


@pytest.mark.parametrize(
    ("field", "more"),
    [
        ("sure_radius_mm", {"sure_radius_mm": 0.0}),
        ("lesion_number", {"lesion_number": 0.0}),
        ("lesion_number_shape", {"lesion_number_shape": -1.0}),
        ("lesion_diameter_mm", {"lesion_diameter_mm": 4.0}),
        ("lesion_diameter_spread", {"lesion_diameter_spread": 9.0}),
        ("ei_threshold_deg", {"ei_threshold_deg": 400.0, "planner": "expected-improvement"}),
        ("ei_exclusion_share", {"ei_exclusion_share": -1.0, "planner": "expected-improvement"}),
        ("em_iterations", {"em_iterations": 0}),
        ("prior_prevalence", {"prior_prevalence": 1.5}),
        ("tip_speed_mm_s", {"tip_speed_mm_s": 0.0}),
        ("press_mm", {"press_mm": 99.0}),
        ("force_limit_n", {"force_limit_n": -1.0}),
        ("n_tumours", {"n_tumours": -1}),
        ("cone_depth_mm", {"cone_depth_mm": 0.0}),
        ("cone_half_angle_deg", {"cone_half_angle_deg": 0.5}),
        ("keepout_mm", {"keepout_mm": 500.0}),
    ],
)
def test_what_a_part_refuses_is_told_by_the_field_that_was_set(field, more) -> None:
    with pytest.raises(FieldError) as error:
        check_config(config_of(more))
    assert error.value.field == field
    assert error.value.value == more[field]


def test_the_command_line_tells_it_by_its_flag(capsys) -> None:
    assert main(["episode", "--scenario", "sphere", "--press-mm", "99"]) == 2
    assert capsys.readouterr().err.startswith("sounding: --press-mm 99.0: must be from 0 to 40 mm.")


def test_a_class_in_place_of_an_object_is_told() -> None:
    with pytest.raises(UsageError, match=r"RandomOrder is a class. Give an object of it, RandomOrder\(\)"):
        make_parts(config_of(), planner=RandomOrder)  # type: ignore[arg-type]


def test_a_planner_that_prefers_no_map_that_there_is_is_told() -> None:
    class Odd(RandomOrder):
        preferred_map = "papr"  # type: ignore[assignment]

    with pytest.raises(UsageError, match="Odd.preferred_map is 'papr'; it must be paper or calibrated"):
        make_parts(config_of(), planner=Odd())


class NoPrediction:
    """A map that answers with an array."""

    def __init__(self, space) -> None:
        self.space = space

    def update(self, points_m, is_occupied) -> None:
        pass

    def predict_lattice(self):
        return np.zeros(len(self.space.points_m))

    def save(self, path) -> None:
        raise OSError("the map's disk is full")


class TooShort(NoPrediction):
    """A map that answers for too few points."""

    def predict_lattice(self):
        return Prediction.from_probability(np.full(7, 0.1))


class NotSaved(NoPrediction):
    """A map that cannot be saved."""

    def predict_lattice(self):
        return Prediction.from_probability(np.full(len(self.space.points_m), 0.1))


@pytest.mark.parametrize(
    ("tumour_map", "text"),
    [
        (NoPrediction, "must return a Prediction"),
        (TooShort, "returned 7 values; it must return one for each"),
        (NotSaved, "the map's disk is full"),
    ],
)
def test_a_map_that_does_wrong_is_told_and_its_run_has_failed(tmp_path, tumour_map, text) -> None:
    with pytest.raises((ValueError, OSError), match=text):
        run_episode(scenario="sphere", planner="random", tumour_map=tumour_map, out=tmp_path / "run", **QUICK)
    assert json.loads((tmp_path / "run" / "manifest.json").read_text())["status"] == "failed"


@pytest.mark.parametrize(
    ("name", "told"),
    [("nothing", "returned None"), ("half", "returned a Half without predict_lattice and save")],
)
def test_a_map_named_by_text_that_is_none_is_told_before_anything_is_written(
    tmp_path, monkeypatch, capsys, name, told
) -> None:
    code = "class Half:\n    def update(self, points_m, is_occupied): pass\n"
    code += "def nothing(space): return None\ndef half(space): return Half()\n"
    (tmp_path / "no_maps.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    options = ["--scenario", "sphere", "--arm", "none", "--steps", "1", "--out", "run"]
    assert main(["episode", "--map", f"no_maps:{name}", *options]) == 2
    assert f"--map 'no_maps:{name}' {told}; a map has the methods" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


@dataclass(frozen=True)
class Weighted(RandomOrder):
    """A planner with a setting that no text on the command line holds."""

    weights: tuple[float, ...] = (1.0,)
    gain: float = 1.0


class WithArgument(RandomOrder):
    """A planner whose setting only its constructor knows."""

    def __init__(self, n: int) -> None:
        self.n = n


def run_with(folder: Path, **given) -> Path:
    run_episode(**({"scenario": "sphere", "planner": "random"} | given), out=folder, **QUICK)
    return folder / "config.json"


def test_a_run_whose_settings_its_file_holds_repeats(tmp_path) -> None:
    path = run_with(tmp_path / "run", planner=Weighted(gain=3.0))
    assert read_config(path).planning.planner_option == ("gain=3.0",)


@pytest.mark.parametrize(
    "given",
    [
        {"planner": Weighted(weights=(100.0, 50.0))},
        {"planner": WithArgument(300)},
        {"scenario": replace(SCENARIOS["sphere"], cone_depth_m=0.08)},
    ],
    ids=["a setting that is no number", "an argument", "a scenario"],
)
def test_a_run_whose_settings_its_file_does_not_hold_is_not_run_as_another(tmp_path, given, capsys) -> None:
    path = run_with(tmp_path / "run", **given)
    assert main(["episode", "--config", str(path), "--out", str(tmp_path / "again")]) == 2
    assert "was made in memory by a script" in capsys.readouterr().err
    assert not (tmp_path / "again").exists()


def test_a_planner_that_replaces_another_does_not_get_its_options(tmp_path) -> None:
    path = run_with(tmp_path / "run", planner=Weighted(gain=3.0))
    arguments = ["--config", str(path), "--planner", "multi-resolution", "--out", str(tmp_path / "again")]
    assert main(["episode", *arguments]) == 0


def test_an_arm_may_be_an_object(tmp_path) -> None:
    run_episode(
        scenario="sphere", planner="random", arm=named_arm("default", base_m=(0.0, 0.0, 0.05)),
        out=tmp_path / "run", **{name: value for name, value in QUICK.items() if name != "arm"},
    )  # fmt: skip
    config = read_config(tmp_path / "run" / "config.json")
    assert config.mounting.base_mm == pytest.approx((0.0, 0.0, 50.0))
    assert make_parts(config).arm == named_arm(config.arm, base_m=(0.0, 0.0, 0.05))


def test_every_planner_of_ours_is_a_planner() -> None:
    assert isinstance(Weighted(), Planner)


def test_a_confidence_to_stop_at_is_refused_where_the_planner_never_tells_one() -> None:
    with pytest.raises(
        FieldError, match="the planner greedy-coverage does not tell how sure it is. find-and-ou"
    ):
        check_config(config_of(planner="greedy-coverage", until_confident=0.9))
    # What a script brings along is looked at too, whatever planner the options name.
    for planner, name in ((RandomOrder(), "random"), (Weighted(), "Weighted")):
        with pytest.raises(FieldError, match=f"until_confident=0.9: the planner {name} does not tell"):
            make_parts(config_of(until_confident=0.9), planner=planner)
    assert make_parts(config_of(until_confident=0.9)).until_confident == 0.9


def test_the_cost_of_a_miss_is_refused_where_the_planner_does_not_weigh_it() -> None:
    with pytest.raises(
        FieldError,
        match=r"miss_cost=90.0: the planner random does not weigh .* find-and-outline and .* do",
    ):
        check_config(config_of(planner="random", miss_cost=90.0))
    with pytest.raises(FieldError, match="miss_cost=90.0: the planner Weighted does not weigh"):
        make_parts(config_of(miss_cost=90.0), planner=Weighted())
    parts = make_parts(config_of(miss_cost=90.0, until_confident=0.9, lesion_diameter_mm=20.0))
    assert parts.stops == {"until_sensed": None, "until_confident": 0.9, "miss_cost": 90.0}
    assert isinstance(parts.planner, FindAndOutline)
    assert parts.planner.lesions == LesionPrior(median_diameter_m=0.020)


def test_a_study_whose_planner_tells_no_confidence_is_refused_before_it_runs() -> None:
    with pytest.raises(FieldError, match="the planner random does not tell how sure it is"):
        make_study(planner=["find-and-outline", "random"], until_confident=0.9, arm="none")
