"""The page of a comparison: its tables and curves, links to runs that have folders, and nothing from outside."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from PIL import Image
from test_compare import entry, map_entry, write

from sim.campaign.study import Trial
from sim.comparison.compare import compare
from sim.running.fields import config_of

SEEDS = 8


@pytest.fixture
def campaign(tmp_path):
    rng = np.random.default_rng(0)
    entries = []
    for seed in range(SEEDS):
        needed = int(rng.integers(15, 60))
        entries.append(entry(seed, "random", needed=needed))
        entries.append(entry(seed, "expected-improvement", needed=None if seed < 2 else needed - 10))
        entries.append(map_entry(seed, "random", np.linspace(0.1, 0.5 + 0.02 * seed, 6).tolist()))
    return write(tmp_path / "campaign", entries)


def test_the_page_holds_every_case_measure_and_contender(campaign) -> None:
    summary = compare((campaign,))
    text = (summary.folder / "report.html").read_text(encoding="utf-8")
    assert "sphere, arm none" in text
    assert "liver, arm default" in text
    assert "2 of 8" in text  # never got there
    means = re.findall(r"\d+\.\d ± \d+\.\d", summary.text)
    assert means
    assert all(mean in text for mean in means)  # the same numbers as in compare.md
    assert text.count("<polyline") >= 4
    assert text.count("<polygon") >= 2  # spreads
    assert not re.search(r'(?:src|href)="(?!data:)', text)  # no run has a folder
    assert "<script" not in text


def test_runs_that_have_a_report_are_linked(campaign, tmp_path) -> None:
    config = config_of(entry(3, "random", needed=20)["settings"])
    folder = campaign / "trials" / Trial(config).name
    folder.mkdir(parents=True)
    (folder / "report.html").write_text("here")
    out = tmp_path / "elsewhere" / "compare"
    compare((campaign,), out=out)
    (address,) = re.findall(r'href="([^"]+report\.html)"', (out / "report.html").read_text(encoding="utf-8"))
    assert (out / address).resolve() == (folder / "report.html").resolve()


def test_the_page_names_study_day_version_and_command_and_puts_contenders_side_by_side(campaign) -> None:
    study = json.loads((campaign / "study.json").read_text())
    study["machine"] |= {"command": ["trials", "--study", "small one"], "commit": "0123456789abcdef"}
    study |= {"started": "2026-03-04T05:06:07+00:00", "notices": ["liver.stl: two of its holes were closed"]}
    (campaign / "study.json").write_text(json.dumps(study))
    for seed in range(2):
        for name, colour in (("random", "red"), ("expected-improvement", "blue")):
            config = config_of(entry(seed, name, needed=20)["settings"])
            folder = campaign / "trials" / Trial(config).name
            folder.mkdir(parents=True)
            Image.new("RGB", (900, 600), colour).save(folder / "map_top.png")
    text = (compare((campaign,)).folder / "report.html").read_text(encoding="utf-8")
    for words in ("2026-03-04", "commit 01234567", "trials --study &#39;small one&#39;", "two of its holes"):
        assert words in text
    assert "<h1>random against expected-improvement</h1>" in text
    assert text.count('<img src="data:image/webp') == 4
    table = text[text.index("Numbers by seed") :]
    assert table[: table.index("</table>")].count('<th scope="row"') == SEEDS


def test_all_columns_are_seen_at_800_px_and_a_chart_has_a_human_size(browser, campaign) -> None:
    page = browser.new_page(viewport={"width": 800, "height": 900})
    page.goto((compare((campaign,)).folder / "report.html").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= 800
    hidden = "[...document.querySelectorAll('h3 + .wide')].map(each => each.scrollWidth - each.clientWidth)"
    assert max(page.evaluate(hidden)) == 0
    page.set_viewport_size({"width": 1600, "height": 900})
    widths = page.evaluate("[...document.querySelectorAll('.triple svg')].map(each => each.clientWidth)")
    assert 250 <= min(widths) <= max(widths) <= 500
    page.close()
