"""A probe: the embedded one, or any MJCF file by its path."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sim.suggestions import did_you_mean

from .errors import ProbeError
from .reading import load_probe
from .rigid_probe import RigidProbe

DEFAULT = "default"


@dataclass(frozen=True, kw_only=True)
class ProbeModel:
    """A probe, by the file that it comes from."""

    path: Path | None = None
    """MJCF or URDF file; None for the embedded probe."""

    @property
    def is_embedded(self) -> bool:
        """Whether this is the probe that Sounding brings along."""
        return self.path is None

    def load(self) -> RigidProbe | None:
        """The probe as one rigid body; None for the embedded one, whose file is put into a scene as it is.

        Raises:
            ProbeError: The file is missing or broken, or holds no probe that can be used; see `load_probe`.
        """
        return None if self.path is None else load_probe(self.path)


EMBEDDED = ProbeModel()


def named_probe(probe: str) -> ProbeModel:
    """The probe of a name: `default` for the embedded one, or else the path of an MJCF or URDF file.

    Args:
        probe: Name or path.

    Raises:
        ProbeError: It is nearly the name, and no file.
    """
    if probe == DEFAULT:
        return EMBEDDED
    meant = did_you_mean(probe, (DEFAULT,))
    if meant and not Path(probe).exists():
        raise ProbeError(f"`probe` {probe}: no probe of that name, and no such file.{meant}")
    return ProbeModel(path=Path(probe))
