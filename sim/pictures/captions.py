"""Captions: a picture of the scene with a line of text above and the key to its colours."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from sim.colours import trace_rgb
from sim.world.anatomy.anatomy import Anatomy
from sim.world.camera.rendering import CELL_RGBA, CURRENT_RGBA, PATH_RGBA, SENSED_RGBA, RenderSettings
from sim.world.scene.scene import KEEPOUT_RGBA, ORGAN_RGBA, STRUCTURE_RGBA, TARGET_RGBA, TUMOUR_RGBA

LEGEND = (
    ("organ", ORGAN_RGBA),
    ("true tumour", TUMOUR_RGBA),
    ("likely tumour, by the map", CELL_RGBA),
    ("sensed now, with its cone", CURRENT_RGBA),
    ("sensed before", SENSED_RGBA),
    ("way of the tip to this action", PATH_RGBA),
)
STRUCTURES = {
    False: ("vessels and the like", STRUCTURE_RGBA),
    True: ("must not be pressed", KEEPOUT_RGBA),
}
"""Name and colour of structures, and of those to keep away from."""
TRACE = "way on the organ, from old to new"
"""Name of the trace of a sweep, which has a colour for each age."""
MOST_LETTERS = 24
"""Most letters of a name in the key, which has no room for more."""
INK, PAPER = (28, 38, 52), (250, 251, 252)
CAPTION_PX, CAPTION_SIZE_PX = 46, 21
"""Height of the strip above and of the letters in it."""
ROW_PX, KEY_SIZE_PX, KEY_GAP_PX = 26, 16, 26
"""Height of a row of the key below, of the letters in it, and the room between two entries."""
LEAST_WIDTH_PX = 480
"""Narrower pictures have no key."""


def frame_settings(
    anatomy: Anatomy, *, width_px: int | None = None, height_px: int | None = None, has_trace: bool = False
) -> RenderSettings:
    """The settings of pictures that leave room for caption and key; sizes are the defaults unless they are given."""
    plain = RenderSettings()
    width_px, height_px = width_px or plain.width_px, height_px or plain.height_px
    key_px = key_of(anatomy, width_px, height_px, has_trace=has_trace)
    return replace(
        plain,
        width_px=width_px,
        height_px=height_px,
        above_px=min(CAPTION_PX, height_px // 4),
        below_px=0 if key_px is None else key_px.height,
    )


def captioned(
    pixels: NDArray[np.uint8], caption: str, anatomy: Anatomy, *, has_trace: bool = False
) -> NDArray[np.uint8]:
    """A picture with a caption above, and below the key to the colours where there is room; the shape is kept."""
    height_px, width_px = pixels.shape[:2]
    image = Image.fromarray(pixels)
    key = key_of(anatomy, width_px, height_px, has_trace=has_trace)
    if key is not None:
        image.paste(key, (0, height_px - key.height))
    draw = ImageDraw.Draw(image)
    draw.rectangle((0, 0, width_px, CAPTION_PX - 1), fill=PAPER)
    draw.text((20, CAPTION_PX // 2), caption, font=label_font(CAPTION_SIZE_PX), fill=INK, anchor="lm")
    return np.asarray(image)


def key_of(anatomy: Anatomy, width_px: int, height_px: int, *, has_trace: bool = False) -> Image.Image | None:
    """The key to the colours of a picture of an anatomy, a strip of its width; None where the picture is too small.

    Args:
        anatomy: What the picture shows.
        width_px: Its width.
        height_px: Its height.
        has_trace: Whether it shows the trace of a sweep.
    """
    kinds = tuple(sorted({each.is_keepout for each in anatomy.structures}))
    key = _key(
        width_px, *kinds, target=None if anatomy.target is None else anatomy.target.name, has_trace=has_trace
    )
    return key if width_px >= LEAST_WIDTH_PX and height_px >= 4 * key.height else None


@lru_cache(maxsize=4)
def label_font(size_px: int) -> ImageFont.FreeTypeFont:
    """The letters of captions, marks and keys."""
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts/ttf/DejaVuSans.ttf"), size_px)


@lru_cache(maxsize=4)
def _key(width_px: int, *kinds: bool, target: str | None = None, has_trace: bool = False) -> Image.Image:
    """The key to the colours, in as many rows as its entries need.

    Args:
        width_px: Its width.
        kinds: Kinds of structures: True for those to keep away from, False for others.
        target: What a second class is called; None where there is none.
        has_trace: Whether the trace of a sweep is shown.
    """
    targets = [] if target is None else [(f"true {target}"[:MOST_LETTERS], TARGET_RGBA)]
    traces = [(TRACE, PATH_RGBA)] if has_trace else []
    entries = [*LEGEND, *traces, *targets, *(STRUCTURES[kind] for kind in kinds)]
    font, x_px, row = label_font(KEY_SIZE_PX), 20, 0
    places: list[tuple[int, int]] = []
    for label, _ in entries:
        taken_px = 24 + int(font.getlength(label))
        if places and x_px + taken_px > width_px - 12:
            x_px, row = 20, row + 1
        places.append((x_px, 8 + ROW_PX * row))
        x_px += taken_px + KEY_GAP_PX
    card = Image.new("RGB", (width_px, ROW_PX * (row + 1) + 14), PAPER)
    draw = ImageDraw.Draw(card)
    for (label, rgba), (x_px, y_px) in zip(entries, places, strict=True):
        rgb = tuple(round(255 * channel) for channel in rgba[:3])
        mark = (x_px, y_px + 6, x_px + 16, y_px + 20)
        if label == TRACE:
            for column in range(17):
                old = tuple(round(255 * channel) for channel in trace_rgb(column / 16))
                draw.line((x_px + column, y_px + 10, x_px + column, y_px + 16), fill=old)
        elif rgba == PATH_RGBA:
            draw.line((x_px, y_px + 13, x_px + 16, y_px + 13), fill=rgb, width=3)
        elif rgba in (SENSED_RGBA, CURRENT_RGBA):
            draw.ellipse((x_px + 1, y_px + 6, x_px + 15, y_px + 20), fill=rgb, outline=(90, 98, 110), width=1)
        else:
            draw.rounded_rectangle(mark, radius=4, fill=rgb, outline=(90, 98, 110))
        draw.text((x_px + 24, y_px + 13), label, font=font, fill=INK, anchor="lm")
    return card
