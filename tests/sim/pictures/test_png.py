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


def test_what_is_neither_rgb_nor_grey_is_refused():
    with pytest.raises(
        ValueError, match=r"uint8 of shape \(height, width, 3\) or .*, not float64 \(4, 4, 3\)"
    ):
        png_bytes(np.zeros((4, 4, 3)))


def test_a_grey_picture_with_texts_comes_back_as_it_was() -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (7, 11), dtype=np.uint8)
    with Image.open(io.BytesIO(png_bytes(pixels, texts={"pixel_m": "0.001", "note": "a b"}))) as image:
        assert np.array_equal(np.asarray(image), pixels)
        assert image.info["pixel_m"] == "0.001"
        assert image.info["note"] == "a b"
