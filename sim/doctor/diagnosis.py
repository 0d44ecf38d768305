"""The diagnosis: what is installed, what renders, and what to do about each line that is red."""

import os
import platform
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from typing import Literal, TextIO

from packaging.requirements import Requirement

from sim.extras import EXTRAS, install_command, pip_command

from .gl_probe import GL_NAMES, GL_REMEDY, HEADLESS_GL_NAMES, GlProbe, probe_gl

Status = Literal["ok", "note", "red"]

LEAST_PYTHON = (3, 11)
_DISTRIBUTION = "sounding"
_ANSI = {"ok": "\x1b[32m", "note": "\x1b[33m", "red": "\x1b[31m"}
_ANSI_END = "\x1b[0m"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One line of the doctor's table."""

    subject: str
    """What was looked at."""
    status: Status
    """`ok`, `note` for what is worth knowing but hinders nobody, or `red` for what must be mended before a run."""
    found: str
    """What was found."""
    remedy: str = ""
    """What to do about it; never empty when the status is red."""


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """Everything that the doctor found."""

    findings: tuple[Finding, ...]
    """The lines, in the order of the table."""

    @property
    def is_healthy(self) -> bool:
        """Whether no line is red."""
        return all(finding.status != "red" for finding in self.findings)

    @property
    def exit_code(self) -> int:
        """The exit code: 0 if no line is red, 1 otherwise."""
        return 0 if self.is_healthy else 1


def run_doctor(stream: TextIO | None = None) -> Diagnosis:
    """Look at everything, print the table, and return what was found.

    Args:
        stream: Where to print; None for standard output. Only a terminal gets colours.
    """
    probes = [probe_gl(name) for name in GL_NAMES]
    diagnosis = Diagnosis(
        findings=(
            find_python(sys.version_info[:3]),
            *find_packages(requires_or_none(_DISTRIBUTION)),
            *find_extras(),
            *find_renderers(probes, os.environ.get("MUJOCO_GL")),
            find_blas_threads(),
        )
    )
    print_diagnosis(diagnosis, stream or sys.stdout)
    return diagnosis


def find_python(found: Sequence[int]) -> Finding:
    """Whether this Python is new enough.

    Args:
        found: Its version, major first.
    """
    text = ".".join(map(str, found)) + f" on {platform.system()} {platform.machine()}"
    if tuple(found[:2]) >= LEAST_PYTHON:
        return Finding(subject="python", status="ok", found=text)
    least = ".".join(map(str, LEAST_PYTHON))
    remedy = f"install Python {least} or later, remove .venv and run make again"
    return Finding(subject="python", status="red", found=text, remedy=remedy)


def requires_or_none(distribution: str) -> list[str] | None:
    """The requirements that a distribution states, or None if it is not installed."""
    try:
        return requires(distribution) or []
    except PackageNotFoundError:
        return None


def find_packages(requirements: list[str] | None) -> list[Finding]:
    """Whether each required package is installed in a version that fits.

    Args:
        requirements: Requirements as in pyproject.toml, of which those of extras are passed over; None if the project
            itself is not installed.
    """
    if requirements is None:
        remedy = install_command()
        return [Finding(subject=_DISTRIBUTION, status="red", found="not installed", remedy=remedy)]
    parsed = [Requirement(text) for text in requirements]
    return [_find_package(one) for one in parsed if one.marker is None or one.marker.evaluate({"extra": ""})]


def find_extras() -> list[Finding]:
    """Which extras are installed, what each gives, and how to get the others; nobody must have them."""
    findings = []
    for name, extra in EXTRAS.items():
        if not extra.is_for_users:
            continue
        text, remedy = f"installed: {extra.gives}", ""
        if not extra.is_installed:
            text, remedy = f"not installed, gives {extra.gives}", install_command(name)
        status: Status = "note" if remedy else "ok"
        findings.append(Finding(subject=f"extra {name}", status=status, found=text, remedy=remedy))
    return findings


def find_renderers(probes: Sequence[GlProbe], chosen: str | None) -> list[Finding]:
    """What renders, how fast, and whether MUJOCO_GL names something that does not.

    One renderer without a display is enough: where one works, those that do not are notes.

    Args:
        probes: One probe per renderer.
        chosen: The value of MUJOCO_GL, None if unset.
    """
    is_enough = any(probe.is_working and probe.name in HEADLESS_GL_NAMES for probe in probes)
    findings = [_find_renderer(probe, is_enough=is_enough) for probe in probes]
    if chosen and not any(probe.is_working and probe.name == chosen.lower() for probe in probes):
        remedy = "unset MUJOCO_GL, or set it to one that works"
        found = f"{chosen}, which does not work"
        findings.append(Finding(subject="MUJOCO_GL", status="red", found=found, remedy=remedy))
    return findings


def find_blas_threads() -> Finding:
    """The number of threads with which the linear algebra of NumPy and SciPy starts; runs limit it to one."""
    try:
        import numpy as np
        import scipy.linalg
        from threadpoolctl import threadpool_info
    except ImportError as error:
        remedy = install_command()
        return Finding(subject="BLAS threads", status="red", found=f"{error.name} is missing", remedy=remedy)
    # SciPy loads its own library on first use.
    scipy.linalg.qr(np.eye(2))
    pools = [pool for pool in threadpool_info() if pool["user_api"] == "blas"]
    text = ", ".join(f"{pool['internal_api']} {pool['version']}: {pool['num_threads']}" for pool in pools)
    return Finding(subject="BLAS threads", status="ok", found=f"{text or 'none found'}; episodes use 1")


def print_diagnosis(diagnosis: Diagnosis, stream: TextIO) -> None:
    """Print the table: subject, status, what was found, and below each line that is not well what to do.

    Args:
        diagnosis: What was found.
        stream: Where to print.
    """
    width = max(len(finding.subject) for finding in diagnosis.findings)
    for finding in diagnosis.findings:
        mark = f"{finding.status:<4}"
        if stream.isatty():
            mark = f"{_ANSI[finding.status]}{mark}{_ANSI_END}"
        print(f"{finding.subject:<{width}}  {mark}  {finding.found}", file=stream)
        if finding.remedy:
            print(f"{'':<{width}}        -> {finding.remedy}", file=stream)
    n_red = sum(finding.status == "red" for finding in diagnosis.findings)
    print("All is well." if n_red == 0 else f"{n_red} red: see the arrows.", file=stream)


def _find_package(requirement: Requirement) -> Finding:
    remedy = f"{pip_command()} install '{requirement}'"
    if requirement.name == "mujoco":
        remedy = "remove .venv and run make again: MuJoCo cannot be upgraded in place"
    try:
        found = version(requirement.name)
    except PackageNotFoundError:
        return Finding(subject=requirement.name, status="red", found="not installed", remedy=remedy)
    if requirement.specifier.contains(found, prereleases=True):
        return Finding(subject=requirement.name, status="ok", found=found)
    text = f"{found}, but {requirement.specifier} is needed"
    return Finding(subject=requirement.name, status="red", found=text, remedy=remedy)


def _find_renderer(probe: GlProbe, *, is_enough: bool) -> Finding:
    subject = f"renderer {probe.name}"
    if probe.is_working and probe.frame_s is not None:
        text = f"works, {1e3 * probe.frame_s:.0f} ms per 640x480 frame"
        return Finding(subject=subject, status="ok", found=text)
    if is_enough or probe.name not in HEADLESS_GL_NAMES:
        text = f"does not work, not needed ({probe.message})"
        return Finding(subject=subject, status="note", found=text)
    return Finding(subject=subject, status="red", found=f"does not work ({probe.message})", remedy=GL_REMEDY)
