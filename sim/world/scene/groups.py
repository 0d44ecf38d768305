"""Geom groups."""

from enum import IntEnum


class Group(IntEnum):
    """Geom groups, by which a ray or a picture chooses what it meets or shows. MuJoCo has these six and no more."""

    SCENERY = 0
    """Table and structures: what is only shown."""
    TARGET = 1
    ARM = 2
    ARM_COLLISION = 3
    ORGAN = 4
    TUMOUR = 5
