"""A dataset goes on where it was stopped: after a kill, with more seeds, damaged shards, not with another organ."""

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh
from ball_dataset import plan_of, same, silent, table

from sim.dataset.building import build
from sim.errors import UsageError
from sim.running.fields import changed

pytest.importorskip("pyarrow.parquet")
ROOT = Path(__file__).resolve().parents[3]


def test_it_goes_on_with_shards_that_are_missing_and_with_more_seeds(parquet, config, tmp_path):
    folder = tmp_path / "again"
    assert build(plan_of(folder, config), n_jobs=1, tell=silent) == 3
    first = folder / "steps" / "shard-00000.parquet"
    kept = first.stat().st_mtime_ns
    (folder / "episodes" / "shard-00001.parquet").unlink()
    (folder / "steps" / ".shard-00001.parquet.part").write_bytes(b"half")
    assert build(plan_of(folder, config), n_jobs=1, tell=silent) == 1
    assert same(table(folder, "steps"), table(parquet, "steps"))
    assert build(plan_of(folder, config), n_jobs=1, tell=silent) == 0
    # The last shard was of one seed, and is one of two now.
    assert build(plan_of(folder, config, seeds=range(3, 7)), n_jobs=1, tell=silent) == 2
    assert [row["seed"] for row in table(folder, "episodes")] == [3, 4, 5, 6]
    assert first.stat().st_mtime_ns == kept
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "manifest.json").write_text('{"sounding": "0.1.0"}')
    with pytest.raises(UsageError, match="holds a run"):
        build(plan_of(tmp_path / "run", config), n_jobs=1, tell=silent)
    with pytest.raises(UsageError, match=r"other values of `planner` \(.* then, .* now\)"):
        build(plan_of(folder, changed(config, planner="random")), n_jobs=1, tell=silent)


def copy_of(dataset, folder):
    shutil.copytree(dataset, folder)
    return folder


def test_episodes_that_are_there_are_never_taken_away(parquet, config, tmp_path):
    folder = copy_of(parquet, tmp_path / "fewer")
    for seeds in (range(3, 5), range(3, 4)):
        with pytest.raises(
            UsageError, match=r"holds [12] episodes beyond these [12]\. More seeds may be added"
        ):
            build(plan_of(folder, config, seeds=seeds), n_jobs=1, tell=silent)
    assert len(table(folder, "episodes")) == 3


@pytest.mark.parametrize("table_name", ["steps", "episodes"])
def test_a_damaged_shard_is_built_anew(parquet, config, tmp_path, table_name):
    folder = copy_of(parquet, tmp_path / "damaged")
    file = folder / table_name / "shard-00001.parquet"
    file.write_bytes(file.read_bytes()[:-9])
    assert build(plan_of(folder, config), n_jobs=1, tell=silent) == 1
    assert same(table(folder, table_name), table(parquet, table_name))


def test_it_does_not_go_on_with_another_organ_of_the_same_name(parquet, config, tmp_path):
    folder, organ = copy_of(parquet, tmp_path / "organ"), Path(config.scenario).with_name("ball.stl")
    content = organ.read_bytes()
    try:
        trimesh.creation.icosphere(subdivisions=3, radius=0.06).export(organ)
        with pytest.raises(UsageError, match=r"began with another file .*ball\.stl"):
            build(plan_of(folder, config), n_jobs=1, tell=silent)
    finally:
        organ.write_bytes(content)
    assert build(plan_of(folder, config), n_jobs=1, tell=silent) == 0


@pytest.mark.slow
def test_a_kill_in_the_middle_loses_the_shard_in_hand_alone(parquet, config, tmp_path):
    folder = tmp_path / "killed"
    command = [
        "dataset",
        "--scenario",
        config.scenario,
        "--arm",
        "none",
        "--steps",
        "3",
        "--seeds",
        "3:6",
        "--shard",
        "2",
    ]
    command += ["--jobs", "1", "--out", str(folder)]
    process = subprocess.Popen(
        [sys.executable, "-m", "sim.cli", *command], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline().startswith("shard 1 of 2")
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    process.stdout.close()
    assert build(plan_of(folder, config), n_jobs=1, tell=silent) in (0, 1)
    assert same(table(folder, "steps"), table(parquet, "steps"))
