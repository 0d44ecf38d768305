"""Bodies that are pressed."""

import numpy as np
import trimesh

from sim.world.solids.solid import Solid

HALF_WIDTH_M, HALF_HEIGHT_M = 0.06, 0.04


def ball(centre_m, half_axes_m, subdivisions=4):
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=1.0)
    # The facets are blown up until they hold the ball's volume.
    mesh.apply_scale(np.broadcast_to(half_axes_m, 3) * np.cbrt(4 * np.pi / 3 / mesh.volume))
    mesh.apply_translation(centre_m)
    return Solid.from_trimesh(mesh)


def box(extents_m):
    mesh = trimesh.creation.box(extents=extents_m)
    mesh.apply_translation([0.0, 0.0, extents_m[2] / 2])
    return Solid.from_trimesh(mesh)
