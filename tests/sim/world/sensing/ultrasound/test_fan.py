"""Scan conversion: a sample's brightness appears where the sample lies, and sizes beyond memory are refused."""

import numpy as np
import pytest

from sim.errors import FieldError
from sim.world.sensing.ultrasound.convex_array import ConvexArray
from sim.world.sensing.ultrasound.display import draw_fan, make_fan

ARRAY = ConvexArray(n_lines=96, n_samples=256)


@pytest.mark.parametrize(("line", "sample"), [(48, 128), (10, 40), (80, 230)])
def test_a_bright_spot_appears_at_its_place_in_the_plane(line, sample):
    fan = make_fan(ARRAY, 512)
    lines = np.zeros((256, 96), np.float32)
    lines[sample - 1 : sample + 2, line - 1 : line + 2] = 200.0
    image = np.zeros(512 * 512, np.uint8)
    draw_fan(lines.ravel(), fan.pixels, fan.corners, fan.parts, image)
    row, column = np.argwhere(image.reshape(512, 512) > 150).mean(axis=0)
    x_m, _, z_m = ARRAY.points_m(np.array(line), np.array(sample))
    assert fan.left_m + (column + 0.5) * fan.pixel_m == pytest.approx(x_m, abs=fan.pixel_m)
    assert fan.top_m + (row + 0.5) * fan.pixel_m == pytest.approx(z_m, abs=fan.pixel_m)


def test_the_picture_begins_on_the_width_of_the_face():
    fan = make_fan(ARRAY, 512)
    mask = np.zeros(512 * 512, bool)
    mask[fan.pixels] = True
    mask = mask.reshape(512, 512)
    # The ends of the face are its highest points, since its middle is the tip.
    columns = np.flatnonzero(mask[0])
    assert (columns[-1] - columns[0]) * fan.pixel_m == pytest.approx(
        ARRAY.face_width_m, abs=3.0 * fan.pixel_m
    )
    middle = mask[:, 256]
    assert fan.top_m + np.flatnonzero(middle)[0] * fan.pixel_m == pytest.approx(0.0, abs=1.5 * fan.pixel_m)


@pytest.mark.parametrize("n_pixels", [0, 8, 10**7])
def test_a_size_without_pixels_or_beyond_memory_is_refused(n_pixels):
    with pytest.raises(FieldError, match="image_pixels"):
        make_fan(ARRAY, n_pixels)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("depth_m", 0.0),
        ("radius_m", 0.01),
        ("n_lines", 1),
        ("n_samples", 10**12),
        ("frequency_hz", np.inf),
        ("bandwidth", 3.0),
    ],
)
def test_an_array_that_cannot_be_is_refused_by_the_name_of_the_field(name, value):
    with pytest.raises(FieldError, match=name):
        ConvexArray(**{name: value})
