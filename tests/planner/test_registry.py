"""The planners by name."""

import pytest

from planner import (
    Planner,
    PlannerError,
    confident_planner_names,
    make_planner,
    planner_class,
    planner_names,
    weighing_planner_names,
)


def test_a_planner_by_name_is_made_from_the_class_of_that_name():
    for name in planner_names():
        assert type(make_planner(name)) is planner_class(name)
        assert issubclass(planner_class(name), Planner)


def test_the_planners_that_tell_how_sure_they_are_are_known_by_name():
    told = {name for name in planner_names() if make_planner(name).tells_confidence}
    assert set(confident_planner_names()) == told == {"find-and-outline", "find-and-outline-paths"}
    weighing = {name for name in planner_names() if make_planner(name).weighs_cost}
    assert set(weighing_planner_names()) == weighing == {"find-and-outline", "find-and-outline-paths"}


@pytest.mark.parametrize("look_up", [planner_class, make_planner])
def test_a_name_that_no_planner_has_is_refused_with_those_that_exist(look_up):
    with pytest.raises(PlannerError, match="no planner 'best'; choose one of expected-improvement, find"):
        look_up("best")


def test_an_option_that_a_planner_does_not_have_is_refused_with_those_that_it_has():
    with pytest.raises(PlannerError, match="has no option 'speed'; it has values, pose_rule"):
        make_planner("expected-improvement", speed=1)
    with pytest.raises(PlannerError, match="has no option 'speed'; it has none"):
        make_planner("random", speed=1)
