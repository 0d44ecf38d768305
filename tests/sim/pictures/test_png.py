"""Pictures on disk against Pillow's reader."""

import io

import numpy as np
import pytest
from PIL import Image

from sim.pictures.png import png_bytes


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
