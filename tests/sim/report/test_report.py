"""The report: made from a run's folder alone, whatever state it is in, and self-contained."""

from __future__ import annotations

import base64
import csv
import json
import re
import shutil
import zlib
from html.parser import HTMLParser

import numpy as np
import pytest
from shared_runs import N_ARM_ACTIONS

from sim.cli.command_line import main
from sim.comparison.series_charts import Series, series_chart, span_of
from sim.report.charts import count_ticks, curve_chart, progress_chart, reliability
from sim.report.view_data import thinned_steps


@pytest.fixture
def run(arm_run, tmp_path):
    return shutil.copytree(arm_run, tmp_path / "run")


class Page(HTMLParser):
    """Elements by name with their attributes, and the text of those with an id."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[str, str] = {}
        self._id: str | None = None
        self.feed(text)

    def handle_starttag(self, tag, attrs) -> None:
        self.elements.append((tag, dict(attrs)))
        self._id = dict(attrs).get("id")

    def handle_data(self, data) -> None:
        if self._id:
            self.texts[self._id] = self.texts.get(self._id, "") + data


def page_of(folder) -> Page:
    return Page((folder / "report.html").read_text(encoding="utf-8"))


def unpacked(page: Page, place: dict) -> np.ndarray:
    content = zlib.decompress(base64.b64decode(page.texts["packed"]))
    return np.frombuffer(content, np.dtype(place["kind"]), place["n"], place["at"])


def test_the_page_names_nothing_outside_itself(arm_run) -> None:
    page = page_of(arm_run)
    for tag, attributes in page.elements:
        for name in ("src", "href", "srcset", "action", "data"):
            assert (attributes.get(name) or "data:").startswith(("data:", "#")), (tag, name)
    text = (arm_run / "report.html").read_text(encoding="utf-8")
    assert not re.findall(r"@import|url\(", re.search(r"<style>(.*?)</style>", text, re.DOTALL)[1])
    assert (arm_run / "report.html").stat().st_size < 15_000_000


def test_the_page_holds_the_runs_numbers(arm_run) -> None:
    page, summary = page_of(arm_run), json.loads((arm_run / "summary.json").read_text())
    data = json.loads(page.texts["data"])
    assert data["n_steps"] == N_ARM_ACTIONS
    text = (arm_run / "report.html").read_text(encoding="utf-8")
    assert f"{summary['auprc']:.3f}" in text
    assert f"{summary['sensed_fraction']:.1%}" in text
    findings = json.loads((arm_run / "findings.json").read_text())
    assert f"{findings['n_tumours_found']} of 1" in text


def test_poses_and_the_last_map_are_those_of_the_folder(arm_run) -> None:
    page = page_of(arm_run)
    view = json.loads(page.texts["data"])["view"]
    tips = unpacked(page, view["probe"]).reshape(-1, 4, 4)
    rows = list(csv.DictReader((arm_run / "poses.csv").open()))
    x = [float(row["T_world_probe_position_x_m"]) for row in rows]
    np.testing.assert_allclose(tips[:, 0, 3], x, atol=1e-6)
    maps = [unpacked(page, place).astype(np.int64) for place in view["map"]["maps"]]
    last = maps[-1] * view["map"]["log_odds_step"]
    with np.load(arm_run / "map.npz") as arrays:
        probability = arrays["probability"][arrays["is_inside"]].astype(np.float64)
        inside = np.unpackbits(unpacked(page, view["map"]["inside"]), bitorder="little")[
            : arrays["is_inside"].size
        ]
        np.testing.assert_array_equal(inside.astype(bool), arrays["is_inside"].ravel())
    log_odds = np.log(probability / (1 - probability))
    np.testing.assert_allclose(last, np.clip(log_odds, -6.35, 6.35), atol=0.03)


def test_the_arms_last_link_ends_at_the_recorded_tip(arm_run) -> None:
    page = page_of(arm_run)
    view = json.loads(page.texts["data"])["view"]
    poses = unpacked(page, view["arm"]["poses"]).reshape(N_ARM_ACTIONS + 1, view["arm"]["n_bodies"], 7)
    tips = unpacked(page, view["probe"]).reshape(-1, 4, 4)
    # The probe's tip lies 160 mm beyond the origin of its body, along the beam.
    np.testing.assert_allclose(poses[1:, -1, :3] + 0.16 * tips[:, :3, 2], tips[:, :3, 3], atol=1e-5)


def test_the_report_is_written_anew_and_the_same(run, capsys) -> None:
    before = (run / "report.html").read_bytes()
    (run / "report.html").unlink()
    assert main(["report", str(run)]) == 0
    assert "report.html" in capsys.readouterr().out
    assert (run / "report.html").read_bytes() == before


def test_a_killed_run_has_a_report(run) -> None:
    for name in (
        "summary.json",
        "poses.json",
        "tumours.csv",
        "false_findings.csv",
        "findings.json",
        "report.html",
    ):
        (run / name).unlink()
    manifest = json.loads((run / "manifest.json").read_text()) | {"status": "unfinished"}
    (run / "manifest.json").write_text(json.dumps(manifest))
    rows = (run / "steps.csv").read_text().splitlines(keepends=True)
    (run / "steps.csv").write_text("".join(rows[:-1]) + rows[-1][:20])  # the last row cut short
    assert main(["report", str(run)]) == 0
    text = (run / "report.html").read_text(encoding="utf-8")
    assert "This run is unfinished" in text
    assert json.loads(page_of(run).texts["data"])["n_steps"] == N_ARM_ACTIONS - 1
    assert (run / "tumours.csv").exists()


def test_a_run_killed_before_its_first_action_has_a_report(run) -> None:
    for name in ("summary.json", "steps.csv", "poses.csv", "skipped.csv", "states.csv", "map.npz"):
        (run / name).unlink(missing_ok=True)
    for folder in ("maps", "motion", "surfaces"):
        shutil.rmtree(run / folder, ignore_errors=True)
    assert main(["report", str(run)]) == 0
    assert json.loads(page_of(run).texts["data"])["n_steps"] == 0


def test_no_report_writes_none(no_figures, tmp_path) -> None:
    out = tmp_path / "run"
    arguments = [
        "--scenario",
        "sphere",
        "--planner",
        "random",
        "--steps",
        "1",
        "--arm",
        "none",
        "--map",
        "when-needed",
    ]
    assert main(["episode", *arguments, "--out", str(out), "--no-report"]) == 0
    assert not (out / "report.html").exists()
    assert (out / "tumours.csv").exists()
    assert main(["report", str(out)]) == 0  # without a map there is one too
    assert '"map":null' in (out / "report.html").read_text(encoding="utf-8")


def test_what_is_no_run_is_one_clear_line(run, tmp_path, capsys) -> None:
    assert main(["report", str(tmp_path)]) == 2
    assert "holds no run" in capsys.readouterr().err
    (run / "config.json").write_text("{")
    assert main(["report", str(run)]) == 2
    assert "config.json: cannot be read" in capsys.readouterr().err
    assert main(["report"]) == 2


def test_text_of_a_run_cannot_become_markup(run) -> None:
    config = json.loads((run / "config.json").read_text())
    config["scenario"]["name"] = "</script><script>alert(1)</script>"
    (run / "config.json").write_text(json.dumps(config))
    assert main(["report", str(run)]) == 0
    assert "<script>alert" not in (run / "report.html").read_text(encoding="utf-8")


def test_the_view_needs_no_arms_file(run) -> None:
    config = json.loads((run / "config.json").read_text())
    config["options"]["arm"] = "gone.xml"
    (run / "config.json").write_text(json.dumps(config))
    assert main(["report", str(run)]) == 0
    assert json.loads(page_of(run).texts["data"])["view"]["arm"] is None


def test_thinned_steps_keep_both_ends() -> None:
    assert thinned_steps([1, 2, 3], 10) == [1, 2, 3]
    chosen = thinned_steps(list(range(1, 1001)), 50)
    assert len(chosen) == 50
    assert (chosen[0], chosen[-1]) == (1, 1000)
    assert thinned_steps([4, 5, 6], 0)[-1] == 6


def test_a_curve_carries_its_points_and_skips_what_is_undefined() -> None:
    svg = progress_chart("auprc", [np.array([0.1, np.nan, 0.9])], colours=["map"], y_top=1.0, label="x")
    (data,) = json.loads(Page(svg).elements[0][1]["data-follow"])
    assert data["texts"] == ["0.10", "–", "0.90"]
    assert data["points"][1] is None
    (x1, y1), (x3, y3) = data["points"][0], data["points"][2]
    assert x1 < x3
    assert y1 > y3  # down is less
    assert progress_chart("auprc", [np.array([np.nan])], colours=["map"], label="x") == ""
    assert "10<tspan" in progress_chart("ei", [np.array([1.0, 1e-4])], colours=["probe"], label="x")


def test_reliability_is_the_share_in_each_bin() -> None:
    rng = np.random.default_rng(0)
    probability = rng.random(200_000)
    truth = rng.random(200_000) < probability**2
    predicted, observed, counts = reliability(probability, truth)
    assert counts.sum() == 200_000
    np.testing.assert_allclose(observed, predicted**2, atol=0.01)


def test_ticks_are_whole_and_few() -> None:
    for n in (0, 1, 7, 30, 999, 14_400):
        ticks = count_ticks(n)
        assert 1 <= len(ticks) <= 8
        assert ticks[-1] <= n


def test_charts_of_many_are_drawn() -> None:
    x = np.arange(1.0, 5.0)
    one = Series(name="a<b", index=0, x=x, middle=x / 5, low=x / 6, high=x / 4)
    two = Series(name="c", index=9, x=x, middle=x / 8, is_step=True)
    svg = series_chart([one, two], label="both", is_log=True)
    assert svg.count("<polyline") == 2
    assert svg.count("<polygon") == 1
    assert "a&lt;b" in svg
    assert curve_chart(np.array([0.0, 1.0]), np.array([1.0, 0.5]), colour="map", label="x").startswith("<svg")
    low, high = span_of([3.0], [(np.nan, np.nan)], from_zero=True)
    assert low == 0.0 < 3.0 < high


def test_a_force_that_was_wanted_is_compared_with_the_one_there_was(run) -> None:
    with (run / "steps.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert main(["report", str(run)]) == 0
    assert "Force beside the one wanted" not in (run / "report.html").read_text(encoding="utf-8")
    with (run / "steps.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, [*rows[0], "force_error_n"])
        table.writeheader()
        # Above and below: what counts is how far off it was, so that the largest is 0.02.
        table.writerows(row | {"force_error_n": (-1) ** i * 0.02 / (i + 1)} for i, row in enumerate(rows))
    assert main(["report", str(run)]) == 0
    text = (run / "report.html").read_text(encoding="utf-8")
    assert 'data-chart="force-error"' in text
    row = re.search(r"Force beside the one wanted \[N\]</th>(.*?)</tr>", text)
    assert row is not None
    assert re.findall(r">([\d.]+)<", row[1])[1] == "0.02"
