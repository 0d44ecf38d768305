"""A reader that errs as published readers of liver ultrasound do, and the figures that it is held to.

Sources: Natali et al. (2024, PMC10929734), intraoperative ultrasound of the liver: Dice 0.84, 8 per cent of the lesions
missed, and the Dice by echogenicity that `echogenicity` tells. How errors depend on a lesion's size and depth, how
smooth a drawn outline is, and how often a reader sees a lesion where there is none was not found as figures; what
stands here for these is assumed, and `docs/readers.md` says so.
"""

from __future__ import annotations

from .reader_errors import ReaderErrors

PUBLISHED_DICE = 0.84
"""Mean Dice of a lesion that was read."""
PUBLISHED_MISSED_SHARE = 0.08
"""Share of the views of lesions in which the lesion is missed."""
PUBLISHED = ReaderErrors(
    missed_share=0.10,
    missed_size_power=0.5,
    missed_per_m=3.0,
    missed_by_echogenicity=True,
    boundary_share=0.12,
    boundary_by_echogenicity=True,
    boundary_length_m=0.010,
    false_blobs=0.02,
    false_blob_radius_m=0.006,
)
"""What the reader `published` gets wrong."""
