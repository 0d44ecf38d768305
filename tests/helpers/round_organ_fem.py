"""A full finite element solution of a pressed spheroid: axisymmetric, quadratic, fine beneath the face; an oracle.

The body is an ellipsoid of revolution about z that stands on its lowest fifth and is pressed from above, so that two
dimensions hold the whole solution. It shares nothing with the model under test: scikit-fem's quadratic triangles fitted
to the surface, a displacement forced on the face, no closed form of any kind.
"""

import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementTriP2, ElementVector, FacetBasis, LinearForm, MeshTri


def spheroid_mesh(half_width_m, half_height_m, sizes):
    """Triangles of the half section in (r, z), its lowest point at z = 0.

    `sizes` is a list of (centre, size there, growth per metre of distance, radius about the centre that is all fine).
    """
    mesh = MeshTri.init_tensor(np.linspace(0.0, 1.0, 13), np.linspace(-1.0, 1.0, 25))
    u, v = mesh.p
    places = np.stack([u * np.sqrt(1 - 0.5 * v**2), v * np.sqrt(1 - 0.5 * u**2)])
    mesh = MeshTri(places, mesh.t)
    scale = np.array([half_width_m, half_height_m])[:, None]
    for _ in range(40):
        corners = (mesh.p * scale)[:, mesh.t] + np.array([0.0, half_height_m])[:, None, None]
        edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=0).max(axis=0)
        middle = corners.mean(axis=1)
        target = np.full(len(edge), np.inf)
        for centre, size, growth, inner in sizes:
            away = np.linalg.norm(middle - np.array(centre)[:, None], axis=0)
            target = np.minimum(target, size + growth * np.maximum(away - inner, 0.0))
        if not (edge > target).any():
            break
        mesh = mesh.refined(np.flatnonzero(edge > target))
        # New corners of the outline are put on the circle.
        outline = np.unique(mesh.facets[:, mesh.boundary_facets()])
        outline = outline[mesh.p[0, outline] > 1e-9]
        points = mesh.p.copy()
        points[:, outline] /= np.linalg.norm(points[:, outline], axis=0)
        mesh = MeshTri(points, mesh.t)
    return MeshTri(mesh.p * scale + np.array([[0.0], [half_height_m]]), mesh.t)


def press_spheroid(mesh, *, face_radius_m, depth_m, modulus_pa, poissons_ratio, bed_height_m):
    """Force [N] of a frictionless flat face pressed in from above, and the displacement (r, z) [m] at section points.

    `modulus_pa` is a function of the triangles' middles, shape (2, T).
    """
    basis = Basis(mesh, ElementVector(ElementTriP2()), intorder=4)
    moduli = modulus_pa(mesh.p[:, mesh.t].mean(axis=1))[:, None] * np.ones(basis.dx.shape)
    lame = moduli * poissons_ratio / ((1 + poissons_ratio) * (1 - 2 * poissons_ratio))
    shear = moduli / (2 * (1 + poissons_ratio))

    def strains(u, w):
        return u.grad[0, 0], u[0] / w.x[0], u.grad[1, 1], u.grad[0, 1] + u.grad[1, 0]

    @BilinearForm
    def stiffness(u, v, w):
        e, f = strains(u, w), strains(v, w)
        volume = sum(e[:3]) * sum(f[:3])
        shape = 2 * sum(a * b for a, b in zip(e[:3], f[:3], strict=True)) + e[3] * f[3]
        return 2 * np.pi * w.x[0] * (w.lame * volume + w.shear * shape)

    top = mesh.p[1].max()
    face = _outline(mesh, basis, lambda x: (x[0] < 4 * face_radius_m) & (x[1] > 0.6 * top))
    bed = _outline(mesh, basis, lambda x: x[1] < bed_height_m + 0.01)

    @BilinearForm
    def pressed(u, v, w):
        return 2 * np.pi * w.x[0] * (w.x[0] < face_radius_m) * u[1] * v[1]

    @LinearForm
    def forced(v, w):
        return -2 * np.pi * w.x[0] * (w.x[0] < face_radius_m) * v[1]

    @BilinearForm
    def held(u, v, w):
        return 2 * np.pi * w.x[0] * ((w.x[1] < bed_height_m) & (w.n[1] < -0.2)) * (u[0] * v[0] + u[1] * v[1])

    penalty = 1e4 * modulus_pa(np.array([[0.0], [top]]))[0] / face_radius_m
    matrix = stiffness.assemble(basis, lame=lame, shear=shear) + penalty * pressed.assemble(face)
    matrix = (matrix + penalty * held.assemble(bed)).tocsc()
    load = penalty * depth_m * forced.assemble(face)
    on_axis = basis.nodal_dofs[0][mesh.p[0] < 1e-12]
    middles = mesh.p[:, mesh.facets].mean(axis=1)
    on_axis = np.concatenate([on_axis, basis.facet_dofs[0][middles[0] < 1e-12]])
    free = np.setdiff1d(np.arange(basis.N), on_axis)
    moved = np.zeros(basis.N)
    moved[free] = splu(matrix[free][:, free]).solve(load[free])
    # The spring's force: what it was to be pressed less what it was.
    radial = np.asarray(face.global_coordinates())[0]
    area_m2 = np.sum(2 * np.pi * radial * (radial < face_radius_m) * face.dx)
    force_n = penalty * (depth_m * area_m2 - forced.assemble(face) @ moved)
    return float(force_n), lambda points: _at(basis, moved, points)


def _outline(mesh, basis, is_wanted):
    facets = mesh.boundary_facets()
    middles = mesh.p[:, mesh.facets[:, facets]].mean(axis=1)
    wanted = facets[is_wanted(middles) & (middles[0] > 1e-12)]
    return FacetBasis(mesh, basis.elem, facets=wanted, intorder=6)


def _at(basis, moved, points):
    """Displacement (r, z) at points (N, 2) of the section, shape (N, 2)."""
    return np.asarray(basis.probes(points.T) @ moved).reshape(2, -1).T
