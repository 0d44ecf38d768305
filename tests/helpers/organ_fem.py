"""A full finite element solution of any pressed organ with scikit-fem: an oracle.

Quadratic tetrahedra, down to about a millimetre at the rim of the face, cut at the organ's surface. It shares nothing
with the model under test but the distance to the surface: no closed form, and a displacement forced on the face.
"""

import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementTetP2, ElementVector, FacetBasis, LinearForm, MeshTet
from skfem.helpers import ddot, sym_grad, trace

from sim.world.solids.surface_distance import surface_distance_of

BED_PER_M = 1e4


def organ_mesh(organ, origin_m, R_world, *, coarse_m, rim_m, growth, face_radius_m, bed_height_m):
    """Tetrahedra of an organ; `R_world` has the axes of the lattice that they start from, the last one the probe's."""
    local = (organ.vertices_m - origin_m) @ R_world
    first, last = np.floor(local.min(axis=0) / coarse_m) - 1, np.ceil(local.max(axis=0) / coarse_m) + 1
    axes = [coarse_m * np.arange(first[i], last[i] + 1) for i in range(3)]
    axes[2] = axes[2] + 0.37 * coarse_m  # the surface at the face is not to lie in a plane of the lattice
    distance = surface_distance_of(organ)

    def distance_m(points):
        return distance.signed_distance_m(origin_m + points @ R_world.T)

    mesh = MeshTet.init_tensor(*axes)
    mesh = mesh.restrict(np.flatnonzero(distance_m(_middles(mesh)) < 1.2 * coarse_m))
    for _ in range(40):
        middles = _middles(mesh)
        rim = np.hypot(np.hypot(middles[:, 0], middles[:, 1]) - face_radius_m, middles[:, 2])
        target = np.minimum(np.maximum(rim_m, growth * rim), 1.75 * coarse_m)
        too_long = np.flatnonzero(_edges_m(mesh).max(axis=0) > target)
        if not len(too_long):
            break
        mesh = mesh.refined(too_long)
    middles = _middles(mesh)
    low = (origin_m + middles @ R_world.T)[:, 2] < bed_height_m + 0.005
    mesh = mesh.refined(np.flatnonzero(low & (np.abs(distance_m(middles)) < 0.012)))

    points, cells = mesh.p.T.copy(), mesh.t.T
    away = distance_m(points)
    shortest = np.full(len(points), np.inf)
    for pair, length in zip(((i, j) for i in range(4) for j in range(i)), _edges_m(mesh), strict=True):
        for corner in pair:
            np.minimum.at(shortest, cells[:, corner], length)
    near = np.abs(away) < 0.2 * shortest
    step = 1e-5 * np.eye(3)
    slope = (
        np.stack([distance_m(points[near] + s) - distance_m(points[near] - s) for s in step], axis=1) / 2e-5
    )
    points[near] -= away[near, None] * slope
    away[near] = 0.0
    points, cells = _cut(points, cells, away)
    world = origin_m + points @ R_world.T
    return MeshTet(np.ascontiguousarray(world.T), np.ascontiguousarray(cells.T))


def press_organ(
    mesh, position_m, direction, *, face_radius_m, depth_m, modulus_pa, poissons_ratio, bed_height_m
):
    """Force [N] of a frictionless flat face, and a function from points (N, 3) to their displacement [m]."""
    basis = Basis(mesh, ElementVector(ElementTetP2()), intorder=3)
    lame = modulus_pa * poissons_ratio / ((1 + poissons_ratio) * (1 - 2 * poissons_ratio))
    shear = modulus_pa / (2 * (1 + poissons_ratio))

    @BilinearForm
    def stiffness(u, v, w):
        e, f = sym_grad(u), sym_grad(v)
        return lame * trace(e) * trace(f) + 2 * shear * ddot(e, f)

    def along(u):
        return sum(u[i] * direction[i] for i in range(3))

    def on_face(w):
        offset = w.x - position_m[:, None, None]
        height = along(offset)
        facing = -along(w.n)
        return (np.sqrt(np.maximum((offset**2).sum(axis=0) - height**2, 0)) < face_radius_m) * np.maximum(
            facing, 0
        )

    @BilinearForm
    def pressed(u, v, w):
        return on_face(w) * along(u) * along(v)

    @LinearForm
    def forced(v, w):
        return on_face(w) * along(v)

    @LinearForm
    def face_area(v, w):
        return on_face(w) * v

    @BilinearForm
    def held(u, v, w):
        return ((w.n[2] < -0.2) & (w.x[2] < bed_height_m)) * sum(u[i] * v[i] for i in range(3))

    facets = mesh.boundary_facets()
    middles = mesh.p[:, mesh.facets[:, facets]].mean(axis=1).T
    near = facets[np.linalg.norm(middles - position_m, axis=1) < 2.5 * face_radius_m]
    face = FacetBasis(mesh, basis.elem, facets=near, intorder=6)
    bed = FacetBasis(mesh, basis.elem, facets=facets[middles[:, 2] < bed_height_m + 0.02], intorder=6)
    penalty = 1e3 * modulus_pa / face_radius_m
    matrix = stiffness.assemble(basis) + penalty * pressed.assemble(face)
    matrix = (matrix + BED_PER_M * modulus_pa * held.assemble(bed)).tocsc()
    push = forced.assemble(face)
    factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    moved = factors.solve(penalty * depth_m * push)
    area_m2 = face_area.assemble(FacetBasis(mesh, ElementTetP2(), facets=near, intorder=6)).sum()
    return float(penalty * (depth_m * area_m2 - push @ moved)), lambda points: _at(basis, moved, points)


def is_in_mesh(mesh, points):
    """Which points lie in a tetrahedron of the mesh, shape (N,); the cut surface leaves out a few beside it."""
    find, is_in = mesh.element_finder(), np.zeros(len(points), dtype=bool)

    def look(rows):
        try:
            find(*points[rows].T)
            is_in[rows] = True
        except ValueError:
            if len(rows) > 1:
                for half in np.array_split(rows, 2):
                    look(half)

    for rows in np.array_split(np.arange(len(points)), max(len(points) // 50, 1)):
        look(rows)
    return is_in


def _at(basis, moved, points):
    scalar = Basis(basis.mesh, ElementTetP2(), intorder=1)
    at_points, result = scalar.probes(points.T), np.empty((len(points), 3))
    for axis in range(3):
        values = np.zeros(scalar.N)
        values[scalar.nodal_dofs[0]] = moved[basis.nodal_dofs[axis]]
        values[scalar.edge_dofs[0]] = moved[basis.edge_dofs[axis]]
        result[:, axis] = at_points @ values
    return result


def _middles(mesh):
    return mesh.p[:, mesh.t].mean(axis=1).T


def _edges_m(mesh):
    corners = mesh.p[:, mesh.t]
    return np.array(
        [np.linalg.norm(corners[:, i] - corners[:, j], axis=0) for i in range(4) for j in range(i)]
    )


def _cut(points, cells, away):
    """The part of the tetrahedra where the distance, linear in each, is negative."""
    points, edges, parts = list(points), {}, []

    def crossing(a, b):
        key = (min(a, b), max(a, b))
        if key not in edges:
            edges[key] = len(points)
            points.append(points[a] + away[a] / (away[a] - away[b]) * (points[b] - points[a]))
        return edges[key]

    sides = np.sign(away)[cells]
    whole = cells[(sides <= 0).all(axis=1) & (sides < 0).any(axis=1)]
    # Diagonals start at the lowest corner inside, so that neighbours part their common face alike.
    for cell in cells[(sides < 0).any(axis=1) & (sides > 0).any(axis=1)]:
        inside, on, out = (sorted(c for c in cell if np.sign(away[c]) == side) for side in (-1, 0, 1))
        if len(inside) == 1:
            parts.append([*inside, *on, *(crossing(inside[0], c) for c in out)])
            continue
        a, b = inside[:2]
        if len(inside) == 2 and len(out) == 2:
            a0, a1, b0, b1 = (crossing(i, j) for i in (a, b) for j in out)
            parts += [[a, a0, a1, b1], [a, a0, b0, b1], [a, b, b0, b1]]
        elif len(inside) == 2:
            a0, b0 = crossing(a, out[0]), crossing(b, out[0])
            parts += [[a, b, b0, on[0]], [a, b0, a0, on[0]]]
        else:
            c = inside[2]
            a0, b0, c0 = (crossing(i, out[0]) for i in inside)
            parts += [[a, b, c, c0], [a, b, b0, c0], [a, a0, b0, c0]]
    points, cells = np.array(points), np.concatenate([whole, np.array(parts)])
    corners = points[cells]
    volume = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    used, numbers = np.unique(cells[volume > 1e-15], return_inverse=True)
    return points[used], numbers.reshape(-1, 4)
