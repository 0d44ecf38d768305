"""The one colour code of frames, figures and the page of a run: what stands for what.

The colours are of Okabe and Ito's palette, which people with the common forms of colour blindness can tell apart. The
page keeps its own copy in `sim/report/assets/style.css`, since it also has a dark one.
"""

TRUTH = "#D55E00"
"""True tumours, and what was sensed of them."""
MAP = "#0072B2"
"""The map."""
PROBE = "#009E73"
"""The probe, its cone, and the poses from which it sensed."""
TARGET = "#CC79A7"
"""True bodies of a second class."""
TARGET_MAP = "#E69F00"
"""The map of a second class."""
STRUCTURE = "#66727F"
"""Vessels and the like."""
KEEPOUT = "#F0E442"
"""What must not be pressed."""
ORGAN = "#8D6F68"
"""The organ."""
INK = "#16191D"
"""The way of the tip, and text."""
TRACE_RGB = ((0.27, 0.13, 0.99), (0.0, 0.57, 0.91), (0.33, 0.55, 0.14))
"""The red, the green and the blue of a trace, each at its oldest, in its middle and at its newest: the ends and the
middle of viridis, which brightens all the way."""


def rgba(colour: str, opacity: float = 1.0) -> tuple[float, float, float, float]:
    """A colour such as `#D55E00` as red, green, blue and opacity, each from 0 to 1."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue, opacity


def trace_rgb(share: float) -> tuple[float, float, float]:
    """The colour of a place of a trace, from dark violet where it begins, 0, over green to yellow where it ends, 1."""
    first, t = (0, 2.0 * share) if share < 0.5 else (1, 2.0 * share - 1.0)
    red, green, blue = (each[first] + t * (each[first + 1] - each[first]) for each in TRACE_RGB)
    return red, green, blue
