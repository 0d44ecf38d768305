"""Worlds that many tests share; each is built once."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
import trimesh
from chromium import NoBrowserError, running_chromium
from hypothesis import HealthCheck, settings
from shared_runs import make_arm_run, make_sweep_run, make_two_class_run, without_figures

from mapping import MapSettings
from planner import Cone
from sim.episode.scenario import SCENARIOS, Scenario
from sim.episode.setup import Setup, build_setup
from sim.world.anatomy.anatomy import Anatomy, build_anatomy
from sim.world.ik.search import IkSearch
from sim.world.probes.probe import EMBEDDED, ProbeModel
from sim.world.scene.arm import ArmModel
from sim.world.scene.clearance import Clearance
from sim.world.scene.scene import Scene, build_scene
from sim.world.solids.distance_grid import DistanceGrid
from sim.world.solids.solid import Solid

ROOT = Path(__file__).resolve().parents[1]
LONGEST = (
    "test_cli",
    "test_examples",
    "test_plugs_in_campaigns",
    "test_streams",
    "test_steered_arm",
    "test_campaign",
    "test_ultrasound_run",
    "test_docs",
    "test_engines",
    "test_base_search",
    "test_patients",
    "test_body",
    "test_report_browser",
    "test_bound_study",
    "test_reach",
    "test_lost_headers",
    "test_second_target_outputs",
    "test_environment",
    "test_timing",
    "test_liver_generator",
    "test_joined_tumours",
    "test_erring_sensor",
    "test_shown_structures",
    "test_report",
)
"""Files of tests that take longest, begun first, so that no process is left with one of them at the end."""

# A machine that is busy with other things makes any example late, and proves nothing by it.
settings.register_profile("patient", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("patient")


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config) -> None:
    """Several processes get whole files: what a file's tests share is then built once, not in each process."""
    if getattr(config.option, "dist", "no") == "load":
        config.option.dist, config.option.loadscopereorder = "loadfile", False


def pytest_collection_modifyitems(items) -> None:
    """Put the longest files first."""
    place = {name: i for i, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.stem, len(LONGEST)))


@pytest.fixture(scope="session", autouse=True)
def setups_are_built_once():
    """Episodes on organs and arms that the package brings share their setups, as the trials of a campaign do."""
    built: dict[tuple[Scenario, ArmModel | None, float], Setup] = {}

    def shared(
        scenario: Scenario,
        arm: ArmModel | None,
        map_settings: MapSettings,
        *,
        probe: ProbeModel = EMBEDDED,
    ) -> Setup:
        # Files of the user's may change between two calls.
        is_embedded = scenario.is_named_organ and (arm is None or arm.path == ArmModel().path)
        if not (is_embedded and probe.is_embedded):
            return build_setup(scenario, arm, map_settings, probe=probe)
        key = (scenario, arm, map_settings.hinge_spacing_m)
        if key not in built:
            built[key] = build_setup(scenario, arm, map_settings)
        return built[key]

    with pytest.MonkeyPatch.context() as patch:
        for room in ("sim.running.run_episode", "sim.campaign.trial"):
            patch.setattr(f"{room}.build_setup", shared)
        yield shared


@pytest.fixture(scope="session", autouse=True)
def grids_are_built_once():
    """The distances to an organ, a third of a second each time, are kept: equal organs have equal ones."""
    build, built = DistanceGrid.from_solid, {}

    def shared(solid: Solid, **more: float) -> DistanceGrid:
        key = (solid.vertices_m.tobytes(), solid.faces.tobytes(), *sorted(more.items()))
        if key not in built:
            built[key] = build(solid, **more)
        return built[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(DistanceGrid, "from_solid", shared)
        yield


@pytest.fixture(scope="session")
def browser():
    """Chromium without a window or a graphics card."""
    with ExitStack() as stack:
        try:
            running = stack.enter_context(running_chromium())
        except NoBrowserError as error:
            pytest.skip(str(error))
        yield running


@pytest.fixture(scope="session")
def livers_dir() -> Path:
    """Folder of real organs, for development only."""
    folder = Path(os.environ.get("SOUNDING_DATA", ROOT.parent / "shared" / "data")) / "livers"
    if not folder.is_dir():
        pytest.skip(f"real organs are not at {folder}; set SOUNDING_DATA to the folder that holds livers/")
    return folder


@pytest.fixture(scope="session")
def made_once(tmp_path_factory) -> Callable[[str, Callable[[Path], None]], Path]:
    """Folders that the processes of a session share: whoever needs one first makes it, and nobody changes it."""
    root = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent

    def folder(name: str, make: Callable[[Path], None]) -> Path:
        with (root / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not (made := root / f"{name}.made").exists():
                make(root / name)
                made.touch()
        return root / name

    return folder


@pytest.fixture(scope="session")
def arm_run(made_once) -> Path:
    """The folder of a finished run with the arm, by the command as a stranger runs it, with a frame per action."""
    return made_once("arm-run", make_arm_run)


@pytest.fixture(scope="session")
def two_class_run(made_once) -> Path:
    """The folder of a finished run on an organ with tumours and a second class."""
    return made_once("two-classes", make_two_class_run) / "run"


@pytest.fixture(scope="session")
def sweep_run(made_once) -> Path:
    """The folder of a finished run that senses along the way, without an arm and without a report."""
    return made_once("sweep", make_sweep_run)


@pytest.fixture
def no_figures():
    """Runs and inspections draw no figures, which take a second, where a test is about other things."""
    with without_figures():
        yield


@pytest.fixture(scope="session")
def coarse(tmp_path_factory) -> Path:
    """A scenario's file: few poses and a wide lattice, for runs that prove nothing by their resolution."""
    path = tmp_path_factory.mktemp("scenarios") / "coarse.toml"
    path.write_text('base = "liver"\nn_poses = 60\nscore_spacing_m = 0.008\n')
    return path


@pytest.fixture(scope="session")
def small_ball(tmp_path_factory) -> Path:
    """A scenario's file: a ball before the arm that is quick to build, with more poses than any test will sense."""
    folder = tmp_path_factory.mktemp("ball")
    trimesh.creation.icosphere(subdivisions=2, radius=0.04).export(folder / "ball.stl")
    lines = ('organ = "ball.stl"', 'organ_unit = "m"', "n_tumours = 1", 'tumour_shape = "sphere"')
    more = ("tumour_radius_m = 0.010", "n_poses = 3000", "score_spacing_m = 0.008")
    (folder / "ball.toml").write_text("\n".join([*lines, *more]))
    return folder / "ball.toml"


@pytest.fixture(scope="session")
def cone() -> Cone:
    return Cone(np.deg2rad(11.5), 0.102)


@pytest.fixture(scope="session")
def ball_anatomy() -> Anatomy:
    """A ball of 60 mm radius before the arm, with a tumour and another nested in it."""
    centre_m = np.array([0.5, 0.0, 0.06])

    def ball(radius_m: float, offset_m: tuple[float, float, float]) -> Solid:
        mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius_m)
        mesh.apply_translation(centre_m + offset_m)
        return Solid.from_trimesh(mesh)

    tumours = (
        ball(0.015, (0.0, 0.0, 0.02)),
        ball(0.008, (0.002, 0.0, 0.02)),
        ball(0.012, (0.012, 0.0, 0.015)),
    )
    return build_anatomy(ball(0.06, (0.0, 0.0, 0.0)), tumours, name="ball", rng=np.random.default_rng(0))


@pytest.fixture(scope="session")
def sphere_setup(setups_are_built_once) -> Setup:
    """The paper's scenario 1 with a free-flying probe."""
    return setups_are_built_once(SCENARIOS["sphere"], None, MapSettings())


@pytest.fixture(scope="session")
def sphere_arm_setup(setups_are_built_once) -> Setup:
    """The paper's scenario 1 with the embedded arm."""
    return setups_are_built_once(SCENARIOS["sphere"], ArmModel(), MapSettings())


@pytest.fixture(scope="session")
def scene(ball_anatomy, cone) -> Scene:
    """The embedded arm before the ball."""
    return build_scene(ball_anatomy, cone, arm=ArmModel())


@pytest.fixture(scope="session")
def ball_distance(ball_anatomy) -> DistanceGrid:
    return DistanceGrid.from_solid(ball_anatomy.organ)


@pytest.fixture(scope="session")
def clearance(scene, ball_distance) -> Clearance:
    return Clearance(scene, ball_distance)


@pytest.fixture(scope="session")
def search(scene, clearance) -> IkSearch:
    return IkSearch(scene, clearance)
