"""The digest of a planted truth, by which a change of a task's meaning shows."""

from __future__ import annotations

import hashlib

import numpy as np

from mapping import MapSettings
from sim.episode.setup import build_setup
from sim.episode.truth import make_truth
from sim.running.fields import config_of
from sim.running.parts import make_parts

from .tasks import Task

GRAIN_M = 1e-5
"""Lengths are rounded to this, so that the last bits of another machine do not count [m]."""


def truth_digest(task: Task, seed: int) -> str:
    """SHA-256 of the poses, the tumours' vertices and the scored lattice of a seed's truth.

    Args:
        task: The task.
        seed: The seed of the episode.
    """
    parts = make_parts(config_of(task.episode, scenario=str(task.scenario), seed=seed))
    setup = build_setup(parts.scenario, parts.arm, MapSettings(), probe=parts.probe)
    truth_rng = np.random.default_rng(seed).spawn(3)[0]
    truth = make_truth(setup, truth_rng)
    told = hashlib.sha256()
    arrays = [setup.workspace.positions_m, *(tumour.vertices_m for tumour in truth.anatomy.tumours)]
    for array in arrays:
        told.update(np.rint(np.asarray(array) / GRAIN_M).astype(np.int64).tobytes())
    told.update(np.packbits(truth.is_tumour).tobytes())
    return told.hexdigest()
