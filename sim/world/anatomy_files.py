"""An anatomy from mesh files: loaded, laid on the table and checked."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from .anatomy import Anatomy, build_anatomy
from .meshes import Unit, load_mesh
from .placement import PlacedOrgan, lay_on_table, put_at_pose


def load_anatomy(
    organ_path: str | Path,
    tumour_paths: Sequence[str | Path] = (),
    *,
    unit: Unit = "mm",
    rng: np.random.Generator,
    T_world_organ: ArrayLike | None = None,
    name: str | None = None,
) -> tuple[Anatomy, PlacedOrgan]:
    """The anatomy held by mesh files, placed in the world.

    Args:
        organ_path: The organ's STL, OBJ or PLY file.
        tumour_paths: One file per tumour, in the organ's frame; none is allowed.
        unit: Unit of all files, "mm" or "m".
        rng: Source of the detection points.
        T_world_organ: Pose of the files' frame in the world; by default LPS axes are laid on the table.
        name: What to call it; the organ file's stem by default.

    Returns:
        The anatomy in the world, and how it was placed.

    Raises:
        WorldError: A file cannot be used, a tumour lies mostly outside the organ, or the pose is not rigid.
    """
    loaded = [load_mesh(organ_path, unit, role="organ")]
    loaded += [load_mesh(path, unit, role="tumour") for path in tumour_paths]
    organ, *tumours = [each.solid for each in loaded]
    if T_world_organ is None:
        placed = lay_on_table(organ, tuple(tumours))
    else:
        placed = put_at_pose(organ, tuple(tumours), T_world_organ=T_world_organ)
    anatomy = build_anatomy(
        placed.organ,
        placed.tumours,
        name=name or Path(organ_path).stem,
        rng=rng,
        notices=tuple(notice for each in loaded for notice in each.notices),
        tumour_names=tuple(str(path) for path in tumour_paths),
    )
    return anatomy, placed
