"""The errors of the world: each names the file or value at fault and the remedy, in a sentence or two.

Where a text speaks of something that a user can set, it has the option's field name in backticks (`organ_label`). The
world knows no flags: a program that has some puts them in the place of these names.
"""


class WorldError(ValueError):
    """Base of every error that the world raises on its inputs."""


class MeshError(WorldError):
    """A mesh that cannot serve as a closed solid: unreadable, empty, open or of the wrong size."""


class AnatomyError(WorldError):
    """Organ and tumours that do not fit together."""


class PlacementError(WorldError):
    """A pose that is not a rigid motion."""


class PlantingError(WorldError):
    """No place was found for a tumour."""


class GeneratorError(WorldError):
    """A liver that the generator could not make."""


class VolumeError(WorldError):
    """A label volume that cannot serve: unreadable, truncated, too large, or without the organ."""


class TissueError(WorldError):
    """Tissue that cannot be pressed: no stiffness, nothing to rest on, or a probe that does not stand on it."""


class MissingPackageError(WorldError):
    """An optional package is needed and not installed."""
