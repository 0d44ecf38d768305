"""`sounding bound` from end to end: the folder, its check, tampering, and going on."""

from __future__ import annotations

import csv
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from planner import visibility
from sim.bound.check.checking import check_bound
from sim.bound.check.proof import DoesNotHoldError
from sim.bound.stage import Stage
from sim.cli.command_line import main
from sim.episode.episode import Episode
from sim.running.fields import config_of

ROOT = Path(__file__).resolve().parents[3]


def files_of(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def bound(world, out, *words):
    more = [] if "--places" in words else ["--places", "20"]
    return main(["bound", "--scenario", str(world), "--jobs", "1", "--out", str(out), *more, *words])


def rows(folder):
    return list(csv.DictReader((folder / "seeds.csv").open()))


def subsets(n_poses, n):
    return itertools.combinations(range(n_poses), n)


def test_the_fewest_poses_are_those_of_all_subsets(small_world, small_bound):
    stage = Stage(config_of(scenario=str(small_world), arm="none"))
    setup = stage.setup(0)
    assert len(rows(small_bound)) == 3
    for row in rows(small_bound):
        episode = Episode(setup, _Never(), seed=int(row["seed"]), tumour_map=None, casts_rays=False)
        points_m = episode.truth.anatomy.detection_points_m
        sees = visibility(setup.workspace, setup.cone, points_m).T
        looking = sees[sees.any(axis=1)]
        fewest = next(
            n
            for n in range(1, 5)
            if any(looking[list(each)].any(axis=0).mean() >= 0.95 for each in subsets(len(looking), n))
        )
        assert int(row["least"]) == int(row["most"]) == fewest
        assert sees[json.loads(row["poses"])].any(axis=0).mean() >= 0.95


class _Never:
    """A planner that is never asked."""

    needs_belief = False


def test_the_certificate_is_verified(small_bound, capsys):
    assert main(["bound", "--check", str(small_bound), "--jobs", "1"]) == 0
    told = capsys.readouterr().out
    assert "verified: 3 seeds" in told
    assert "verified: 20 places" in told


def test_two_processes_write_the_same_certificate(small_world, small_bound, tmp_path):
    words = [
        "bound",
        "--scenario",
        str(small_world),
        "--seeds",
        "0:3",
        "--places",
        "20",
        "--jobs",
        "2",
        "--out",
        str(tmp_path / "b"),
    ]
    assert main(words) == 0
    ours, theirs = files_of(small_bound), files_of(tmp_path / "b")
    assert ours.keys() == theirs.keys()
    for name in ours.keys() - {next(each for each in ours if each.name == "bound.json")}:
        assert ours[name] == theirs[name], name
    contents = [json.loads((folder / "bound.json").read_text()) for folder in (small_bound, tmp_path / "b")]
    for content in contents:
        content.pop("machine")
    assert contents[0] == contents[1]


def tampered(folder, name, **changes):
    """Change some arrays of a file."""
    with np.load(folder / name) as file:
        arrays = {key: file[key] for key in file.files}
    for key, change in changes.items():
        arrays[key] = change(arrays[key])
    np.savez_compressed(folder / name, **arrays)


@pytest.mark.parametrize(
    ("name", "key", "change", "text"),
    [
        ("seeds/000001.npz", "prices", lambda each: each * 1.5, "a cone holds points worth"),
        ("seeds/000001.npz", "least", lambda each: each + 1, "at least"),
        ("seeds/000001.npz", "value", lambda each: each + 0.2, "is claimed"),
        ("seeds/000001.npz", "need", lambda each: each + 1, "are said to be needed"),
        ("seeds/000001.npz", "chosen", lambda each: each[:0], "the chosen poses"),
        ("seeds/000001.npz", "chosen", lambda each: each + 1000, "is not reached"),
        ("seeds/000001.npz", "seed", lambda each: each + 1, "its file is that of seed 2"),
        ("places/1000000-1000019.npz", "fewest", lambda each: each + 1, "is what is proven"),
        ("places/1000000-1000019.npz", "middle_m", lambda each: each + 1e-3, "not where it is said to be"),
        ("places/1000000-1000019.npz", "seed", lambda each: each + 1, "its place is that of seed 1000001"),
        ("policy.npz", "weights", lambda each: each * 0.9, "and"),
        ("policy.npz", "weights", lambda each: each + 0.5, "a number from 0 to 1"),
        ("poses.npz", "apex_m", lambda each: each + 1e-4, "its apex_m"),
    ],
)
def test_a_tampered_certificate_is_caught(small_bound, tmp_path, capsys, name, key, change, text):
    folder = shutil.copytree(small_bound, tmp_path / "copy")
    tampered(folder, name, **{key: change})
    assert main(["bound", "--check", str(folder), "--jobs", "1"]) == 1
    told = capsys.readouterr().out
    assert "does not hold" in told
    assert text in told
    assert name.split("/")[0] != "seeds" or "seed 1" in told


def test_a_case_that_is_not_that_of_the_options_is_caught(small_bound, tmp_path):
    folder = shutil.copytree(small_bound, tmp_path / "copy")
    content = json.loads((folder / "bound.json").read_text())
    content["case"]["scenario"] = "liver"
    (folder / "bound.json").write_text(json.dumps(content))
    with pytest.raises(DoesNotHoldError, match=r"bound\.json: case is .*liver.*, and not"):
        check_bound(folder, n_jobs=1, show_progress=False)


@pytest.mark.parametrize(
    ("old", "new"), [('"least_mean": ', '"least_mean": 1'), ('"n_proven": 3', '"n_proven": 2')]
)
def test_a_tampered_summary_is_caught(small_bound, tmp_path, old, new):
    folder = shutil.copytree(small_bound, tmp_path / "copy")
    text = (folder / "bound.json").read_text()
    assert old in text
    (folder / "bound.json").write_text(text.replace(old, new))
    with pytest.raises(DoesNotHoldError, match=r"bound\.json: hindsight"):
        check_bound(folder, n_jobs=1, show_progress=False)


def test_a_pose_that_is_left_out_of_a_place_is_caught(small_bound, tmp_path):
    folder = shutil.copytree(small_bound, tmp_path / "copy")
    name = "places/1000000-1000019.npz"
    with np.load(folder / name) as file:
        n_first = int(file["n_poses"][0])
    assert n_first > 1
    changes = {key: lambda each: np.delete(each, 1) for key in ("poses", "fewest")}
    tampered(folder, name, **changes, n_poses=lambda each: each - (np.arange(len(each)) == 0))
    with pytest.raises(DoesNotHoldError, match="place 1000000: row .* is left out"):
        check_bound(folder, n_jobs=1, show_progress=False)


@pytest.mark.parametrize("name", ["least_mean_95"])
def test_a_tampered_mean_is_caught(small_bound, tmp_path, name):
    folder = shutil.copytree(small_bound, tmp_path / "copy")
    content = json.loads((folder / "bound.json").read_text())
    content["policy"]["generator"][name] += 0.1
    (folder / "bound.json").write_text(json.dumps(content))
    with pytest.raises(DoesNotHoldError, match=f"policy generator {name} is"):
        check_bound(folder, n_jobs=1, show_progress=False)


def test_a_random_order_takes_at_least_what_the_bound_says(small_bound, small_world):
    """A sanity check by simulation: 40 orders in this world, none of which is in the sample."""
    mean = json.loads((small_bound / "bound.json").read_text())["policy"]["generator"]["least_mean"]
    stage = Stage(config_of(scenario=str(small_world), arm="none"))
    setup, rng = stage.setup(0), np.random.default_rng(0)
    needed = []
    for seed in range(40):
        points_m = stage.truth(seed).anatomy.detection_points_m
        sees = visibility(setup.workspace, setup.cone, points_m).T[rng.permutation(setup.workspace.n_poses)]
        share = np.logical_or.accumulate(sees, axis=0).mean(axis=1)
        needed.append(1 + int(np.argmax(share >= 0.95)) if share[-1] >= 0.95 else len(share))
    assert 1.0 < mean < np.mean(needed)


def test_a_tampered_table_is_caught(small_bound, tmp_path):
    folder = shutil.copytree(small_bound, tmp_path / "copy")
    lines = (folder / "seeds.csv").read_text().splitlines()
    lines[2] = lines[2].replace("1,1,500,475,", "1,1,500,474,", 1)
    (folder / "seeds.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(DoesNotHoldError, match="seed 1 has need '474'"):
        check_bound(folder, n_jobs=1, show_progress=False)


def test_a_folder_goes_on_with_more_seeds_and_keeps_what_it_has(small_world, small_bound, tmp_path):
    folder = shutil.copytree(small_bound, tmp_path / "copy")
    (folder / "seeds" / "000001.npz").unlink()
    before = (folder / "seeds" / "000000.npz").stat().st_mtime_ns
    assert bound(small_world, folder, "--seeds", "0:4") == 0
    assert (folder / "seeds" / "000000.npz").stat().st_mtime_ns == before
    assert [row["seed"] for row in rows(folder)] == ["0", "1", "2", "3"]
    assert rows(folder)[:3] == rows(small_bound)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--seeds", "5:2"], "the end must lie above the first"),
        (["--places", "5"], "--places 5: must be from 10 to 100000, or 0"),
        (["--jobs", "0"], "--jobs 0: must be from 1 to 256"),
        (["--scenario", "spheer"], "spheer"),
        (["--check", "nowhere"], "holds no bound"),
    ],
)
def test_bad_options_are_one_clear_line(tmp_path, monkeypatch, capsys, words, text):
    monkeypatch.chdir(tmp_path)
    assert main(["bound", *words]) == 2
    told = capsys.readouterr().err
    assert text in told
    assert "Traceback" not in told


def test_what_cannot_be_built_leaves_no_folder(tmp_path, capsys):
    words = ["--organ", str(tmp_path / "missing.stl"), "--out", str(tmp_path / "out")]
    assert main(["bound", *words]) == 2
    assert "missing.stl" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_another_question_is_refused_and_replaced_when_asked(small_world, small_bound, tmp_path, capsys):
    folder = shutil.copytree(small_bound, tmp_path / "copy")
    more = ["--n-tumours", "2", "--seeds", "0:1", "--places", "0"]
    assert bound(small_world, folder, *more) == 2
    assert "holds another bound" in capsys.readouterr().err
    assert bound(small_world, folder, *more, "--overwrite") == 0
    assert [row["n_tumours"] for row in rows(folder)] == ["2"]


def test_without_tumours_there_is_nothing_to_bound(small_world, tmp_path, capsys):
    assert bound(small_world, tmp_path / "out", "--n-tumours", "0", "--seeds", "0:1") == 2
    assert "there is no tumour" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="sends a signal")
def test_an_interrupted_bound_keeps_what_it_found(small_world, tmp_path):
    out = tmp_path / "out"
    words = ["bound", "--scenario", str(small_world), "--places", "0", "--jobs", "1", "--out", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "sim.cli", *words, "--seeds", "0:5000"],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )
    while not list(out.glob("seeds/0*.npz")):
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "what was found is kept, call again to go on" in errors
    n_found = len(list(out.glob("seeds/0*.npz")))
    assert 0 < n_found < 5000
    assert main(["bound", "--check", str(out), "--jobs", "1"]) == 2
    assert main([*words, "--seeds", f"0:{n_found}"]) == 0
    assert len(rows(out)) == n_found
