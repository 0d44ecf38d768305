"""Captions and the key to the colours: what stands in it, and that it never covers what the camera shows."""

import dataclasses

import numpy as np
import pytest

from sim.colours import trace_rgb
from sim.pictures.captions import CAPTION_PX, PAPER, captioned, frame_settings, key_of
from sim.world.anatomy.structures import Structure
from sim.world.camera.rendering import PATH_RGBA


def rgb(rgba):
    return np.array([round(255 * each) for each in rgba[:3]])


def test_the_key_tells_the_way_of_the_tip(ball_anatomy):
    key = np.asarray(key_of(ball_anatomy, 960, 720)).astype(int)
    near = np.abs(key - rgb(PATH_RGBA)).max(axis=-1) <= 2
    assert near.sum() > 30  # a line of 16 by 3 pixels


@pytest.mark.parametrize("width_px", [480, 640, 960, 1920])
def test_the_key_keeps_its_entries_within_the_picture(ball_anatomy, width_px):
    shell = ball_anatomy.organ
    structures = tuple(
        Structure(name=name, solid=shell, is_keepout=is_keepout)
        for name, is_keepout in (("vein", False), ("gallbladder", True))
    )
    anatomy = dataclasses.replace(ball_anatomy, structures=structures)
    key = np.asarray(key_of(anatomy, width_px, 1440))
    assert key.shape[1] == width_px
    assert (key[:, -3:] == PAPER).all()
    assert (key[-2:] == PAPER).all()


def test_a_small_picture_has_no_key(ball_anatomy):
    assert key_of(ball_anatomy, 320, 240) is None
    assert frame_settings(ball_anatomy, width_px=320, height_px=240).below_px == 0


def test_caption_and_key_stand_in_the_room_that_the_camera_leaves(ball_anatomy):
    settings = frame_settings(ball_anatomy)
    grey = np.full((settings.height_px, settings.width_px, 3), 120, dtype=np.uint8)
    picture = captioned(grey, "liver   ·   action 4", ball_anatomy)
    assert picture.shape == grey.shape
    between = picture[settings.above_px : settings.height_px - settings.below_px]
    assert (between == 120).all()
    assert settings.above_px == CAPTION_PX
    assert (picture[: settings.above_px] != 120).any()
    assert (picture[settings.height_px - settings.below_px :] != 120).all(axis=-1).mean() > 0.9


def test_the_key_of_a_sweep_tells_the_ages_of_its_trace(ball_anatomy):
    plain, swept = (np.asarray(key_of(ball_anatomy, 960, 720, has_trace=has)).astype(int) for has in (0, 1))
    assert not (np.abs(plain - rgb(trace_rgb(1.0))).max(axis=-1) <= 2).any()
    for age in (0.0, 0.5, 1.0):
        near = np.abs(swept - rgb(trace_rgb(age))).max(axis=-1) <= 2
        assert near.sum() >= 7  # a column
    room = frame_settings(ball_anatomy, width_px=960, height_px=720, has_trace=True).below_px
    assert room == len(swept)
