"""A ball that hides one sphere, and a dataset of it."""

import pytest
import trimesh
from ball_dataset import plan_of, silent

from sim.dataset.building import build
from sim.running.fields import config_of

SCENARIO = """
organ = "{folder}/ball.stl"
organ_unit = "m"
n_poses = 200
score_spacing_m = 0.006
n_tumours = 1
tumour_shape = "sphere"
"""


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    """Episodes in a ball of 50 mm that hides one sphere."""
    folder = tmp_path_factory.mktemp("ball")
    trimesh.creation.icosphere(subdivisions=3, radius=0.05).export(folder / "ball.stl")
    (folder / "ball.toml").write_text(SCENARIO.format(folder=folder))
    return config_of(scenario=str(folder / "ball.toml"), arm="none", motion="none", steps=3)


@pytest.fixture(scope="module")
def parquet(tmp_path_factory, config):
    folder = tmp_path_factory.mktemp("dataset") / "parquet"
    assert build(plan_of(folder, config), n_jobs=1, tell=silent) == 3
    return folder
