"""The free response of a map: what each threshold would find and make up, against a count by flood."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from planted_run import planted_run
from scipy.special import expit

from sim.findings.evidence import Evidence
from sim.findings.findings import find
from sim.findings.free_response import free_response, thresholds
from sim.record.map_field import called_from


def flooded(is_called: np.ndarray) -> Iterator[set[tuple[int, ...]]]:
    """The connected pieces of lattice points, of which those that share a corner are neighbours, one by one."""
    open_points = set(map(tuple, np.argwhere(is_called).tolist()))
    ways = [(i, j, k) for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)]
    while open_points:
        edge, piece = [open_points.pop()], set()
        while edge:
            point = edge.pop()
            piece.add(point)
            for way in ways:
                near = tuple(a + b for a, b in zip(point, way, strict=True))
                if near in open_points:
                    open_points.remove(near)
                    edge.append(near)
        yield piece


def counted(evidence: Evidence, level: float) -> tuple[int, int]:
    """Of how many tumours pieces hold two points, or all where there are fewer, and how many pieces hold none."""
    field = evidence.field
    assert field is not None
    axes = [list(axis) for axis in field.axes_m]
    cells = [
        {
            tuple(int(np.argmin(np.abs(axis - x))) for axis, x in zip(axes, point, strict=True))
            for point in evidence.detection_points_m[evidence.detection_tumours == index]
        }
        for index in range(len(evidence.anatomy.tumours))
    ]
    pieces = list(flooded((field.log_odds > level) & field.is_inside))
    n_found = sum(sum(len(piece & own) for piece in pieces) >= min(2, len(own)) for own in cells)
    return n_found, sum(not any(piece & own for own in cells) for piece in pieces)


def test_the_counts_at_every_threshold_are_those_of_a_flood(tmp_path) -> None:
    true = [((-0.03, 0.0, 0.0), 0.012), ((0.03, 0.0, 0.0), 0.006), ((0.0, -0.05, 0.0), 0.005)]
    mapped = [((-0.03, 0.0, 0.0), 0.010), ((0.03, 0.012, 0.0), 0.006), ((0.0, 0.05, 0.0), 0.007)]
    evidence = Evidence.of_record(planted_run(tmp_path, true=true, mapped=mapped))
    rng = np.random.default_rng(0)
    field = evidence.field
    assert field is not None
    noisy = dataclasses.replace(field, log_odds=field.log_odds + rng.normal(0, 1.5, field.log_odds.shape))
    evidence = dataclasses.replace(evidence, field=noisy)
    response = free_response(evidence)
    assert response is not None
    by_hand = [counted(evidence, level) for level in thresholds(0.02)]
    assert list(zip(response.n_found.tolist(), response.n_false.tolist(), strict=True)) == by_hand
    assert len(set(by_hand)) > 4  # a curve, not a point


def test_the_curve_goes_through_the_findings(tmp_path) -> None:
    true = [((-0.03, 0.0, 0.0), 0.012), ((0.03, 0.0, 0.0), 0.006)]
    mapped = [((-0.03, 0.0, 0.0), 0.010), ((0.0, 0.05, 0.0), 0.007)]
    for prior in (0.02, 0.5):
        evidence = Evidence.of_record(planted_run(tmp_path, true=true, mapped=mapped, prior=prior))
        response, findings = free_response(evidence), find(evidence)
        assert response is not None
        (own,) = np.flatnonzero(np.isclose(response.probability, called_from(prior)))
        assert (response.n_found[own], response.n_false[own]) == (findings.n_found, len(findings.false))
        # What was never sensed keeps the prior, and is not called tumour at any threshold.
        assert response.probability.min() > prior
    assert np.allclose(thresholds(0.5)[[0, 4]], [np.log(0.7 / 0.3) / 2, np.log(0.7 / 0.3)])
    assert np.all(np.diff(expit(thresholds(0.02))) > 0)


def test_without_a_map_there_is_no_free_response(tmp_path) -> None:
    assert free_response(Evidence.of_record(planted_run(tmp_path, true=[], mapped=None))) is None
