"""A saved map comes back as it was; anything else is refused with the reason."""

import numpy as np
import pytest

from mapping import HilbertMap, Lattice, MapSettings

BOX_M = ((-0.02, -0.02, -0.02), (0.02, 0.02, 0.0))


def learnt_map(**changes):
    hinges, query = (Lattice.from_box(*BOX_M, spacing_m=spacing_m) for spacing_m in (0.01125, 0.007))
    tumour_map = HilbertMap(
        hinges,
        MapSettings(**changes),
        query=query,
        query_mask=query.points_m()[:, 0] < 0.01,
        hinge_mask=hinges.points_m()[:, 0] < 0.012,
    )
    learn(tumour_map)
    return tumour_map


def learn(tumour_map, seed=0):
    points_m = np.random.default_rng(seed).uniform(*BOX_M, (60, 3))
    tumour_map.update(points_m, points_m[:, 2] < -0.01)


@pytest.mark.parametrize("form", ["full", "local", "diagonal"])
def test_a_saved_map_answers_and_learns_as_before(form, tmp_path):
    tumour_map = learnt_map(form=form, prior_prevalence=0.03)
    tumour_map.save(tmp_path / "map.npz")
    loaded = HilbertMap.load(tmp_path / "map.npz")
    assert loaded.settings == tumour_map.settings
    for _ in range(2):
        np.testing.assert_array_equal(loaded.predict_lattice().score, tumour_map.predict_lattice().score)
        np.testing.assert_array_equal(loaded.query_points_m(), tumour_map.query_points_m())
        for belief in (loaded, tumour_map):
            learn(belief)
    assert list(tmp_path.iterdir()) == [tmp_path / "map.npz"]


@pytest.mark.parametrize("form", ["full", "local"])
def test_a_saved_map_revises_its_readings_as_before(form, tmp_path):
    tumour_map = learnt_map(form=form)
    learn(tumour_map, seed=1)
    tumour_map.save(tmp_path / "map.npz")
    loaded = HilbertMap.load(tmp_path / "map.npz")
    assert loaded.revise() == tumour_map.revise() > 0.0
    np.testing.assert_array_equal(loaded.predict_lattice().score, tumour_map.predict_lattice().score)


def test_a_saved_covariance_comes_back_to_the_bit_in_the_precision_that_it_was_kept_in(tmp_path):
    for tolerance, precision in ((3e-6, np.float32), (0.0, np.float64)):
        tumour_map = learnt_map(tolerance=tolerance)
        Sigma = tumour_map.belief.covariance.matrix
        tumour_map.save(tmp_path / "map.npz")
        loaded = HilbertMap.load(tmp_path / "map.npz").belief.covariance.matrix
        assert loaded.dtype == Sigma.dtype == precision
        np.testing.assert_array_equal(loaded, Sigma)
        np.testing.assert_array_equal(Sigma, Sigma.T)


def test_a_caller_who_uses_his_array_again_does_not_change_what_was_learnt():
    tumour_map, other = learnt_map(), learnt_map()
    points_m = np.random.default_rng(2).uniform(*BOX_M, (60, 3))
    for each, given_m in ((tumour_map, points_m.copy()), (other, points_m)):
        each.update(given_m, points_m[:, 2] < -0.01)
    points_m[:] = 0.0
    tumour_map.revise()
    other.revise()
    np.testing.assert_array_equal(other.predict_lattice().score, tumour_map.predict_lattice().score)


def saved_arrays(tmp_path):
    learnt_map().save(tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz") as file:
        return dict(file)


def test_a_truncated_file_is_refused(tmp_path):
    learnt_map().save(tmp_path / "map.npz")
    whole = (tmp_path / "map.npz").read_bytes()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"half\.npz is no saved map: it is damaged"):
        HilbertMap.load(tmp_path / "half.npz")


def test_a_flipped_byte_is_noticed(tmp_path):
    learnt_map().save(tmp_path / "map.npz")
    content = bytearray((tmp_path / "map.npz").read_bytes())
    content[len(content) // 2] ^= 0xFF
    (tmp_path / "map.npz").write_bytes(content)
    with pytest.raises(ValueError, match="damaged"):
        HilbertMap.load(tmp_path / "map.npz")


@pytest.mark.parametrize("content", [b"", b"not a map", b"\x80\x04K*."])
def test_a_foreign_file_is_refused(content, tmp_path):
    (tmp_path / "foreign.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"foreign\.npz is no saved map"):
        HilbertMap.load(tmp_path / "foreign.npz")


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere"):
        HilbertMap.load(tmp_path / "nowhere.npz")


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"format": np.array("other")}, "not the format"),
        ({"version": np.array(99)}, "of version 99"),
        ({"mean": None}, "'mean' is missing"),
        ({"settings": None}, "'settings' is missing"),
        ({"settings": np.array('{"gamma_per_m2": -1}')}, "`gamma_per_m2` must be positive"),
        ({"mean": np.zeros(3)}, r"'mean' has shape \(3,\)"),
        ({"mean": np.inf}, "'mean' is not finite"),
        ({"covariance": -1.0}, "not positive definite"),
        ({"version": None}, "of version None"),
        ({"held_points_m": None}, "'held_points_m' is missing"),
        ({"held_counts": np.array([59])}, "'held_counts' does not hold the numbers"),
        ({"held_counts": np.array([0, 60])}, "'held_counts' does not hold the numbers"),
        ({"held_curvature": np.nan}, "'held_curvature' is not finite"),
        ({"held_log_odds": np.nan}, "'held_log_odds' is not finite"),
    ],
)
def test_a_file_with_a_wrong_part_is_refused_and_the_part_named(change, complaint, tmp_path):
    arrays = saved_arrays(tmp_path)
    for name, value in change.items():
        if value is None:
            del arrays[name]
        elif np.ndim(value) == 0 and arrays[name].ndim > 0:
            arrays[name] = np.full_like(arrays[name], value)
        else:
            arrays[name] = value
    np.savez(tmp_path / "changed.npz", **arrays)
    with pytest.raises(ValueError, match=complaint):
        HilbertMap.load(tmp_path / "changed.npz")
