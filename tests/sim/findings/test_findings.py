"""Findings: planted balls are found with the volume, overlap and distances that geometry says."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from planted_run import ball, planted_run

from sim.findings.mapped_surface import surface_gap
from sim.findings.results import findings_of
from sim.findings.tables import finding_summary, write_finding_tables
from sim.record.map_field import called_from

R = 0.012
VOLUME = 4 / 3 * np.pi * R**3


def lens_dice(distance: float) -> float:
    """Dice of two equal balls of radius R: twice their lens by the sum of both."""
    lens = np.pi * (4 * R + distance) * (2 * R - distance) ** 2 / 12
    return lens / VOLUME


def shifted_distances(shift: float) -> np.ndarray:
    """Distances from evenly strewn points of a sphere to another of the same radius, shifted: exact."""
    cosine = np.linspace(-1, 1, 20_001)  # the cosine of an even point's angle is even
    return np.abs(np.sqrt(R**2 + shift**2 - 2 * R * shift * cosine) - R)


@pytest.mark.parametrize("shift_m", [0.0, 0.003, 0.006])
def test_a_shifted_ball_has_the_lens_of_geometry(tmp_path, shift_m) -> None:
    record = planted_run(tmp_path, true=[((0.01, 0.0, 0.0), R)], mapped=[((0.01 + shift_m, 0.0, 0.0), R)])
    (finding,) = findings_of(record).tumours
    assert finding.is_found
    assert finding.overlap is not None
    # A lattice of 3 mm interpolated by cubics misses a sphere of 12 mm by some tenths of a millimetre.
    assert finding.overlap.mapped_volume_m3 == pytest.approx(VOLUME, rel=0.03)
    assert finding.true_volume_m3 == pytest.approx(VOLUME, rel=1e-6)
    assert finding.overlap.centroid_error_m == pytest.approx(shift_m, abs=0.0002)
    assert finding.overlap.dice == pytest.approx(lens_dice(shift_m), abs=0.015)
    ways = shifted_distances(shift_m)
    assert finding.surface_mean_m == pytest.approx(ways.mean(), abs=0.0003)
    assert finding.surface_hausdorff95_m == pytest.approx(np.percentile(ways, 95), abs=0.0004)


def test_the_gap_of_two_spheres_is_that_of_geometry() -> None:
    mean_m, worst_m = surface_gap(ball((0, 0, 0), R), ball((0.003, 0, 0), R), np.random.default_rng(0))
    ways = shifted_distances(0.003)
    assert mean_m == pytest.approx(ways.mean(), abs=5e-5)
    assert worst_m == pytest.approx(np.percentile(ways, 95), abs=5e-5)
    nested = surface_gap(ball((0, 0, 0), R), ball((0, 0, 0), R + 0.004), np.random.default_rng(0))
    assert nested == pytest.approx((0.004, 0.004), abs=5e-5)


def test_what_touches_no_tumour_is_a_false_finding_and_what_nothing_touches_is_missed(tmp_path) -> None:
    true = [((-0.03, 0.0, 0.0), R), ((0.0, 0.04, 0.0), R)]
    mapped = [((-0.03, 0.0, 0.0), R), ((0.045, 0.0, 0.0), 0.008), ((0.0, -0.045, 0.0), 0.010)]
    findings = findings_of(planted_run(tmp_path, true=true, mapped=mapped))
    assert [each.is_found for each in findings.tumours] == [True, False]
    assert findings.n_found == 1
    missed = findings.tumours[1]
    assert missed.overlap is missed.surface is missed.surface_mean_m is None
    assert [each.finding for each in findings.false] == [1, 2]  # the largest first
    first, second = findings.false
    assert first.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.010**3, rel=0.05)
    np.testing.assert_allclose(first.centroid_m, (0.0, -0.045, 0.0), atol=3e-4)
    np.testing.assert_allclose(second.centroid_m, (0.045, 0.0, 0.0), atol=3e-4)
    # The nearest of 500 points strewn in the tumour lies within some 2 mm of its surface.
    assert second.tumour_distance_m == pytest.approx(np.hypot(0.045, 0.04) - R, abs=0.003)
    # A lattice point lies within sqrt(3) half spacings of the centre, where the log-odds are 400 / m times the radius.
    assert 400 * 0.008 >= np.log(1 / (1 / second.highest_probability - 1)) >= 400 * (0.008 - 0.0026)


def test_a_tumour_is_found_by_two_lattice_points_and_by_one_where_it_lies_at_one_alone(tmp_path) -> None:
    # Balls of the map of 1 mm around a point of the 3 mm lattice are called at that point alone.
    field = planted_run(tmp_path, true=[((0.0, 0.0, 0.0), R)], mapped=[((0.0, 0.0, 0.0), R)]).field
    assert field is not None
    near_m = field.low_m + field.cell_m * np.rint((0.0 - field.low_m) / field.cell_m)
    spot, beside = (tuple(near_m), 0.001), (tuple(near_m + np.array([field.cell_m[0], 0.0, 0.0])), 0.001)
    for true_radius_m, mapped, is_found in [
        (0.008, [spot], False),
        (0.008, [spot, beside], True),
        (0.0007, [spot], True),
    ]:
        record = planted_run(tmp_path, true=[(tuple(near_m), true_radius_m)], mapped=mapped)
        findings = findings_of(record)
        assert [each.is_found for each in findings.tumours] == [is_found], (true_radius_m, len(mapped))
        assert findings.false == ()


def test_a_piece_that_joins_two_tumours_is_shared_out(tmp_path) -> None:
    true = [((-0.011, 0.0, 0.0), 0.010), ((0.011, 0.0, 0.0), 0.010)]
    mapped = [*true, ((0.0, 0.0, 0.0), 0.006)]  # a bridge
    findings = findings_of(planted_run(tmp_path, true=true, mapped=mapped))
    assert not findings.false
    left, right = (each.overlap for each in findings.tumours)
    assert left is not None
    assert right is not None
    assert left.mapped_volume_m3 == pytest.approx(right.mapped_volume_m3, rel=0.05)
    assert left.mapped_centroid_m[0] < -0.008
    assert left.dice > 0.85


def test_a_ball_at_the_rim_ends_at_the_organ(tmp_path) -> None:
    centre_m = (0.074, 0.0, 0.0)  # half of the map's ball lies beyond the organ
    (finding,) = findings_of(
        planted_run(tmp_path, true=[((0.066, 0.0, 0.0), R)], mapped=[(centre_m, R)])
    ).tumours
    assert finding.surface is not None
    assert np.linalg.norm(finding.surface.vertices_m, axis=1).max() < 0.0805


def test_actions_are_counted_from_what_the_cones_held(tmp_path) -> None:
    # Looking down at two tumours: from far away, at the first, at the second, at the first again.
    true = [((-0.03, 0.0, 0.0), R), ((0.03, 0.0, 0.0), R)]
    poses = []
    for x in (0.0, -0.03, 0.03):
        T = np.diag([1.0, -1.0, -1.0, 1.0])
        T[:3, 3] = (x, 0.2 if x == 0.0 else 0.0, 0.09)
        poses.append(T)
    findings = findings_of(planted_run(tmp_path, true=true, mapped=None, T_world_probe=np.array(poses)))
    assert [each.first_seen_step for each in findings.tumours] == [2, 3]
    assert [each.sensed_step for each in findings.tumours] == [2, 3]
    assert [each.is_found for each in findings.tumours] == [None, None]  # no map was kept
    assert all(each.sensed_fraction == 1.0 for each in findings.tumours)


def test_without_tumours_all_is_false(tmp_path) -> None:
    findings = findings_of(planted_run(tmp_path, true=[], mapped=[((0.0, 0.0, 0.0), R)]))
    assert not findings.tumours
    (false,) = findings.false
    assert false.tumour_distance_m is None
    assert not findings_of(planted_run(tmp_path, true=[], mapped=[])).false


def test_the_papers_prior_is_no_finding() -> None:
    assert called_from(0.02) == called_from(0.3) == 0.5
    assert called_from(0.5) == 0.7
    assert called_from(0.9) == 0.95


def test_the_tables_hold_what_was_found_in_si_units(tmp_path) -> None:
    true, mapped = (
        [((0.0, 0.0, 0.0), R), ((0.0, 0.05, 0.0), R)],
        [((0.003, 0.0, 0.0), R), ((0.05, 0.0, 0.0), R)],
    )
    findings = findings_of(planted_run(tmp_path, true=true, mapped=mapped))
    write_finding_tables(tmp_path, findings)
    first, second = csv.DictReader((tmp_path / "tumours.csv").open())
    assert (first["is_found"], second["is_found"]) == ("1", "0")
    assert float(first["centroid_error_m"]) == pytest.approx(0.003, abs=2e-4)
    assert float(first["true_volume_m3"]) == pytest.approx(VOLUME)
    assert (second["dice"], second["mapped_volume_m3"]) == ("0.0", "0.0")
    (false,) = csv.DictReader((tmp_path / "false_findings.csv").open())
    assert float(false["centroid_x_m"]) == pytest.approx(0.05, abs=3e-4)
    summary = finding_summary(findings)
    assert (summary["n_tumours"], summary["n_tumours_found"], summary["n_false_findings"]) == (2, 1, 1)


def test_empty_tables_have_their_columns(tmp_path) -> None:
    write_finding_tables(tmp_path, findings_of(planted_run(tmp_path, true=[], mapped=[])))
    assert (tmp_path / "tumours.csv").read_text().startswith("tumour,is_found,first_seen_step")
    assert (tmp_path / "false_findings.csv").read_text().startswith("finding,volume_m3")


def test_the_centroid_is_that_of_the_volume() -> None:
    np.testing.assert_allclose(ball((0.3, -0.2, 0.1), 0.02).centroid_m, (0.3, -0.2, 0.1), atol=1e-9)
