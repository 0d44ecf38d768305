"""B-mode pictures: as files of a run's folder, and as a panel with a scale of depth beside the scene."""

from __future__ import annotations

import json

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy.ndimage import binary_erosion

from sim.record.run_folder import RunFolder
from sim.world.sensing.sweep import KeptPlanes, Sweep

from .captions import CAPTION_PX, CAPTION_SIZE_PX, INK, PAPER, label_font
from .png import png_bytes

FOLDER = "ultrasound"
"""Where a run keeps its B-mode pictures."""
TICK_M = 0.01
"""Depth from one mark of the scale to the next [m]."""
TICKS_A_NUMBER = 5
"""Marks from one number of the scale to the next."""
OUTLINE = "#56B4E9"
"""The outline of what a reader saw: the map's blue, lighter, since it stands on black."""
OUTLINE_PX = 2
"""Its width."""
MARK_INK = (150, 156, 164)
SCALE_PX = 72
"""Width of the scale."""
MARK_PX, MARK_SIZE_PX = 6, 13
"""Length of a mark and height of the numbers beside them."""


def write_sweep(folder: RunFolder, step: int, sweep: Sweep | None, keep: KeptPlanes = "middle") -> None:
    """Write the pictures of an action: ultrasound/<step>.png for the middle plane, and <step>-<plane>.png for others.

    Each holds as text where its plane lies and how large its pixels are, which is what a reader of it needs.

    Args:
        folder: The run's folder.
        step: The action, from 1.
        sweep: What the sensor drew; None of one that draws nothing.
        keep: Which pictures.
    """
    if sweep is None or keep == "none":
        return
    for plane in range(len(sweep.images)) if keep == "all" else (sweep.middle,):
        name = f"{step:04d}" if plane == sweep.middle else f"{step:04d}-{plane:02d}"
        folder.write_bytes(f"{FOLDER}/{name}.png", sweep_png(sweep, plane))


def sweep_png(sweep: Sweep, plane: int) -> bytes:
    """The picture of a plane as a PNG file, which tells as text where the plane lies and how large a pixel is."""
    texts = {
        "T_world_plane": json.dumps(sweep.T_world_planes[plane].tolist()),
        "pixel_m": repr(sweep.pixel_m),
        "left_m": repr(sweep.left_m),
        "top_m": repr(sweep.top_m),
    }
    return png_bytes(sweep.images[plane], texts=texts)


def bmode_panel(sweep: Sweep, height_px: int) -> NDArray[np.uint8]:
    """The middle plane as a panel to stand beside a frame: a caption above, a scale of depth at its side.

    What a reader took for lesion is outlined in the colour of the map.

    Args:
        sweep: What the sensor drew.
        height_px: Height of the panel, caption included.

    Returns:
        RGB, shape (height_px, width, 3).
    """
    size_px = height_px - CAPTION_PX
    picture = Image.fromarray(sweep.images[sweep.middle]).resize((size_px, size_px), Image.Resampling.LANCZOS)
    panel = Image.new("RGB", (SCALE_PX + size_px, height_px))
    panel.paste(picture.convert("RGB"), (SCALE_PX, CAPTION_PX))
    if sweep.middle_lesions is not None:
        outline = Image.fromarray(_outline(sweep.middle_lesions, size_px))
        panel.paste(OUTLINE, (SCALE_PX, CAPTION_PX), mask=outline)
    draw = ImageDraw.Draw(panel)
    draw.rectangle((0, 0, panel.width, CAPTION_PX - 1), fill=PAPER)
    text = "ultrasound" if sweep.middle_lesions is None else "ultrasound, read"
    if len(sweep.images) > 1:
        text += f"   ·   plane {sweep.middle + 1} of {len(sweep.images)}"
    draw.text((20, CAPTION_PX // 2), text, font=label_font(CAPTION_SIZE_PX), fill=INK, anchor="lm")
    px_per_m = size_px / (sweep.pixel_m * sweep.images.shape[1])
    for mark in range(int((sweep.images.shape[1] * sweep.pixel_m + sweep.top_m) / TICK_M) + 1):
        y_px = CAPTION_PX + (mark * TICK_M - sweep.top_m) * px_per_m
        is_numbered = mark % TICKS_A_NUMBER == 0
        draw.line((8, y_px, 8 + MARK_PX * (2 if is_numbered else 1), y_px), fill=MARK_INK)
        if is_numbered and mark:
            depth_mm = f"{mark * TICK_M * 1e3:.0f} mm"
            draw.text((24, y_px), depth_mm, font=label_font(MARK_SIZE_PX), fill=MARK_INK, anchor="lm")
    return np.asarray(panel)


def _outline(mask: NDArray[np.bool_], size_px: int) -> NDArray[np.bool_]:
    """The outline of a mask that is scaled to a square, shape (size_px, size_px)."""
    scaled = Image.fromarray(mask.astype(np.uint8) * 255).resize(
        (size_px, size_px), Image.Resampling.BILINEAR
    )
    is_in = np.asarray(scaled) > 127
    return is_in & ~binary_erosion(is_in, iterations=OUTLINE_PX)
