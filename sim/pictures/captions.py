"""Captions: a picture of the scene with a line of text above and the key to its colours."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import matplotlib
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from sim.world.anatomy.structures import Structure
from sim.world.scene.rendering import CELL_RGBA, CURRENT_RGBA, SENSED_RGBA
from sim.world.scene.scene import (
    CONE_RGBA,
    KEEPOUT_RGBA,
    ORGAN_RGBA,
    STRUCTURE_RGBA,
    TARGET_RGBA,
    TUMOUR_RGBA,
)

from .smoothing import smooth_edges

LEGEND = (
    ("true tumour", TUMOUR_RGBA),
    ("likely tumour, by the map", CELL_RGBA),
    ("sensed cone", CONE_RGBA),
    ("sensed before", SENSED_RGBA),
    ("sensed now", CURRENT_RGBA),
    ("organ", ORGAN_RGBA),
)
STRUCTURES = {
    False: ("vessels and the like", STRUCTURE_RGBA),
    True: ("must not be pressed", KEEPOUT_RGBA),
}
"""Name and colour of structures, and of those to keep away from."""
MOST_LETTERS = 24
"""Most letters of a name in the key, which has no room for more."""
INK, PAPER = (28, 38, 52), (250, 251, 252)


def captioned(
    pixels: NDArray[np.uint8], caption: str, structures: Sequence[Structure] = (), target: str | None = None
) -> NDArray[np.uint8]:
    """A picture with smoothed edges, a caption, and the key to the colours where there is room; the shape is kept."""
    height_px, width_px = pixels.shape[:2]
    image = Image.fromarray(smooth_edges(pixels))
    legend = _legend(*{each.is_keepout: None for each in structures}, target=target)
    if height_px >= 2 * legend.height and width_px >= 2 * legend.width:
        image.paste(legend, (14, height_px - 12 - legend.height), legend)
    draw = ImageDraw.Draw(image)
    draw.rectangle((0, 0, width_px, 54), fill=PAPER)
    draw.text((20, 14), caption, font=_font(21), fill=INK)
    return np.asarray(image)


@lru_cache(maxsize=4)
def _font(size_px: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts/ttf/DejaVuSans.ttf"), size_px)


@lru_cache(maxsize=4)
def _legend(*kinds: bool, target: str | None = None) -> Image.Image:
    """The key to the colours, as a translucent card.

    Args:
        kinds: Kinds of structures: True for those to keep away from, False for others.
        target: What a second class is called; None where there is none.
    """
    targets = [] if target is None else [(f"true {target}"[:MOST_LETTERS], TARGET_RGBA)]
    entries = [*LEGEND, *targets, *(STRUCTURES[kind] for kind in sorted(kinds))]
    row_px, n = 24, len(entries)
    card = Image.new("RGBA", (246, row_px * n + 14), (0, 0, 0, 0))
    draw = ImageDraw.Draw(card)
    draw.rounded_rectangle((0, 0, card.width - 1, card.height - 1), radius=8, fill=(255, 255, 255, 200))
    for i, (label, rgba) in enumerate(entries):
        y_px = 8 + row_px * i
        rgb = tuple(round(255 * channel) for channel in rgba[:3])
        draw.rounded_rectangle(
            (12, y_px + 3, 28, y_px + 17), radius=4, fill=(*rgb, 255), outline=(90, 98, 110, 255)
        )
        draw.text((38, y_px + 1), label, font=_font(15), fill=(*INK, 255))
    return card
