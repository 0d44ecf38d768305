"""Arrays that are shown to code of other people, who must not write into them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """A view of an array that nobody can write to; the array itself stays as it is.

    Whoever writes into what it is shown would change the truth, the organ or the belief of others without a word.

    Args:
        array: The array, of any shape.
    """
    view = np.asarray(array).view()
    view.setflags(write=False)
    return view
