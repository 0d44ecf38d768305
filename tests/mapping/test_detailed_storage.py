"""A saved detailed map goes on as if it had never been saved; anything else is refused with the reason."""

import numpy as np
import pytest
from detailed_maps import HIGH_M, LOW_M, make_coarse, make_detailed, readings

from mapping import DetailedMap, DetailSettings, HilbertMap, load_map

N_READINGS = 5
SAVED_AFTER = (0, 1, 3)
"""Readings after which a map is saved and loaded; the second is the first with tumour."""


def learnt(n_readings=3, **changes):
    detailed = make_detailed(**changes)
    for reading in readings(n_readings):
        detailed.update(*reading)
    return detailed


def other_tumour(seed):
    """A reading of a second tumour."""
    points_m = np.random.default_rng(seed).uniform(LOW_M, HIGH_M, (150, 3))
    return points_m, np.linalg.norm(points_m - (-0.024, 0.024, -0.034), axis=1) < 0.008


def answers(detailed):
    points_m = np.random.default_rng(9).uniform(LOW_M, HIGH_M, (40, 3))
    beliefs = detailed.predict_lattice(), detailed.predict(points_m)
    return [values for belief in beliefs for values in (belief.latent_mean, belief.latent_variance)]


def assert_same(first, *others):
    expected = answers(first)
    for other in others:
        for one, answer in zip(expected, answers(other), strict=True):
            np.testing.assert_array_equal(one, answer)
        assert first.n_weights == other.n_weights
        assert first.settings == other.settings


@pytest.mark.parametrize("form", ["full", "local", "diagonal"])
def test_loaded_maps_learn_on_to_the_same_bytes_as_the_one_that_was_kept(form, tmp_path):
    kept, loaded = make_detailed(form=form, detail=DetailSettings(reach_m=0.008)), []
    for number, reading in enumerate([*readings(N_READINGS), other_tumour(7)]):
        if number in SAVED_AFTER:
            kept.save(tmp_path / f"{number}.npz")
            assert sorted(path.stem for path in tmp_path.iterdir()) == [
                str(n) for n in SAVED_AFTER if n <= number
            ]
            loaded.append(DetailedMap.load(tmp_path / f"{number}.npz"))
            assert_same(kept, loaded[-1])
        for each in (kept, *loaded):
            each.update(*reading)
        assert_same(kept, *loaded)
    if form != "diagonal":
        changes = {each.revise() for each in (kept, *loaded)}
        assert len(changes) == 1
        assert_same(kept, *loaded)


def test_labels_that_a_noisy_sensor_may_have_made_up_are_told_apart_after_loading_too(tmp_path):
    kept = learnt(false_positive_rate=0.02, false_negative_rate=0.05)
    kept.save(tmp_path / "map.npz")
    loaded = DetailedMap.load(tmp_path / "map.npz")
    for each in (kept, loaded):
        each.update(*other_tumour(8))
        each.revise()
    assert_same(kept, loaded)


def test_load_map_reads_either_kind_and_each_class_refuses_the_others_file(tmp_path):
    coarse, detailed = make_coarse(), learnt()
    coarse.save(tmp_path / "coarse.npz")
    detailed.save(tmp_path / "detailed.npz")
    assert type(load_map(tmp_path / "coarse.npz")) is HilbertMap
    assert type(load_map(tmp_path / "detailed.npz")) is DetailedMap
    assert_same(load_map(tmp_path / "detailed.npz"), detailed)
    with pytest.raises(ValueError, match=r"detailed\.npz holds a 'sounding detailed map' .* load_map"):
        HilbertMap.load(tmp_path / "detailed.npz")
    with pytest.raises(ValueError, match=r"coarse\.npz holds a 'sounding hilbert map' .* load_map"):
        DetailedMap.load(tmp_path / "coarse.npz")


@pytest.mark.parametrize("load", [DetailedMap.load, load_map])
def test_a_truncated_file_is_refused(load, tmp_path):
    learnt().save(tmp_path / "map.npz")
    whole = (tmp_path / "map.npz").read_bytes()
    for share in (0.1, 0.5, 0.99):
        (tmp_path / "part.npz").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(ValueError, match=r"part\.npz is no saved map: it is damaged"):
            load(tmp_path / "part.npz")


@pytest.mark.parametrize("load", [DetailedMap.load, load_map])
def test_a_flipped_byte_is_noticed(load, tmp_path):
    learnt().save(tmp_path / "map.npz")
    content = bytearray((tmp_path / "map.npz").read_bytes())
    for place in (0.2, 0.5, 0.8):
        content[int(place * len(content))] ^= 0xFF
        (tmp_path / "map.npz").write_bytes(content)
        with pytest.raises(ValueError, match=r"map\.npz is no saved map: it is damaged"):
            load(tmp_path / "map.npz")


@pytest.mark.parametrize("load", [DetailedMap.load, load_map])
@pytest.mark.parametrize("content", [b"", b"not a map", b"\x80\x04K*."])
def test_a_foreign_file_is_refused(load, content, tmp_path):
    (tmp_path / "foreign.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"foreign\.npz is no saved map"):
        load(tmp_path / "foreign.npz")


@pytest.mark.parametrize("load", [DetailedMap.load, load_map])
def test_arrays_of_something_else_and_a_file_that_is_not_there_are_named(load, tmp_path):
    np.savez(tmp_path / "arrays.npz", probability=np.zeros(3))
    with pytest.raises(ValueError, match=r"arrays\.npz is no saved map: it holds \['probability'\]"):
        load(tmp_path / "arrays.npz")
    with pytest.raises(FileNotFoundError, match="nowhere"):
        load(tmp_path / "nowhere.npz")


@pytest.fixture(scope="module")
def arrays(tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "map.npz"
    learnt().save(path)
    with np.load(path) as file:
        return dict(file)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"version": np.array(99)}, "of version 99; this release reads version 2"),
        ({"detail_settings": None}, "'detail_settings' is missing"),
        ({"detail_settings": np.array('{"reach_m": -1}')}, "`reach_m` must be positive"),
        ({"detail_settings": np.array('{"colour": 1}')}, "colour"),
        ({"detail_settings": np.array("{")}, "Expecting property name"),
        ({"coarse/mean": None}, "'mean' is missing"),
        ({"coarse/settings": None}, "'settings' is missing"),
        ({"coarse/covariance": np.zeros(3)}, r"'covariance' has shape \(3,\)"),
        ({"coarse/held_offset": None}, "'held_offset' is missing"),
        ({"reading_counts": np.array([1, 2])}, "'reading_counts' does not hold the numbers"),
        ({"reading_counts": np.array([150.0, 150.0, 150.0])}, "'reading_counts' does not hold the numbers"),
        ({"reading_points_m": np.zeros((3, 3))}, r"'reading_points_m' has shape \(3, 3\)"),
        ({"reading_labels": np.ones(450)}, "'reading_labels' holds float64 in place of bool"),
    ],
)
def test_a_file_with_a_wrong_part_is_refused_and_the_part_named(arrays, change, complaint, tmp_path):
    changed = {name: array for name, array in (arrays | change).items() if array is not None}
    np.savez(tmp_path / "changed.npz", **changed)
    for load in (DetailedMap.load, load_map):
        with pytest.raises(ValueError, match=rf"changed\.npz .*{complaint}"):
            load(tmp_path / "changed.npz")


def test_a_caller_who_uses_his_arrays_again_does_not_change_the_map():
    first, second = make_detailed(), make_detailed()
    for points_m, labels in readings(2, n_points=400):
        first.update(points_m.copy(), labels.copy())
        second.update(points_m, labels)
        points_m[:], labels[:] = 0.0, False
    # Labels of the earlier readings come into play now.
    for each in (first, second):
        each.update(*other_tumour(7))
    assert_same(first, second)
