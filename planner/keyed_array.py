"""An array as a key of what is kept: two keys are equal when they hold the very same array."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class KeyedArray:
    """An array that is kept alive and compared by identity, so that what was made from it can be kept."""

    array: NDArray[np.float64]

    def __hash__(self) -> int:
        """The hash of the array's identity."""
        return id(self.array)

    def __eq__(self, other: object) -> bool:
        """Whether both hold the same array, not merely equal ones."""
        return isinstance(other, KeyedArray) and other.array is self.array
