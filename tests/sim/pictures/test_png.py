"""Pictures on disk against Pillow's reader, and edges against their definition."""

import io

import numpy as np
import pytest
from PIL import Image

from sim.pictures.png import png_bytes
from sim.pictures.smoothing import EDGE_STEP, smooth_edges


@pytest.mark.parametrize("shape", [(1, 1), (3, 7), (64, 48)])
def test_pillow_reads_every_pixel_back(shape):
    pixels = np.random.default_rng(0).integers(0, 256, (*shape, 3), dtype=np.uint8)
    image = Image.open(io.BytesIO(png_bytes(pixels)))
    image.load()  # checks the checksums too
    assert image.format == "PNG"
    np.testing.assert_array_equal(np.asarray(image), pixels)


def test_what_is_no_rgb_picture_is_refused():
    with pytest.raises(ValueError, match=r"uint8 of shape \(height, width, 3\), not float64 \(4, 4, 3\)"):
        png_bytes(np.zeros((4, 4, 3)))


def test_an_edge_becomes_the_binomial_mean_and_the_rest_stays():
    pixels = np.full((9, 12, 3), 40, dtype=np.uint8)
    pixels[:, 6:] = (200, 180, 160)
    smooth = smooth_edges(pixels)
    np.testing.assert_array_equal(smooth[[0, -1]], pixels[[0, -1]])
    np.testing.assert_array_equal(smooth[:, :5], pixels[:, :5])
    np.testing.assert_array_equal(smooth[:, 7:], pixels[:, 7:])
    # Columns of the kernel weigh 1/4, 1/2, 1/4.
    np.testing.assert_array_equal(smooth[1:-1, 5], np.broadcast_to((80, 75, 70), (7, 3)))
    np.testing.assert_array_equal(smooth[1:-1, 6], np.broadcast_to((160, 145, 130), (7, 3)))


def test_shading_is_left_alone():
    shades = np.arange(0, 10 * EDGE_STEP, EDGE_STEP, dtype=np.uint8)[:, None, None]
    pixels = np.broadcast_to(shades, (10, 8, 3)).copy()
    np.testing.assert_array_equal(smooth_edges(pixels), pixels)
