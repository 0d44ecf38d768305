"""The sensing poses as tables: frames named, and back to the same matrices."""

from __future__ import annotations

import csv
import json

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.errors import UsageError
from sim.record.map_history import LOG_ODDS_STEP, from_bytes, read_history, to_bytes
from sim.record.poses import POSES_CSV, POSES_JSON, pose_row, read_poses, write_poses_json


def frame(rng: np.random.Generator) -> np.ndarray:
    T, R = np.eye(4), np.empty(9)
    quaternion = rng.normal(size=4)
    mujoco.mju_quat2Mat(R, quaternion / np.linalg.norm(quaternion))
    T[:3, :3], T[:3, 3] = R.reshape(3, 3), rng.normal(size=3)
    return T


def write(folder, rows) -> None:
    with (folder / POSES_CSV).open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def test_poses_come_back_as_they_were(tmp_path) -> None:
    rng = np.random.default_rng(0)
    T_world_organ, poses = frame(rng), [frame(rng) for _ in range(4)]
    write(tmp_path, [pose_row(i + 1, 10 * i, T, T_world_organ) for i, T in enumerate(poses)])
    steps, read = read_poses(tmp_path)
    assert steps.tolist() == [1, 2, 3, 4]
    np.testing.assert_allclose(read, poses, atol=1e-12)


def test_the_document_names_its_frames_and_they_agree(tmp_path) -> None:
    rng = np.random.default_rng(1)
    T_world_organ, T = frame(rng), frame(rng)
    write(tmp_path, [pose_row(1, 7, T, T_world_organ)])
    write_poses_json(tmp_path, T_world_organ)
    document = json.loads((tmp_path / POSES_JSON).read_text())
    assert document["quaternion_order"] == "wxyz"
    assert document["unit"] == "m"
    assert {"world", "organ", "probe", "T_a_b"} == set(document["frames"])
    (pose,) = document["poses"]
    np.testing.assert_allclose(pose["T_world_probe"]["position_m"], T[:3, 3])
    # The probe in the organ's frame, led back to the world by hand.
    back = np.array(document["T_world_organ"]) @ [*pose["T_organ_probe"]["position_m"], 1.0]
    np.testing.assert_allclose(back[:3], T[:3, 3], atol=1e-12)
    w, x, y, z = pose["T_world_probe"]["quaternion_wxyz"]
    beam = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
    np.testing.assert_allclose(beam, T[:3, 2], atol=1e-12)


def test_a_row_cut_short_is_left_out_and_a_broken_one_is_named(tmp_path) -> None:
    rng = np.random.default_rng(2)
    write(tmp_path, [pose_row(i + 1, i, frame(rng), np.eye(4)) for i in range(2)])
    text = (tmp_path / POSES_CSV).read_text()
    (tmp_path / POSES_CSV).write_text(text + "3,12,0.4")
    assert len(read_poses(tmp_path)[0]) == 2
    (tmp_path / POSES_CSV).write_text(text.replace("\n2,", "\nx,"))
    with pytest.raises(UsageError, match=r"poses\.csv: cannot be read"):
        read_poses(tmp_path)
    assert len(read_poses(tmp_path / "nowhere")[0]) == 0


@settings(max_examples=50)
@given(st.lists(st.floats(-6.3, 6.3), min_size=1, max_size=20))
def test_log_odds_in_a_byte_are_off_by_half_a_step_at_most(values) -> None:
    back = from_bytes(to_bytes(values))
    np.testing.assert_allclose(back, values, atol=LOG_ODDS_STEP / 2 + 1e-6)


def test_a_broken_map_of_the_history_is_named(tmp_path) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "00001.npz").write_bytes(b"PK\x03\x04 cut off")
    with pytest.raises(UsageError, match="00001.npz: cannot be read"):
        read_history(tmp_path)
