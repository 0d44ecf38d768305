"""The frames of a run as data that a page can hold, made smaller where there is no room."""

from __future__ import annotations

import base64
import io
from pathlib import Path

from PIL import Image

WIDTHS_PX = (720, 480, 320)
BASE64 = 4 / 3


def frame_images(folder: Path, *, most_bytes: int) -> dict[int, str]:
    """Data addresses of the frames by action; the last frame alone where only that was drawn, as action 0.

    Args:
        folder: Holds 0001.png and so on, or final.png.
        most_bytes: Room for all of them as text. They are scaled down until they fit, then thinned out.
    """
    files = {int(file.stem): file for file in sorted(folder.glob("*.png")) if file.stem.isdecimal()}
    if not files and (folder / "final.png").is_file():
        files = {0: folder / "final.png"}
    if sum(file.stat().st_size for file in files.values()) * BASE64 <= most_bytes:
        return {step: _address(file.read_bytes()) for step, file in files.items()}
    images: dict[int, str] = {}
    for width_px in WIDTHS_PX:
        images = {step: _address(_scaled(file, width_px)) for step, file in files.items()}
        if sum(map(len, images.values())) <= most_bytes:
            break
    return _thinned(images, most_bytes)


def _thinned(images: dict[int, str], most_bytes: int) -> dict[int, str]:
    """As many as there is room for, evenly over the actions, the last one first."""
    size = max(sum(map(len, images.values())), 1)
    stride = -(-size // max(most_bytes, 1))
    kept: dict[int, str] = {}
    for step in sorted(images, reverse=True)[::stride]:
        if sum(map(len, kept.values())) + len(images[step]) <= most_bytes:
            kept[step] = images[step]
    return dict(sorted(kept.items()))


def _address(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode("ascii")


def _scaled(file: Path, width_px: int) -> bytes:
    with Image.open(file) as image:
        height_px = round(image.height * width_px / image.width)
        small = image.convert("RGB").resize((width_px, height_px), Image.Resampling.LANCZOS)
    buffer = io.BytesIO()
    small.save(buffer, "PNG")
    return buffer.getvalue()
