"""The page of a comparison: its tables and curves, links to runs that have folders, and nothing from outside."""

from __future__ import annotations

import re

import numpy as np
import pytest
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
