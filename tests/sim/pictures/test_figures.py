"""The figures: what the pixels show, and the geometry below them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from sim.pictures.figures import draw_precision_recall, draw_progress, new_figure, set_title
from sim.pictures.map_views import MapPicture, draw_map_view, highest_along
from sim.pictures.number_places import number_places
from sim.pictures.silhouettes import Raster, extended_to_all, lattice_silhouette, mesh_silhouette


def ball_picture(**changes):
    """A ball of 60 mm for an organ, a sure tumour off its centre, free elsewhere, one pose on top."""
    axes = [np.linspace(-0.07, 0.07, 29) + offset for offset in (0.5, 0.0, 0.06)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    is_inside = (x - 0.5) ** 2 + y**2 + (z - 0.06) ** 2 < 0.06**2
    is_tumour = (x - 0.53) ** 2 + y**2 + (z - 0.06) ** 2 < 0.013**2
    probability = np.where(is_inside, np.where(is_tumour, 1.0, 0.0), np.nan)
    fields = {"axes_m": axes, "probability": probability, "is_tumour": is_tumour, "is_inside": is_inside}
    return MapPicture(**fields | {"poses_m": np.array([[0.48, 0.02, 0.12]])} | changes)


def pixels(path):
    return np.asarray(Image.open(path).convert("RGB")).astype(float)


def share_of(image, colour, tolerance=12):
    return float((np.abs(image - colour).max(axis=-1) <= tolerance).mean())


FREE = (0xEB, 0xF0, 0xF2)
TUMOUR = (0x05, 0x26, 0x3F)
POSE = (0x00, 0x9E, 0x73)
MAP = (0x00, 0x72, 0xB2)


@pytest.mark.parametrize("view", ["top", "side"])
def test_a_map_shows_free_tissue_tumour_and_poses_in_their_proportions(tmp_path, view):
    draw_map_view(tmp_path / "map.png", ball_picture(), view=view)
    image = pixels(tmp_path / "map.png")
    free, tumour, pose = (share_of(image, colour) for colour in (FREE, TUMOUR, POSE))
    # Areas: radii of 13 and 60 mm, less what outline, blur and colourbar take or add: within a factor of 1.5.
    assert 0.047 / 1.5 < tumour / free < 0.047 * 1.5
    assert pose > 1e-4


def test_without_a_tumour_nothing_is_dark(tmp_path):
    picture = ball_picture()
    nothing = np.zeros_like(picture.is_tumour)
    free = np.where(picture.is_inside, 0.0, np.nan)
    draw_map_view(tmp_path / "map.png", ball_picture(is_tumour=nothing, probability=free), view="top")
    left = pixels(tmp_path / "map.png")[:, : int(0.7 * 7.6 * 150)]  # leaves out the colour bar
    assert share_of(left, TUMOUR) == 0.0


def test_the_same_picture_gives_the_same_bytes(tmp_path):
    for name in ("first.png", "second.png"):
        draw_map_view(tmp_path / name, ball_picture(), view="top")
    assert (tmp_path / "first.png").read_bytes() == (tmp_path / "second.png").read_bytes()


def test_the_projection_takes_the_highest_probability_in_the_organ_alone():
    picture = ball_picture()
    picture.probability[0, 0, 0] = 0.9  # outside the organ
    top = highest_along(picture, 2)
    assert top[0, 0] == 0.0
    np.testing.assert_array_equal(top == 1.0, picture.is_tumour.any(axis=2))
    assert np.isfinite(top).all()


def test_arrays_of_another_lattice_are_refused():
    with pytest.raises(
        ValueError, match=r"is_inside has shape \(2, 2, 2\), but the axes span \(29, 29, 29\)"
    ):
        ball_picture(is_inside=np.ones((2, 2, 2), dtype=bool))


def test_a_meshs_silhouette_has_the_meshs_area():
    axis = np.linspace(-0.05, 0.05, 21)
    raster = Raster.around(axis, axis)
    square = np.array(
        [[[-0.02, -0.03], [0.02, -0.03], [0.02, 0.03]], [[-0.02, -0.03], [0.02, 0.03], [-0.02, 0.03]]]
    )
    silhouette = mesh_silhouette(raster, square)
    pixel_area = np.prod([centres[1] - centres[0] for centres in raster.centres_m])
    # PIL fills border pixels too: at most half a pixel (0.07 mm) more on each side of 40 by 60 mm, 0.6 %.
    assert (silhouette > 0).sum() * pixel_area == pytest.approx(0.04 * 0.06, rel=0.007)


@pytest.mark.parametrize("n_cells", [1, 2, 5])
def test_a_lattices_silhouette_keeps_even_a_single_cell(n_cells):
    mask = np.zeros((15, 15), dtype=bool)
    mask[7 : 7 + n_cells, 7] = True
    np.testing.assert_array_equal(lattice_silhouette(mask, 0.5) > 0, mask)


def test_interpolation_reproduces_a_linear_field_between_the_lattice_points():
    across, up = np.linspace(0.0, 0.1, 6), np.linspace(-0.1, 0.3, 11)
    raster = Raster.around(across, up)
    fine = raster.interpolate(2.0 * across[:, None] - up[None])
    expected = 2.0 * raster.centres_m[0].clip(0.0, 0.1)[:, None] - raster.centres_m[1].clip(-0.1, 0.3)[None]
    np.testing.assert_allclose(fine, expected, atol=1e-12)  # linear in, linear out: rounding alone


def test_unknown_values_take_the_nearest_known_one():
    values = np.array([[1.0, 0.0, 0.0, 4.0]])
    np.testing.assert_array_equal(extended_to_all(values, values > 0), [[1.0, 1.0, 4.0, 4.0]])


def test_precision_recall_fills_the_area_under_the_curve_whichever_way_it_runs(tmp_path):
    recall, precision = np.array([0.0, 0.5, 1.0]), np.array([1.0, 1.0, 0.5])  # area 0.75
    for name, step in (("rising.png", 1), ("falling.png", -1)):
        curve = {"recall": recall[::step], "precision": precision[::step]}
        draw_precision_recall(tmp_path / name, **curve, auprc=0.75, prevalence=0.01)
    assert (tmp_path / "rising.png").read_bytes() == (tmp_path / "falling.png").read_bytes()
    image = pixels(tmp_path / "rising.png")
    filled = share_of(image, (0xE0, 0xEE, 0xF6), tolerance=4)
    draw_precision_recall(tmp_path / "full.png", recall=[0, 1], precision=[1, 1], auprc=1.0, prevalence=0.01)
    full = share_of(pixels(tmp_path / "full.png"), (0xE0, 0xEE, 0xF6), tolerance=4)
    # The curve's own line covers about a hundredth of the area.
    assert filled / full == pytest.approx(0.75, abs=0.02)


def test_an_organ_without_tumour_is_said_to_have_no_curves(tmp_path):
    draw_precision_recall(tmp_path / "curve.png", recall=[], precision=[], auprc=None, prevalence=0.0)
    draw_progress(tmp_path / "auprc.png", auprc=[None, None], sensed_fraction=[None, None])
    for name in ("curve.png", "auprc.png"):
        image = pixels(tmp_path / name)
        assert share_of(image, MAP) == 0.0  # no blue curve
        assert share_of(image, (0x76, 0x76, 0x76)) > 1e-3  # but grey text


def test_progress_draws_both_series(tmp_path):
    draw_progress(tmp_path / "auprc.png", auprc=[None, 0.2, 0.9], sensed_fraction=[0.0, 0.5, 1.0])
    image = pixels(tmp_path / "auprc.png")
    assert share_of(image, MAP) > 1e-3
    assert share_of(image, (0xD5, 0x5E, 0x00)) > 1e-3


@given(
    text=st.lists(st.text("abcdefghijklmnop,()é", min_size=1, max_size=14), min_size=1, max_size=16),
    width_in=st.floats(3.7, 9.0),
)
def test_a_title_never_leaves_the_figure(text, width_in):
    figure, axes = new_figure(width_in=width_in, height_in=3.0)
    set_title(axes, " ".join(text))
    title = axes._left_title
    box = title.get_window_extent(figure.canvas.get_renderer())
    assert box.x1 <= figure.bbox.width


def test_a_short_title_keeps_its_size():
    _, axes = new_figure(width_in=5.0, height_in=3.0)
    set_title(axes, "Progress of the run")
    assert axes._left_title.get_fontsize() == 12.0
    assert axes._left_title.get_text() == "Progress of the run"


@given(
    points=st.lists(st.tuples(st.floats(0, 60), st.floats(0, 4)), max_size=60),
    gap_mm=st.floats(0.5, 6.0),
)
def test_numbers_never_lie_on_one_another(points, gap_mm):
    points_mm = np.array(points, dtype=float).reshape(-1, 2)
    places_mm = number_places(points_mm, gap_mm=gap_mm)
    apart_mm = np.linalg.norm(places_mm[:, None] - places_mm, axis=2) + np.eye(len(points)) * 1e9
    assert apart_mm.min(initial=np.inf) >= gap_mm * (1 - 1e-6)  # rounding alone
    if len(points):
        np.testing.assert_array_equal(places_mm[0], points_mm[0])


def test_lone_poses_carry_their_numbers_themselves():
    points_mm = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 10.0]])
    np.testing.assert_array_equal(number_places(points_mm, gap_mm=5.0), points_mm)
