"""The run folder: valid at every moment, refused when it is somebody else's."""

from __future__ import annotations

import csv
import json
import os
from importlib import metadata

import numpy as np
import pytest

from sim.errors import UsageError
from sim.record.ownership import check_out_folder
from sim.record.run_folder import RunFolder, describe_machine


def test_a_folder_is_a_valid_unfinished_run_from_the_start(tmp_path) -> None:
    with RunFolder(tmp_path / "a/b") as folder:
        folder.begin({"x": np.float64(1.5), "path": tmp_path}, {"seed": 3})
        manifest = json.loads((tmp_path / "a/b/manifest.json").read_text())
        assert (manifest["status"], manifest["seed"]) == ("unfinished", 3)
        assert manifest["packages"]["mujoco"]
        folder.finish("finished")
    assert json.loads((tmp_path / "a/b/manifest.json").read_text())["status"] == "finished"


def test_rows_are_readable_before_the_folder_is_closed(tmp_path) -> None:
    with RunFolder(tmp_path) as folder:
        folder.append_row(
            "steps.csv", {"step": 1, "value": 0.1 + 0.2, "nothing": None, "yes": np.bool_(True)}
        )
        folder.append_row(
            "steps.csv", {"step": 2, "value": np.float64(1e-300), "nothing": "a,b", "yes": False}
        )
        rows = list(csv.DictReader((tmp_path / "steps.csv").open()))
    assert [row["step"] for row in rows] == ["1", "2"]
    assert float(rows[0]["value"]) == 0.1 + 0.2  # all digits survive
    assert (rows[0]["nothing"], rows[0]["yes"], rows[1]["nothing"]) == ("", "1", "a,b")


def test_arrays_and_json_are_replaced_whole(tmp_path) -> None:
    with RunFolder(tmp_path) as folder:
        for size in (3, 5):
            folder.write_arrays("map.npz", compressed=size == 5, values=np.arange(size))
            assert np.load(tmp_path / "map.npz", allow_pickle=False)["values"].size == size
    assert sorted(path.name for path in tmp_path.iterdir()) == ["map.npz"]


def test_an_earlier_run_is_kept_unless_told_otherwise(tmp_path) -> None:
    with RunFolder(tmp_path) as folder:
        folder.begin({}, {})
        folder.append_row("steps.csv", {"step": 1})
    (tmp_path / "mine.txt").write_text("notes")
    with pytest.raises(UsageError, match="already holds a run.*`overwrite`"):
        RunFolder(tmp_path)
    with RunFolder(tmp_path, overwrite=True):
        assert not (tmp_path / "steps.csv").exists()
        assert (tmp_path / "mine.txt").exists()  # only a run's own files are removed


def test_two_runs_into_one_folder_are_kept_apart(tmp_path) -> None:
    with RunFolder(tmp_path), pytest.raises(UsageError, match="another run is writing there"):
        RunFolder(tmp_path, overwrite=True)


def test_a_file_in_the_way_is_named(tmp_path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(UsageError, match="out: is a file"):
        check_out_folder(tmp_path / "out", overwrite=False)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_an_unwritable_folder_is_refused_before_any_work(tmp_path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(UsageError, match="cannot write there"):
        check_out_folder(tmp_path / "out", overwrite=False)


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_folder_of_strangers_files_is_refused_and_left_as_it_is(tmp_path, overwrite) -> None:
    (tmp_path / "frames").mkdir()
    for name in ("holiday.png", "poses.csv", "frames/mine.png", "manifest.json"):
        (tmp_path / name).write_text("{}")
    with pytest.raises(UsageError, match=r"is not empty \(it holds frames, for example\)"):
        RunFolder(tmp_path, overwrite=overwrite)
    assert {path.read_text() for path in tmp_path.rglob("*.*") if path.is_file()} == {"{}"}


def test_a_home_folder_behind_a_link_is_refused(tmp_path) -> None:
    (tmp_path / "home").mkdir()
    (tmp_path / "home" / ".profile").write_text("mine")
    (tmp_path / "link").symlink_to(tmp_path / "home")
    with pytest.raises(UsageError, match="is not empty"):
        RunFolder(tmp_path / "link", overwrite=True)
    assert (tmp_path / "home" / ".profile").read_text() == "mine"


def test_what_a_person_lays_into_a_runs_folder_stays_when_the_run_is_replaced(tmp_path) -> None:
    run, outside = tmp_path / "run", tmp_path / "outside.csv"
    outside.write_text("mine")
    with RunFolder(run) as folder:
        folder.begin({}, {})
        folder.write_bytes("frames/0001.png", b"ours")
    (run / "holiday.png").write_text("mine")
    (run / "frames" / "mine.png").write_text("mine")
    (run / "states.csv").symlink_to(outside)  # the name of a file of ours, which this run did not write
    with RunFolder(run, overwrite=True):
        pass
    left = sorted(str(path.relative_to(run)) for path in run.rglob("*.*"))
    assert left == ["frames/mine.png", "holiday.png", "states.csv"]
    assert outside.read_text() == "mine"


def test_of_a_killed_run_only_files_of_its_names_are_removed(tmp_path) -> None:
    with RunFolder(tmp_path / "run") as folder:
        folder.begin({}, {})
        folder.write_bytes("motion/1.npz", b"ours")
        killed = (folder.path / "manifest.json").read_bytes()  # which lists no files yet
    (tmp_path / "run" / "manifest.json").write_bytes(killed)
    (tmp_path / "run" / "holiday.png").write_text("mine")
    with RunFolder(tmp_path / "run", overwrite=True):
        pass
    assert [path.name for path in (tmp_path / "run").rglob("*.*")] == ["holiday.png"]


def test_a_manifest_that_lists_files_elsewhere_removes_none_of_them(tmp_path) -> None:
    (tmp_path / "precious.txt").write_text("mine")
    with RunFolder(tmp_path / "run") as folder:
        folder.begin({}, {})
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    elsewhere = ["../precious.txt", str(tmp_path / "precious.txt")]
    (tmp_path / "run" / "manifest.json").write_text(json.dumps(manifest | {"files": elsewhere}))
    with RunFolder(tmp_path / "run", overwrite=True):
        pass
    assert (tmp_path / "precious.txt").read_text() == "mine"


def test_a_package_that_is_not_installed_has_no_version_and_stops_nobody(monkeypatch) -> None:
    """A clone that was never installed ended with a traceback, and so would a system without toppra."""
    known = metadata.version

    def version(name: str) -> str:
        if name in ("sounding", "toppra"):
            raise metadata.PackageNotFoundError(name)
        return known(name)

    monkeypatch.setattr(metadata, "version", version)
    machine = describe_machine()
    assert machine["sounding"] is None
    assert machine["packages"]["toppra"] is None
    assert machine["packages"]["numpy"] == known("numpy")
