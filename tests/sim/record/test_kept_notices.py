"""What a person is told about the files is kept with the results, and told once in a campaign."""

import json

import pytest
import trimesh

from sim.campaign.campaign import run_trials
from sim.campaign.study import make_study
from sim.comparison.trial_groups import notes_on
from sim.running.run_episode import run_episode

WORDS = "implausible"
"""A word of the notice that a ball of 0.5 litres, which is too large for its name, brings about."""


@pytest.fixture
def organ(tmp_path) -> str:
    trimesh.creation.icosphere(subdivisions=3, radius=38.0).export(tmp_path / "ball.stl")
    return str(tmp_path / "ball.stl")


def test_a_run_keeps_its_notices_also_where_nobody_is_told(organ, tmp_path, capsys) -> None:
    options = {
        "organ": organ,
        "n_tumours": 1,
        "arm": "none",
        "motion": "none",
        "steps": 1,
        "planner": "random",
    }
    run_episode(**options, out=tmp_path / "run", frames="none", show_progress=False)
    notices = json.loads((tmp_path / "run" / "config.json").read_text())["notices"]
    assert any(WORDS in notice for notice in notices)
    assert WORDS not in capsys.readouterr().err
    assert WORDS in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")


def test_a_campaign_tells_each_notice_once_and_keeps_it(organ, tmp_path) -> None:
    told: list[str] = []
    study = make_study(
        "small", scenario="liver", organ=organ, n_tumours=1, arm="none", motion="none", steps=1, planner="random",
        map="when-needed", seed=[0, 1, 2],
    )  # fmt: skip
    done = run_trials(study, tmp_path / "campaign", jobs=1, notify=told.append)
    assert done.n_failed == 0
    assert sum(WORDS in notice for notice in told) == 1
    kept = json.loads((tmp_path / "campaign" / "study.json").read_text())["notices"]
    assert sorted(kept) == sorted(told)
    assert set(told) <= set(notes_on([tmp_path / "campaign"]))
