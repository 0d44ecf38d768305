"""The panel of a B-mode picture: what a reader saw is outlined where it saw it."""

import dataclasses

import numpy as np
from PIL import ImageColor

from sim.pictures.bmode import OUTLINE, SCALE_PX, bmode_panel
from sim.pictures.captions import CAPTION_PX
from sim.world.sensing.sweep import Sweep

N_PIXELS, HEIGHT_PX = 100, 400 + CAPTION_PX
SWEEP = Sweep(
    np.full((3, N_PIXELS, N_PIXELS), 90, np.uint8),
    np.tile(np.eye(4), (3, 1, 1)),
    0.001,
    -0.05,
    0.0,
    np.zeros(0, np.int64),
)


def test_what_a_reader_saw_is_outlined_where_it_lies():
    mask = np.zeros((N_PIXELS, N_PIXELS), bool)
    mask[20:40, 50:80] = True
    panel = bmode_panel(dataclasses.replace(SWEEP, middle_lesions=mask), HEIGHT_PX)
    is_outline = (panel == ImageColor.getrgb(OUTLINE)).all(axis=2)[CAPTION_PX:, SCALE_PX:]
    rows, columns = np.nonzero(is_outline)
    # The picture is shown four times as large, and the line is 2 pixels wide, inside of the edge.
    assert (rows.min(), rows.max() + 1, columns.min(), columns.max() + 1) == (80, 160, 200, 320)
    assert not is_outline[90:150, 210:310].any()
    assert 2 * (80 + 120) * 2 * 0.9 < is_outline.sum() < 2 * (80 + 120) * 2 * 1.1


def test_without_a_reader_nothing_is_drawn_over_the_picture():
    panel = bmode_panel(SWEEP, HEIGHT_PX)
    # The numbers of the scale may reach a little into the picture.
    picture = panel[CAPTION_PX:, SCALE_PX + 20 :]
    assert (picture == picture[..., :1]).all()
    # A reader that saw nothing draws nothing either.
    none = dataclasses.replace(SWEEP, middle_lesions=np.zeros((N_PIXELS, N_PIXELS), bool))
    assert np.array_equal(bmode_panel(none, HEIGHT_PX)[CAPTION_PX:, SCALE_PX + 20 :], picture)
