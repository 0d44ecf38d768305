"""Whatever stands in an arm's file, it works or is refused in one line; no library says a word."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections import Counter
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, note, settings
from hypothesis import strategies as st
from odd_arms import BESIDE_FILE, odd_arms

from sim.world.errors import WorldError
from sim.world.ik.kinematics import Kinematics
from sim.world.ik.settings import IkSettings
from sim.world.scene.arm import ArmModel
from sim.world.scene.base_room import check_base_room
from sim.world.scene.clearance import Clearance
from sim.world.scene.scene import build_scene

QUICK, MANY = 100, 4000
FLANGES = (None, None, None, None, "flange", "b1", "finger2", "world")
POSES_M = np.array([[0.5, 0.0, 0.12], [0.47, 0.03, 0.11], [0.5, -0.06, 0.06]])
NORMALS = np.array([[0.0, 0.0, -1.0], [0.4, -0.4, -np.sqrt(0.68)], [0.0, 1.0, 0.0]])
CHUNK_M = np.array([0.5, 0.0, 0.14]) + np.random.default_rng(0).normal(0.0, 0.02, (12, 3))


@contextmanager
def silence():
    """Raises on a warning of Python's, and on anything that is printed or logged below."""
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile() as printed:
        present, kept = Path.cwd(), [os.dup(1), os.dup(2)]
        os.chdir(folder)
        for stream in (1, 2):
            os.dup2(printed.fileno(), stream)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                yield
        finally:
            for stream, old in zip((1, 2), kept, strict=True):
                os.dup2(old, stream)
                os.close(old)
            os.chdir(present)
        printed.seek(0)
        said = printed.read().decode()
        assert said == "", said
        assert list(Path(folder).iterdir()) == []


def outcome_of(said: str, folder: Path) -> str:
    """The kind of a refusal: its first words, or MuJoCo's."""
    words = (
        said.removeprefix(f"{folder / 'arm.xml'}: ").removeprefix("MuJoCo cannot compile this arm: ").split()
    )
    return " ".join(words[:6])


def becomes(text: str, flange: str | None, folder: Path, anatomy, cone, distance) -> str:
    """What becomes of an arm: how it was refused, or whether poses were reached."""
    (folder / "arm.xml").write_text(text, encoding="utf-8")
    (folder / "beside.xml").write_text(BESIDE_FILE, encoding="utf-8")
    try:
        scene = build_scene(anatomy, cone, arm=ArmModel(path=folder / "arm.xml", flange=flange))
        check_base_room(scene, distance)
    except WorldError as error:
        said = str(error)
        assert said == " ".join(said.split())
        assert said.endswith((".", "?")), said
        assert len(said) > 30
        return "refused: " + outcome_of(said, folder)
    assert all(notice == " ".join(notice.split()) and notice.endswith(".") for notice in scene.notices)
    assert np.isfinite(scene.home_q).all()
    kinematics = Kinematics(scene, Clearance(scene, distance), IkSettings(max_restarts=2, n_compared=2))
    results = kinematics.solve_many(POSES_M, NORMALS)
    results += kinematics.search.search(CHUNK_M, np.tile(NORMALS[0], (12, 1))).results
    chain = kinematics.search.chain
    for result in results:
        assert np.isfinite(result.q).all()
        assert result.explain().endswith(".")
        room = chain.limit_room(result.q[None, chain.columns])
        assert room.min() >= -1e-9, room.min()
    return "reaches" if any(result.is_reached for result in results) else "loads"


@pytest.fixture
def fuzz(monkeypatch, tmp_path, ball_anatomy, cone, ball_distance):
    """A function that tries some arms, and counts what became of them."""
    monkeypatch.setattr("sim.world.ik.start_set.N_DRAWN", 30)
    monkeypatch.setattr("sim.world.scene.standing_contact.N_CONFIGURATIONS", 100)
    counts: Counter[str] = Counter()

    def run(n_examples: int, *, derandomize: bool) -> Counter[str]:
        @settings(
            max_examples=n_examples,
            deadline=None,
            derandomize=derandomize,
            suppress_health_check=list(HealthCheck),
        )
        @given(odd_arms(), st.sampled_from(FLANGES))
        def each(text: str, flange: str | None) -> None:
            note(text)
            with silence():
                outcome = becomes(text, flange, tmp_path, ball_anatomy, cone, ball_distance)
            counts[outcome] += 1

        each()
        return counts

    return run


def test_any_arm_works_or_is_refused_in_one_line(fuzz) -> None:
    counts = fuzz(QUICK, derandomize=True)
    assert sum(counts.values()) >= QUICK


@pytest.mark.slow
def test_any_of_many_arms_works_or_is_refused_in_one_line(fuzz) -> None:
    counts = fuzz(MANY, derandomize=False)
    print(f"{sum(counts.values())} arms")
    for outcome, n in counts.most_common():
        print(f"{n:6d}  {outcome}")
    # So many that what comes after loading is tried too.
    assert counts["loads"] > 0.1 * MANY
    assert counts["reaches"] > 0.005 * MANY
