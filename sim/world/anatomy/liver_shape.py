"""The shape of a liver as an implicit solid, after the anatomy that gives it its form.

Patient axes (LPS: +x left, +y back, +z head), millimetres about a point inside: the unit in which anatomy is
published and these landmarks were set. The liver fills the vault under the diaphragm, less what presses into
it from below:

1. the vault: right lobe with its downward tip, and the left lobe, under a dome with the heart's impression;
2. the viscera: gut, stomach, right kidney and spine, whose common surface is the liver's hollow visceral face. Where
   it meets the vault at an acute angle, the sharp inferior margin arises;
3. marks on the visceral face: the grooves of the vena cava and of the porta hepatis, the gallbladder's fossa, the
   fissures of the round and the venous ligament, the caudate lobe; on the front the falciform ligament's crease.

Everything is jittered from patient to patient, and space is warped by long waves before any of it is drawn,
so that no outline is an ellipse.
"""

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from .implicit import (
    Coordinates,
    Field,
    capsule,
    ellipsoid,
    half_space,
    plan_distance,
    smooth_cut,
    smooth_intersection,
    smooth_union,
    waves,
)

SPREAD = 1.6
"""Standard deviation of what is drawn, in the deviations' own unit: with it livers differ as much as those of LiTS."""

MOST_DEVIATION = 3.2
"""Deviations are held within this: beyond it parts thin out or leave the body."""

LEAST_WALL_MM = 12.0
"""Tissue left above a fissure behind the front margin [mm], so that none pierces the liver."""


@dataclass(frozen=True, kw_only=True)
class LiverShape:
    """What differs from one liver to the next: its deviations from the template, drawn `SPREAD` wide.

    Zero everywhere is the template itself. `draw` makes a patient.
    """

    right_width: float = 0.0
    """Right lobe, left to right."""
    right_thickness: float = 0.0
    """Right lobe, front to back."""
    dome_height: float = 0.0
    """Height of the right dome."""
    tip_length: float = 0.0
    """How far the right lobe's tip reaches down; a Riedel's lobe at the upper end."""
    tip_forward: float = 0.0
    """How far to the front the tip lies."""
    left_length: float = 0.0
    """How far the left lobe reaches to the left."""
    left_height: float = 0.0
    """Left lobe, head to foot."""
    left_tilt: float = 0.0
    """How steeply the left lobe rises to the left."""
    heart: float = 0.0
    """Depth of the heart's impression."""
    stomach: float = 0.0
    """How far the stomach presses in: it thins the left lobe."""
    gut_height: float = 0.0
    """How far the gut presses up."""
    gut_slope: float = 0.0
    """How steeply the inferior margin rises to the left."""
    hollow: float = 0.0
    """Depth of the visceral face's hollow."""
    kidney: float = 0.0
    """Height of the right kidney's impression."""
    gallbladder: float = 0.0
    """Where along the margin the gallbladder lies."""
    fissure: float = 0.0
    """Where the round ligament's fissure divides the lobes."""
    notch: float = 0.0
    """Depth of that fissure and of the notch it leaves in the margin."""

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Self:
        """A patient's shape: every deviation normal, held within bounds."""
        names = [each.name for each in fields(cls)]
        drawn = np.clip(SPREAD * rng.normal(size=len(names)), -MOST_DEVIATION, MOST_DEVIATION)
        return cls(**dict(zip(names, drawn.tolist(), strict=True)))


def liver_field(shape: LiverShape, at: Coordinates, rng: np.random.Generator) -> Field:
    """The field of a liver, negative inside.

    Args:
        shape: How it deviates from the template.
        at: Lattice axes [mm] in patient axes, of shapes (nx, 1, 1), (1, ny, 1) and (1, 1, nz).
        rng: Source of the warp and of the surface's unevenness.

    Returns:
        About the distance to the surface [mm], in the broadcast shape.
    """
    bend = [6.0 * waves(at, rng, n=6, lengths=(90.0, 220.0)) for _ in range(3)]
    warped = (at[0] + bend[0], at[1] + bend[1], at[2] + bend[2])
    vault = _vault(shape, warped)
    viscera = _viscera(shape, warped)
    liver = smooth_cut(vault, viscera, 4.0)
    liver = smooth_cut(liver, capsule(warped, (0.0, 56.0, -80.0), (-2.0, 50.0, 110.0), (13.0, 13.0)), 7.0)
    liver = smooth_union(liver, ellipsoid(warped, (14.0, 34.0, 10.0), (15.0, 19.0, 30.0)), 8.0)
    liver = _mark_visceral_face(shape, warped, liver, vault, viscera)
    return liver + _falciform_crease(shape, warped) + 0.8 * waves(at, rng, n=16, lengths=(26.0, 75.0))


def _vault(shape: LiverShape, at: Coordinates) -> Field:
    """The space under the diaphragm that the liver takes up."""
    right = ellipsoid(
        at,
        (-36.0, 8.0, 0.0),
        (64.0 + 5.0 * shape.right_width, 88.0 + 9.0 * shape.right_thickness, 84.0 + 7.0 * shape.dome_height),
    )
    tip = ellipsoid(
        at,
        (-56.0, -8.0 - 7.0 * shape.tip_forward, -42.0 - 6.0 * shape.tip_length),
        (40.0 + 3.0 * shape.right_width, 64.0, 64.0 + 6.0 * shape.tip_length),
    )
    tilt = np.deg2rad(12.0 + 6.0 * shape.left_tilt)
    rise = [[np.cos(tilt), 0.0, -np.sin(tilt)], [0.0, 1.0, 0.0], [np.sin(tilt), 0.0, np.cos(tilt)]]
    left = ellipsoid(
        at,
        (24.0 + 3.0 * shape.left_length, -25.0, -8.0),
        (100.0 + 11.0 * shape.left_length, 62.0, 64.0 + 5.0 * shape.left_height),
        rise,
    )
    heart = ellipsoid(at, (42.0, -2.0, 94.0 - 4.0 * shape.heart), (62.0, 58.0, 44.0))
    return smooth_cut(smooth_union(smooth_union(right, tip, 30.0), left, 24.0), heart, 24.0)


def _viscera(shape: LiverShape, at: Coordinates) -> Field:
    """What presses into the liver from below and behind."""
    gut = half_space(at, (0.54 + 0.06 * shape.gut_slope, 0.20, -0.82), 44.0 - 5.0 * shape.gut_height)
    across = ((at[0] + 20.0) / 36.0) ** 2 + (at[1] / 60.0) ** 2
    gut = gut - (30.0 + 5.0 * shape.hollow) * np.exp(-0.5 * across)
    stomach = ellipsoid(
        at, (98.0 - 5.0 * shape.stomach, 56.0, -30.0 + 3.0 * shape.stomach), (100.0, 104.0, 78.0)
    )
    kidney = ellipsoid(at, (-46.0, 90.0, -70.0 + 8.0 * shape.kidney), (40.0, 46.0, 62.0))
    spine = capsule(at, (32.0, 88.0, -90.0), (28.0, 82.0, 110.0), (44.0, 44.0))
    viscera = smooth_union(stomach, np.asarray(gut, dtype=np.float32), 16.0)
    return smooth_union(smooth_union(viscera, kidney, 14.0), spine, 14.0)


def _mark_visceral_face(
    shape: LiverShape, at: Coordinates, liver: Field, vault: Field, viscera: Field
) -> Field:
    """The liver with the gallbladder's fossa, the porta hepatis and the fissures cut into its visceral face.

    A mark follows a line seen along z; how deep a point lies above the face is the viscera's own field there.
    """
    wall = vault + LEAST_WALL_MM
    along, aside = plan_distance(at, (-26.0 + 5.0 * shape.gallbladder, -92.0), (-4.0, -8.0))
    liver = smooth_cut(liver, np.hypot(aside, viscera + 2.0) - (15.0 - 6.0 * along), 9.0)
    _, aside = plan_distance(at, (-6.0, 4.0), (30.0, 0.0))
    porta = smooth_intersection(np.hypot(aside, viscera - 2.0) - 8.0, wall, 3.0)
    liver = smooth_cut(liver, porta, 9.0)
    _, aside = plan_distance(at, (32.0, 2.0), (20.0, 60.0))
    venous = smooth_intersection(aside - 2.5, viscera - 14.0, 3.0)
    liver = smooth_cut(liver, smooth_intersection(venous, wall, 3.0), 5.0)
    return smooth_cut(liver, _round_ligament_fissure(shape, at, wall, viscera), 7.0)


def _round_ligament_fissure(shape: LiverShape, at: Coordinates, wall: Field, viscera: Field) -> Field:
    """A cleft from the front margin, where it leaves a notch, back to the porta hepatis."""
    depth = 19.0 + 2.5 * shape.notch
    aside = np.abs(at[0] - _fissure_x(shape) - 0.06 * (at[1] + 40.0))
    width = 4.0 * np.clip(1.0 - viscera / depth, 0.0, 1.6)
    cleft = smooth_intersection(aside - width, viscera - depth, 3.0)
    behind_margin = np.clip((at[1] + 74.0) / 16.0, 0.0, 1.0)
    cleft = smooth_intersection(cleft, wall - (1.0 - behind_margin) * (LEAST_WALL_MM + 20.0), 3.0)
    return smooth_intersection(cleft, at[1] - 2.0, 4.0)


def _falciform_crease(shape: LiverShape, at: Coordinates) -> Field:
    """How far the falciform ligament draws the front surface in [mm]."""
    aside = at[0] - _fissure_x(shape) - 0.05 * at[2]
    fading = np.clip((20.0 - at[1]) / 30.0, 0.0, 1.0)
    return np.asarray(2.0 * np.exp(-0.5 * (aside / 5.0) ** 2) * fading, dtype=np.float32)


def _fissure_x(shape: LiverShape) -> float:
    return 28.0 + 5.0 * shape.fissure
