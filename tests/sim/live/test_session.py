"""A session proposes what an episode would do, needs no MuJoCo, and loses nothing when its process is killed."""

import json
import os
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mapping import DetailSettings, MapSettings, TrustSettings
from planner import make_planner
from sim.episode.episode import Episode
from sim.episode.planned.planned_organ import plan_organ
from sim.episode.scenario import SCENARIOS
from sim.episode.setup import build_setup
from sim.errors import UsageError
from sim.live.errors import RefusedError
from sim.live.session import Session
from sim.live.session_folder import SessionFolder
from sim.world.sensing.errors.erring_sensor import ErringSensor
from sim.world.sensing.reading import Reading

ROOT = Path(__file__).resolve().parents[3]
COARSE = MapSettings(hinge_spacing_m=0.02)
LIVER = replace(SCENARIOS["liver"], n_poses=400, score_spacing_m=0.01)
"""A liver whose map takes milliseconds."""


@pytest.fixture(scope="module")
def setup():
    return build_setup(LIVER, None, COARSE)


@pytest.fixture(scope="module")
def organ():
    return plan_organ(LIVER, COARSE)


def run_of(setup, planner, *, n_steps=6, seed=3, **options):
    """The poses and readings of an episode with a free-flying probe."""
    until_confident = options.pop("until_confident", None)
    episode = Episode(setup, planner, seed=seed, map_settings=COARSE, **options)
    steps = []
    for step in episode.steps(n_steps, until_confident=until_confident):
        steps.append((step.pose_index, step.reading))
        if planner.tells_confidence:
            episode.confidence()  # as the run's table does
    return steps, episode


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("find-and-outline", {"detail": DetailSettings()}),
        ("find-and-outline", {"trust": TrustSettings(learns=True), "sensor": ErringSensor()}),
        ("find-and-outline", {"trust": TrustSettings(), "sensor": ErringSensor(), "until_confident": 0.99}),
        ("expected-improvement", {}),
        ("thompson-sampling", {}),
        ("random", {}),
    ],
)
def test_readings_of_an_episode_lead_to_its_poses(setup, organ, name, options):
    planner = make_planner(name)
    steps, episode = run_of(setup, planner, **options)
    told = {field: options.get(field) for field in ("detail", "trust", "until_confident")}
    session = Session(organ, planner, seed=3, map_settings=COARSE, **told)
    assert session.situation().until_confident == episode.situation().until_confident
    for pose, reading in steps:
        proposal = session.propose()
        assert session.propose() is proposal
        assert proposal.pose_index == pose
        # The probe of the episode flew exactly there; MuJoCo's quaternions round.
        np.testing.assert_allclose(proposal.T_world_probe, reading.T_world_probe, atol=1e-9)
        assert session.observe(reading) == pose
    np.testing.assert_array_equal(session.prediction.latent_mean, episode.prediction.latent_mean)


def test_a_pose_that_is_declined_is_not_proposed_again(organ):
    session = Session(organ, make_planner("find-and-outline"), map_settings=COARSE)
    first = session.propose().pose_index
    session.decline(first, "the ribs are in the way")
    assert session.propose().pose_index != first
    assert session.propose().number == 1
    with pytest.raises(RefusedError, match="declined before"):
        session.decline(first)


def test_a_reading_that_cannot_be_one_is_refused_and_changes_nothing(organ):
    session = Session(organ, make_planner("find-and-outline"), map_settings=COARSE)
    wanted = session.propose()
    away = np.eye(4)
    away[:3, 3] = [5.0, 5.0, 5.0]
    empty = Reading(np.empty((0, 3)), np.empty(0, dtype=bool), wanted.T_world_probe)
    with pytest.raises(RefusedError, match="no point"):
        session.observe(empty)
    with pytest.raises(RefusedError, match="frame"):
        session.observe(Reading(organ.search_points_m[:5], np.zeros(5, dtype=bool), away))
    nan = Reading(np.full((1, 3), np.nan), np.ones(1, dtype=bool), wanted.T_world_probe)
    with pytest.raises(RefusedError, match="finite"):
        session.observe(nan)
    assert session.propose() is wanted
    assert session.readings == []


def test_a_reading_that_says_nothing_of_use_of_its_labels_is_refused_and_not_kept(organ, tmp_path):
    with SessionFolder(tmp_path / "out", {"seed": 1}) as folder:
        session = Session(organ, make_planner("random"), map_settings=COARSE, folder=folder)
        T, inside = session.propose().T_world_probe, organ.search_points_m[:5]
        reading = Reading(inside, np.zeros(5, dtype=bool), T, log_odds=np.full(5, np.nan))
        with pytest.raises(RefusedError, match="cannot be learnt from"):
            session.observe(reading)
        assert not list(folder.events())


def test_a_tip_beside_the_proposed_pose_counts_for_it_and_a_tip_elsewhere_for_the_nearest(organ):
    session = Session(organ, make_planner("find-and-outline"), map_settings=COARSE)
    proposal = session.propose()
    beside = proposal.T_world_probe.copy()
    beside[:3, 3] += 0.003
    some = organ.search_points_m[:20], np.zeros(20, dtype=bool)
    assert session.observe(Reading(*some, beside)) == proposal.pose_index
    session.propose()
    other = 77
    assert session.observe(Reading(*some, session.pose_matrix(other))) == other


KILLED = """
import sys
from pathlib import Path
sys.modules["mujoco"] = None  # an import of it would fail

import trimesh
from mapping import MapSettings
from planner import make_planner
from sim.episode.planned.planned_organ import plan_organ
from sim.episode.scenario import Scenario
from sim.live.session import Session
from sim.live.session_folder import SessionFolder
from sim.world.sensing.reading import Reading

coarse = MapSettings(hinge_spacing_m=0.02)
ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
organ = plan_organ(Scenario(organ=ball, n_poses=200, score_spacing_m=0.01), coarse)
folder = SessionFolder(Path({folder!r}), {{"seed": 1}})
session = Session(organ, make_planner("thompson-sampling"), seed=1, map_settings=coarse, folder=folder)
for _ in range({n}):
    proposal = session.propose()
    inside = organ.search_points_m[organ.cone.contains(
        organ.search_points_m, proposal.T_world_probe[:3, 3], proposal.T_world_probe[:3, 2])]
    reading = Reading(inside, inside[:, 0] > 0.5, proposal.T_world_probe)
    session.observe(reading)
    print(proposal.pose_index, flush=True)
{end}
"""


def poses_of(folder, n, end=""):
    code = KILLED.format(folder=str(folder), n=n, end=end)
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert run.returncode in (0, -signal.SIGKILL), run.stderr
    return run.returncode, [int(word) for word in run.stdout.split()]


def test_a_session_without_mujoco_goes_on_after_a_kill_as_if_it_had_not_been_killed(tmp_path):
    whole = poses_of(tmp_path / "whole", 5)[1]
    code, before = poses_of(tmp_path / "killed", 3, "import os; os.kill(os.getpid(), 9)")
    assert code == -signal.SIGKILL
    # What was being written when the process died is no event.
    (tmp_path / "killed" / "events" / ".00004.npz.part").write_bytes(b"half")
    after = poses_of(tmp_path / "killed", 2)[1]
    assert before + after == whole
    maps = [np.load(tmp_path / name / "map.npz")["latent_mean"] for name in ("whole", "killed")]
    np.testing.assert_array_equal(*maps)


def test_a_folder_goes_on_only_with_the_same_options_and_one_process_at_a_time(tmp_path):
    identity = {"planner": "random", "seed": 1}
    with SessionFolder(tmp_path / "here", identity), pytest.raises(UsageError, match="another session"):
        SessionFolder(tmp_path / "here", identity)
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "manifest.json").write_text('{"sounding": "0.1.0"}')
    with pytest.raises(UsageError, match="holds a run"):
        SessionFolder(tmp_path / "run", identity)
    with pytest.raises(UsageError, match=r"other values of `planner` \(.* then, .* now\)"):
        SessionFolder(tmp_path / "here", {"planner": "greedy-coverage", "seed": 1})
    # A session of an older version says nothing of what it was begun with, and learns it.
    SessionFolder(tmp_path / "filed", {"seed": 1}).close()
    SessionFolder(tmp_path / "filed", {"seed": 1, "simulate": False, "inputs": {"file liver": "a"}}).close()
    with pytest.raises(UsageError, match="began with another file liver"):
        SessionFolder(tmp_path / "filed", {"seed": 1, "simulate": False, "inputs": {"file liver": "b"}})
    SessionFolder(tmp_path / "here", identity).close()
    assert "sounding" in json.loads((tmp_path / "here" / "session.json").read_text())["machine"]


def test_a_session_that_fails_before_anything_was_kept_leaves_no_session(organ, tmp_path):
    for name, n_declined in (("none", 0), ("some", 1)):
        with suppress(OSError), SessionFolder(tmp_path / name, {"seed": 1}) as folder:
            session = Session(organ, make_planner("random"), map_settings=COARSE, folder=folder)
            for pose in range(n_declined):
                session.decline(pose)
            raise OSError
    assert not (tmp_path / "none").exists()
    with SessionFolder(tmp_path / "some", {"seed": 1}) as folder:
        assert len(list(folder.events())) == 1


def test_a_broken_event_is_told_with_its_file(organ, tmp_path):
    with SessionFolder(tmp_path / "here", {}) as folder:
        session = Session(organ, make_planner("random"), map_settings=COARSE, folder=folder)
        session.decline(session.propose().pose_index)
        file = tmp_path / "here" / "events" / "00001.npz"
        file.write_bytes(os.urandom(100))
        with pytest.raises(UsageError, match=r"00001\.npz: cannot be read"):
            Session(organ, make_planner("random"), map_settings=COARSE, folder=folder)
