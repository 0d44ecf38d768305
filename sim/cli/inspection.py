"""`sounding inspect`: what a patient's files hold, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from sim.errors import FieldError
from sim.record.default_folders import file_part, first_path
from sim.running.case import CaseConfig

from .terminal import NOT_USABLE, in_flags, parse

EXAMPLES = """
sounding inspect liver.nii.gz
sounding inspect liver.nii.gz --organ-label 1 --tumour-label 2
sounding inspect liver.stl --tumour tumour.stl --out liver.png
"""
"""What the help begins with."""


@dataclass(frozen=True, kw_only=True)
class Options:
    """Say what a mesh or a label volume holds, what is wrong with it and what to do, and draw it.

    It tells labels, volumes, spacing, orientation, islands, and tumours with diameters and depths. The exit code is 0
    where the file can be used as the organ with the options that are given, and 1 where it cannot.
    """

    file: Annotated[Path, tyro.conf.Positional]
    """Mesh (STL, OBJ, PLY, GLB, glTF) or label volume (.nii, .nii.gz, .nrrd, .nhdr)."""
    out: Path | None = None
    """Picture to draw (.png); by default renders/inspect-<name>.png, with a number behind the name where that shows
    another file."""
    case: CaseConfig = field(default_factory=CaseConfig)

    def __post_init__(self) -> None:
        """Validate the ranges."""
        spacing_mm = self.case.spacing_mm
        if spacing_mm is not None and not all(0.02 <= each <= 30.0 for each in spacing_mm):
            raise FieldError("spacing_mm", spacing_mm, "must be from 0.02 to 30 mm.")
        if self.out is not None and self.out.suffix.lower() != ".png":
            raise FieldError("out", self.out, "must end with .png.")

    @property
    def picture(self) -> Path:
        """The PNG to draw: the one that is named, or the first of the file's name that shows no other file."""
        if self.out is not None:
            return self.out
        name = f"inspect-{file_part(str(self.file))}.png"
        return first_path(name, lambda path: not path.exists() or shows(path, self.file))


def shows(picture: Path, file: Path) -> bool:
    """Whether a PNG is known to show a file."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(picture) as image:
            return image.info.get("Source") == str(file.absolute())
    except (OSError, UnidentifiedImageError):
        return False


def parse_options(arguments: Sequence[str], prog: str) -> Options:
    """The options that the command line gives."""
    return parse(Options, arguments, prog=prog, examples=EXAMPLES)


def run(options: Options) -> int:
    """Look at the files, print what they hold, and return the exit code."""
    from sim.viewing.inspection import inspect

    inspection = inspect(options.case.files(options.file), options.picture)
    print(in_flags(inspection.text, Options))
    return 0 if inspection.is_usable else NOT_USABLE
