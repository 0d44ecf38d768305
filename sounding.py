"""The front door of Sounding: what a script imports.

    import sounding

    summary = sounding.run_episode(scenario="spheres", steps=20, seed=3, out="renders/mine")

Names are loaded when they are first used, so that the import itself costs next to nothing and brings no MuJoCo.
docs/python.md tells what each is for, and `examples/` shows them at work.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mapping import HilbertMap, MapSpace, Prediction, TumourMap, make_hilbert_map
    from planner import Planner, Situation, make_planner
    from sim.campaign.campaign import run_trials
    from sim.campaign.study import make_study
    from sim.comparison.compare import compare
    from sim.episode.episode import Episode
    from sim.episode.scenario import Scenario
    from sim.episode.scenario_file import load_scenario
    from sim.episode.setup import build_setup
    from sim.reach.study import reach_study
    from sim.record.run_record import load_run
    from sim.running.run_episode import run_episode
    from sim.world.anatomy.case_files import CaseFiles
    from sim.world.probes.probe import named_probe
    from sim.world.scene.named_arms import named_arm
    from sim.world.sensing.cone_sensor import ConeSensor
    from sim.world.sensing.reading import Reading
    from sim.world.sensing.sensor import SceneState, Sensor

_HOMES = {
    "CaseFiles": "sim.world.anatomy.case_files",
    "ConeSensor": "sim.world.sensing.cone_sensor",
    "Episode": "sim.episode.episode",
    "HilbertMap": "mapping",
    "MapSpace": "mapping",
    "Planner": "planner",
    "Prediction": "mapping",
    "Reading": "sim.world.sensing.reading",
    "Scenario": "sim.episode.scenario",
    "SceneState": "sim.world.sensing.sensor",
    "Sensor": "sim.world.sensing.sensor",
    "Situation": "planner",
    "TumourMap": "mapping",
    "build_setup": "sim.episode.setup",
    "compare": "sim.comparison.compare",
    "load_run": "sim.record.run_record",
    "load_scenario": "sim.episode.scenario_file",
    "make_hilbert_map": "mapping",
    "make_planner": "planner",
    "make_study": "sim.campaign.study",
    "named_arm": "sim.world.scene.named_arms",
    "named_probe": "sim.world.probes.probe",
    "reach_study": "sim.reach.study",
    "run_episode": "sim.running.run_episode",
    "run_trials": "sim.campaign.campaign",
}
"""The module that each name comes from."""

__all__ = [
    "CaseFiles",
    "ConeSensor",
    "Episode",
    "HilbertMap",
    "MapSpace",
    "Planner",
    "Prediction",
    "Reading",
    "Scenario",
    "SceneState",
    "Sensor",
    "Situation",
    "TumourMap",
    "build_setup",
    "compare",
    "load_run",
    "load_scenario",
    "make_hilbert_map",
    "make_planner",
    "make_study",
    "named_arm",
    "named_probe",
    "reach_study",
    "run_episode",
    "run_trials",
]


def __getattr__(name: str) -> Any:
    """A name of the front door, loaded now."""
    if name not in _HOMES:
        raise AttributeError(f"sounding has no {name!r}; it has {', '.join(_HOMES)}.")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The names of the front door."""
    return sorted(_HOMES)
