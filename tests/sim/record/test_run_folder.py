"""The run folder: valid at every moment, refused when it is somebody else's."""

from __future__ import annotations

import csv
import json
import os

import numpy as np
import pytest

from sim.errors import UsageError
from sim.record.locked_folder import check_out_folder
from sim.record.run_folder import RunFolder


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
