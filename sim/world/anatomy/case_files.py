"""The files of a case, and how to read them: one record, passed whole from whoever names them to the reader.

Names and records only, so that they can be had before anything heavy is loaded.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from sim.world.meshes.coordinates import MeshFrame, Unit
from sim.world.volumes.label_coding import LabelChoice

if TYPE_CHECKING:
    import trimesh

    from sim.world.solids.solid import Solid

    Body = str | Solid | trimesh.Trimesh
    """A file's path, or a closed surface in memory [m]."""


@dataclass(frozen=True, kw_only=True)
class CaseFiles:
    """Which files hold an anatomy, and how to read them. Surfaces in memory may stand in place of files."""

    organ: Body
    """Mesh or label volume of the organ; or a surface in memory, in metres and patient axes (LPS)."""
    organ_object: str | None = None
    """Name of the object in the organ's file that is the organ, or `piece 2` for the second largest of its pieces."""
    tumours: tuple[Body, ...] = ()
    """Meshes or label volumes of tumours, besides those that the organ's volume holds."""
    targets: tuple[Body, ...] = ()
    """Meshes or label volumes of a second class to be mapped, besides what the organ's volume holds of it."""
    structures: tuple[str, ...] = ()
    """Meshes or masks of structures to show."""
    keepouts: tuple[str, ...] = ()
    """Meshes or masks of structures to keep away from."""
    unit: Unit = "mm"
    """Unit of meshes."""
    frame: MeshFrame = "auto"
    """Axes of meshes: lps, ras, or auto for what the file says, and LPS where it says nothing."""
    labels: LabelChoice = field(default_factory=LabelChoice)
    """What the labels of volumes mean."""
    spacing_m: tuple[float, float, float] | None = None
    """Distances between voxels in place of the header's [m]."""
    voxel_axes: str | None = None
    """Where the axes of volumes run in place of the header's, for example RAS."""

    @property
    def paths(self) -> tuple[str, ...]:
        """The paths of all files."""
        return tuple(body for body in self._bodies() if isinstance(body, str))

    @property
    def has_targets(self) -> bool:
        """Whether a second class is named."""
        return bool(self.targets or self.labels.targets)

    def _bodies(self) -> Iterator[Body]:
        yield self.organ
        for bodies in (self.tumours, self.targets, self.structures, self.keepouts):
            yield from bodies
