"""A dataset holds what the episodes of its seeds did, in every format."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
from ball_dataset import plan_of, same, silent, table
from PIL import Image

from sim.dataset.building import build
from sim.dataset.lerobot_files import FEATURES
from sim.dataset.record import EPISODE_FIELDS, STEP_FIELDS
from sim.episode.setup import build_setup
from sim.running.fields import changed
from sim.running.parts import make_parts
from sim.running.run_episode import make_episode

pq = pytest.importorskip("pyarrow.parquet")
ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def expected(config):
    """The steps of seed 5, and the episode, by the loop of `sounding episode`."""
    parts = make_parts(changed(config, seed=5))
    episode = make_episode(parts, build_setup(parts.scenario, None, parts.map_settings))
    steps, beliefs = [], []
    for step in episode.steps(3):
        steps.append(step)
        beliefs.append(episode.prediction.probability)
    return episode, steps, beliefs


def test_a_row_is_what_an_action_of_the_episode_did(parquet, expected):
    _, steps, beliefs = expected
    rows = [row for row in table(parquet, "steps") if row["seed"] == 5]
    assert [row["pose_index"] for row in rows] == [step.pose_index for step in steps]
    assert [row["next.done"] for row in rows] == [False, False, True]
    for row, step, belief in zip(rows, steps, beliefs, strict=True):
        points_m = np.array(row["points_m"]).reshape(-1, 3)
        np.testing.assert_allclose(
            points_m, step.reading.points_m, atol=1e-7
        )  # single precision of half a metre
        np.testing.assert_array_equal(row["is_occupied"], step.reading.is_occupied)
        assert row["is_occupied"] == row["is_tumour"]  # the cone does not err
        per_cent = np.frombuffer(row["belief"], dtype=np.uint8)
        assert np.abs(per_cent - 100.0 * belief).max() <= 0.5
        np.testing.assert_allclose(np.reshape(row["T_world_probe"], (4, 4)), step.reading.T_world_probe)
        assert row["next.sensed"] == step.sensed_fraction
    assert rows[1]["observation.tip"] == rows[0]["action"]
    assert rows[1]["observation.sensed"] == rows[0]["next.sensed"]
    assert rows[2]["timestamp"] == pytest.approx(sum(step.procedure_s for step in steps))


def test_the_row_of_an_episode_holds_its_truth(parquet, expected):
    episode, _, _ = expected
    row = next(each for each in table(parquet, "episodes") if each["seed"] == 5)
    shape, setup = row["lattice_shape"], episode.setup
    is_inside = np.unpackbits(np.frombuffer(row["is_inside"], np.uint8), count=int(np.prod(shape))).astype(
        bool
    )
    np.testing.assert_array_equal(is_inside, setup.is_inside)
    is_tumour = np.unpackbits(np.frombuffer(row["is_tumour"], np.uint8), count=int(is_inside.sum()))
    np.testing.assert_array_equal(is_tumour.astype(bool), episode.truth.is_tumour)
    axes = [
        low + step * np.arange(n)
        for low, step, n in zip(row["lattice_low_m"], row["lattice_spacing_m"], shape, strict=True)
    ]
    points_m = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(points_m[is_inside], setup.search_points_m, atol=1e-12)
    # The scenario's sphere, as an icosphere of slightly less volume.
    assert row["lesion_diameter_m"] == pytest.approx([0.024], rel=0.01)
    (tumour,) = episode.truth.anatomy.tumours
    np.testing.assert_allclose(row["lesion_centre_m"], tumour.vertices_m.mean(axis=0), atol=1e-4)


def test_memory_holds_an_episode_and_not_a_shard(parquet):
    # Each episode is a row group of its own, written before the next one runs.
    assert pq.read_metadata(parquet / "steps" / "shard-00000.parquet").num_row_groups == 2


def test_hdf5_holds_the_same(parquet, config, tmp_path):
    h5py = pytest.importorskip("h5py")
    assert build(plan_of(tmp_path / "h5", config, format="hdf5"), n_jobs=1, tell=silent) == 3
    rows = [row for row in table(parquet, "steps") if row["seed"] == 5]
    with h5py.File(tmp_path / "h5" / "shard-00001.h5") as file:
        group = file["episode_000002"]
        assert group.attrs["seed"] == 5
        steps = group["steps"]
        assert set(STEP_FIELDS) <= set(steps)
        np.testing.assert_array_equal(steps["pose_index"], [row["pose_index"] for row in rows])
        ends = np.cumsum(steps["points_m_length"])
        for row, start, end in zip(rows, [0, *ends[:-1]], ends, strict=True):
            np.testing.assert_allclose(steps["points_m"][start:end], row["points_m"])
        assert b"".join(row["belief"] for row in rows) == steps["belief"][()].tobytes()
    assert build(plan_of(tmp_path / "h5", config, format="hdf5"), n_jobs=1, tell=silent) == 0


def test_lerobots_files_have_its_layout(parquet, config, tmp_path):
    folder = tmp_path / "lerobot"
    assert build(plan_of(folder, config, format="lerobot"), n_jobs=1, tell=silent) == 3
    info = json.loads((folder / "meta" / "info.json").read_text())
    assert (info["codebase_version"], info["total_episodes"], info["total_frames"]) == ("v3.0", 3, 9)
    assert set(info["features"]) == set(FEATURES)
    frames = []
    for index in range(2):
        file = folder / info["data_path"].format(chunk_index=0, file_index=index)
        schema = pq.read_schema(file)
        for name, feature in info["features"].items():
            kind = schema.field(name).type
            width = kind.list_size if hasattr(kind, "list_size") else 1
            assert [width] == feature["shape"]
            value = str(kind.value_type if width > 1 else kind)
            assert {"float": "float32"}.get(value, value) == feature["dtype"]
        frames += pq.read_table(file).to_pylist()
    assert [frame["index"] for frame in frames] == list(range(9))
    assert [frame["frame_index"] for frame in frames] == [0, 1, 2] * 3
    episodes = pq.read_table(folder / "meta" / "episodes" / "chunk-000" / "file-000.parquet").to_pylist()
    for episode in episodes:
        own = frames[episode["dataset_from_index"] : episode["dataset_to_index"]]
        assert {frame["episode_index"] for frame in own} == {episode["episode_index"]}
        assert len(own) == episode["length"]
    stats = json.loads((folder / "meta" / "stats.json").read_text())
    actions = np.array([frame["action"] for frame in frames])
    np.testing.assert_allclose(stats["action"]["mean"], actions.mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(stats["action"]["std"], actions.std(axis=0), atol=1e-6)
    assert stats["action"]["count"] == [9]
    rows = table(parquet, "steps")
    assert [frame["action"] for frame in frames] == [row["action"] for row in rows]
    total = sum(frame["next.reward"] for frame in frames[:3])
    assert total == pytest.approx(rows[2]["next.sensed"], abs=1e-6)


@pytest.mark.slow
def test_lerobots_own_reader_loads_it(config, tmp_path, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    lerobot = pytest.importorskip("lerobot.datasets.lerobot_dataset", reason="needs pip install lerobot")
    folder = tmp_path / "lerobot"
    build(plan_of(folder, config, format="lerobot"), n_jobs=1, tell=silent)
    dataset = lerobot.LeRobotDataset("sounding/ball", root=folder, delta_timestamps={"action": [0.0, 1.0]})
    assert (len(dataset), dataset.num_episodes) == (9, 3)
    rows = pq.read_table(folder / "data" / "chunk-000" / "file-000.parquet").to_pylist()
    item = dataset[4]
    assert item["task"] == "find the hidden tumours"
    np.testing.assert_allclose(item["action"].numpy(), [rows[4]["action"], rows[5]["action"]])


def test_the_card_tells_every_field(parquet):
    card = (parquet / "README.md").read_text()
    assert all(f"- `{name}`: " in card for name in (*STEP_FIELDS, *EPISODE_FIELDS))
    assert set(STEP_FIELDS) == set(pq.read_schema(parquet / "steps" / "shard-00000.parquet").names) - {
        "episode_index", "seed",
    }  # fmt: skip
    assert set(EPISODE_FIELDS) == set(table(parquet, "episodes")[0]) - {"episode_index"}


@pytest.mark.slow
def test_processes_build_what_one_builds(parquet, config, tmp_path):
    assert build(plan_of(tmp_path / "two", config), n_jobs=2, tell=silent) == 3
    assert same(table(tmp_path / "two", "steps"), table(parquet, "steps"))


@pytest.mark.slow
def test_pictures_of_a_sweep_are_kept(config, tmp_path):
    pytest.importorskip("numba")
    config = changed(config, sensor="ultrasound", scenario="liver", steps=1)
    build(plan_of(tmp_path / "us", config, seeds=range(1)), n_jobs=1, tell=silent)
    (row,) = table(tmp_path / "us", "steps")
    picture = np.array(Image.open(io.BytesIO(row["image"])))
    assert picture.ndim == 2
    assert picture.std() > 5.0
