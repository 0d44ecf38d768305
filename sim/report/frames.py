"""The frames of a run as data that a page can hold, made smaller where there is no room."""

from __future__ import annotations

import base64
import io
from pathlib import Path

from PIL import Image

WIDTHS_PX = (None, 720, 480, 320)
"""Widths that are tried in turn; None is the frame's own."""
QUALITY = 90
"""WebP's quality: the file has a sixth of the PNG's size and looks the same; the PNG stays in the folder."""


def frame_images(folder: Path, *, most_bytes: int) -> dict[int, str]:
    """The frames as data addresses by action; where only the last frame was drawn, it stands as action 0.

    Args:
        folder: The folder that holds 0001.png and so on, or final.png.
        most_bytes: Room for all of them as text. They are scaled down until they fit, and then some are left out.
    """
    files = {int(file.stem): file for file in sorted(folder.glob("*.png")) if file.stem.isdecimal()}
    if not files and (folder / "final.png").is_file():
        files = {0: folder / "final.png"}
    if not files:
        return {}
    width_px = _width_that_fits(files[max(files)], most_bytes / len(files))
    return _thinned({step: picture_address(file, width_px) for step, file in files.items()}, most_bytes)


def _width_that_fits(file: Path, most_bytes: float) -> int | None:
    """The largest width at which a frame takes no more than its share, or the least width of all."""
    for width_px in WIDTHS_PX:
        if len(picture_address(file, width_px)) <= most_bytes:
            return width_px
    return WIDTHS_PX[-1]


def _thinned(images: dict[int, str], most_bytes: int) -> dict[int, str]:
    """As many images as there is room for, evenly over the actions; the last one comes first."""
    size = max(sum(map(len, images.values())), 1)
    stride = -(-size // max(most_bytes, 1))
    kept: dict[int, str] = {}
    for step in sorted(images, reverse=True)[::stride]:
        if sum(map(len, kept.values())) + len(images[step]) <= most_bytes:
            kept[step] = images[step]
    return dict(sorted(kept.items()))


def picture_address(file: Path, width_px: int | None) -> str:
    """A picture as WebP in a data address, no wider than `width_px` where that is given."""
    with Image.open(file) as image:
        picture = image.convert("RGB")
    if width_px is not None and width_px < picture.width:
        height_px = round(picture.height * width_px / picture.width)
        picture = picture.resize((width_px, height_px), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    picture.save(buffer, "WEBP", quality=QUALITY, method=0)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode("ascii")
