"""Runs of episodes on one page: figures of each, curves over each other, and one slider for all views."""

from __future__ import annotations

import csv
import json
import re

import pytest
from opened_page import Opened

from sim.cli.command_line import main
from sim.comparison.compare import compare
from sim.errors import UsageError
from sim.running.run_episode import run_episode

ACTIONS = {"random": 3, "find-and-outline": 2}


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The folders of two runs on the same tumours, and of one on others."""
    folder = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sim.pictures.run_figures.draw_run_figures", lambda *_: None)
        for name, planner, seed in (("a", "random", 0), ("b", "find-and-outline", 0), ("other", "random", 1)):
            run_episode(
                scenario="sphere", planner=planner, seed=seed, arm="none", motion="none", steps=ACTIONS[planner],
                out=folder / name, report=name == "a", show_progress=False,
            )  # fmt: skip
    return folder


@pytest.fixture(scope="module")
def compared(runs):
    return compare([runs / "a", runs / "b"])


def test_the_table_holds_the_figures_of_each_run(runs, compared) -> None:
    assert compared.folder == runs / "a" / "compare-b"
    rows = {row["name"]: row for row in csv.DictReader((compared.folder / "compare.csv").open())}
    assert list(rows) == ["random", "find-and-outline"]
    for name, folder in (("random", "a"), ("find-and-outline", "b")):
        summary = json.loads((runs / folder / "summary.json").read_text())
        assert rows[name]["sensing actions"] == str(ACTIONS[name]) == str(summary["n_sensings"])
        assert rows[name]["AUPRC of the map"] == f"{summary['auprc']:.3f}"
        assert rows[name]["of the tumours sensed"] == f"{summary['sensed_fraction']:.1%}"
        assert f"{summary['auprc']:.3f}" in compared.text
    # The same tumours stand in one row.
    assert any(name.startswith("tumour 1, ") for name in rows["random"])
    assert "do not face" not in compared.text
    assert (compared.folder / "compare.md").read_text(encoding="utf-8") == compared.text


def test_the_page_links_to_the_reports_that_are_there(compared) -> None:
    page = (compared.folder / "report.html").read_text(encoding="utf-8")
    assert re.findall(r'<a href="([^"]+)"', page) == ["../report.html"]
    assert "random against find-and-outline" in page


def test_runs_on_other_tumours_are_compared_with_a_word_of_warning(runs, tmp_path) -> None:
    text = compare([runs / "a", runs / "other"], tmp_path / "both").text
    assert "do not face the same tumours" in text
    assert "random (a) | random (other)" in text
    assert "tumour 1, " not in text


def test_one_slider_and_one_camera_move_the_views_of_all_runs(browser, compared) -> None:
    opened = Opened(browser, compared.folder / "report.html", viewport={"width": 1280, "height": 900})
    page = opened.ready()
    steps = "window.soundingReport.states.map(state => state.step)"
    assert page.locator("#number").inner_text() == "3 of 3"
    # The shorter run stays at its last action.
    assert page.evaluate(steps) == [3, 2]
    assert page.locator("#told-1").inner_text().startswith("Ended after 2")
    marks = page.locator("svg[data-chart=sensed] .now")
    assert marks.count() == 2
    before = [marks.nth(i).get_attribute("cx") for i in range(2)]
    page.locator("#slider").fill("1")
    assert page.evaluate(steps) == [1, 1]
    after = [marks.nth(i).get_attribute("cx") for i in range(2)]
    assert before[0] != before[1]
    assert after[0] == after[1] != before[0]
    other = page.locator("#view-1")
    page.wait_for_timeout(200)
    picture = other.screenshot()
    box = page.locator("#canvas").bounding_box()
    page.mouse.move(box["x"] + 100, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 220, box["y"] + 230, steps=4)
    page.mouse.up()
    page.wait_for_timeout(300)
    assert other.screenshot() != picture
    # A layer is switched in all views.
    picture = other.screenshot()
    page.locator("#legend input[name=organ]").uncheck()
    page.wait_for_timeout(200)
    assert other.screenshot() != picture
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert opened.complaints == []
    opened.context.close()


@pytest.mark.parametrize(
    ("names", "more", "said"),
    [
        (["a"], [], "is one run. Name another run beside it; `sounding report .*a` makes the page of one"),
        (["a", "."], [], "holds a run of `sounding episode`, and .* neither a run nor a campaign"),
        (["a", "b"], ["--view-seed", "0"], "--view-seed goes only with campaigns"),
        (["a", "b"], ["--out", "a"], "a: is not empty"),
        (
            ["."],
            [],
            "holds no campaign and no run. Name folders that `sounding trials` or `sounding episode`",
        ),
    ],
)
def test_what_cannot_stand_side_by_side_is_said(runs, monkeypatch, capsys, names, more, said) -> None:
    monkeypatch.chdir(runs)
    assert main(["compare", *names, *more]) == 2
    assert re.search(said, capsys.readouterr().err)


def test_a_campaign_does_not_stand_beside_a_run(runs, tmp_path) -> None:
    (tmp_path / "study.json").write_text('{"format": 1}')
    with pytest.raises(UsageError, match="a campaign. Name runs alone, or campaigns alone"):
        compare([runs / "a", tmp_path])
