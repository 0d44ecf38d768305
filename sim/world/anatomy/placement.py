"""Laying an organ on the table, or putting it at an explicit pose; its tumours move with it.

Patient axes are LPS: +x to the patient's left, +y to the back, +z to the head. On the table the patient's
front is up: world x = left, world y = head, world z = front (-y of LPS).
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from sim.world.errors import PlacementError
from sim.world.solids.solid import Solid

from .structures import Structure

R_WORLD_LPS = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Rotation from patient axes (LPS) to the world: anterior up, left along the arm's view."""

R_WORLD_UPRIGHT = np.eye(3)
"""For organs whose own z axis points up already, like the paper's."""

TABLE_CENTRE_XY_M = (0.5, 0.0)
"""Where the middle of an organ's bounding box lies [m]: 0.5 m before the arm's base."""

ROTATION_TOLERANCE = 1e-6
"""Largest entry of R^T R - I that is taken for rounding."""


@dataclass(frozen=True, eq=False)
class PlacedOrgan:
    """An organ and its tumours in the world.

    Attributes:
        organ: The organ, world coordinates.
        tumours: Its tumours, world coordinates.
        T_world_organ: Maps the organ's own coordinates to the world, shape (4, 4).
        structures: What lies about them, world coordinates.
        tumour_names: What to call each tumour, or nothing.
        targets: The bodies of a second class to be mapped, world coordinates.
        target_names: What to call each of them.
    """

    organ: Solid
    tumours: tuple[Solid, ...]
    T_world_organ: NDArray[np.float64]
    structures: tuple[Structure, ...] = ()
    tumour_names: tuple[str, ...] = ()
    targets: tuple[Solid, ...] = ()
    target_names: tuple[str, ...] = ()

    def with_structures(self, structures: tuple[Structure, ...]) -> Self:
        """The same with structures, given in the organ's own coordinates."""
        return replace(self, structures=tuple(each.transformed(self.T_world_organ) for each in structures))

    def with_tumour_names(self, names: tuple[str, ...]) -> Self:
        """The same with names for its tumours."""
        return replace(self, tumour_names=names)

    def with_targets(self, targets: tuple[Solid, ...], names: tuple[str, ...]) -> Self:
        """The same with a second class of bodies, given in the organ's own coordinates, and their names."""
        in_world = tuple(each.transformed(self.T_world_organ) for each in targets)
        return replace(self, targets=in_world, target_names=names)


def lay_on_table(
    organ: Solid,
    tumours: tuple[Solid, ...] = (),
    *,
    centre_xy_m: ArrayLike = TABLE_CENTRE_XY_M,
    R_world_organ: ArrayLike = R_WORLD_LPS,
) -> PlacedOrgan:
    """The organ on the table: bounding box centred at a point in the plane, lowest point at z = 0.

    Args:
        organ: The organ in its own frame.
        tumours: Tumours in the same frame.
        centre_xy_m: Middle of the placed bounding box in x and y [m].
        R_world_organ: Rotation from the organ's axes to the world's; the default takes them for LPS.

    Returns:
        Organ and tumours in the world, and the motion that brought them there.

    Raises:
        PlacementError: The rotation is none, or the centre is not two finite numbers.
    """
    centre = np.asarray(centre_xy_m, dtype=np.float64)
    if centre.shape != (2,) or not np.isfinite(centre).all():
        raise PlacementError(f"centre_xy_m={centre_xy_m} must be two finite numbers [m]")
    T = np.eye(4)
    T[:3, :3] = np.asarray(R_world_organ, dtype=np.float64)
    check_rigid(T)
    turned = organ.vertices_m @ T[:3, :3].T
    low, high = turned.min(axis=0), turned.max(axis=0)
    T[:2, 3] = centre - 0.5 * (low + high)[:2]
    T[2, 3] = -low[2]
    return put_at_pose(organ, tumours, T_world_organ=T)


def put_at_pose(organ: Solid, tumours: tuple[Solid, ...] = (), *, T_world_organ: ArrayLike) -> PlacedOrgan:
    """The organ and its tumours moved to an explicit pose.

    Args:
        organ: The organ in its own frame.
        tumours: Tumours in the same frame.
        T_world_organ: Maps the organ's own coordinates to the world, shape (4, 4).

    Returns:
        Organ and tumours in the world.

    Raises:
        PlacementError: The matrix is not a rigid motion.
    """
    T = np.array(T_world_organ, dtype=np.float64)
    check_rigid(T)
    T.setflags(write=False)
    return PlacedOrgan(organ.transformed(T), tuple(tumour.transformed(T) for tumour in tumours), T)


def turned(turn_rad: ArrayLike) -> NDArray[np.float64]:
    """Rotation from patient axes (LPS) to the world, 3 x 3: anterior up, then turned about the world's x, y and z.

    Args:
        turn_rad: The three angles [rad], in this order.
    """
    return Rotation.from_euler("xyz", np.asarray(turn_rad, dtype=np.float64)).as_matrix() @ R_WORLD_LPS


def pose_matrix(position_m: ArrayLike, quaternion: ArrayLike) -> NDArray[np.float64]:
    """The rigid motion of a position and an orientation, shape (4, 4).

    Args:
        position_m: Origin of the moved frame [m], shape (3,).
        quaternion: Its orientation, wxyz, of any length but zero, shape (4,).

    Raises:
        PlacementError: Values that are not finite, or a quaternion of length zero.
    """
    position, wxyz = np.asarray(position_m, dtype=np.float64), np.asarray(quaternion, dtype=np.float64)
    if position.shape != (3,) or not np.isfinite(position).all():
        raise PlacementError(f"position {position_m} must be three finite numbers [m]")
    if wxyz.shape != (4,) or not np.isfinite(wxyz).all() or not np.linalg.norm(wxyz) > 0.0:
        raise PlacementError(f"quaternion {quaternion} must be four finite numbers (wxyz), not all zero")
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(wxyz, scalar_first=True).as_matrix()
    T[:3, 3] = position
    return T


def check_rigid(T: NDArray[np.float64]) -> None:
    """Nothing, if the matrix is a rigid motion.

    Raises:
        PlacementError: It is not 4 x 4, not finite, mirrors, scales or shears.
    """
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise PlacementError(f"a pose must be a finite 4 x 4 matrix, not of shape {T.shape}")
    if not np.array_equal(T[3], [0.0, 0.0, 0.0, 1.0]):
        raise PlacementError(f"the last row of a pose must be 0 0 0 1, not {T[3]}")
    R = T[:3, :3]
    error = float(np.abs(R.T @ R - np.eye(3)).max())
    if error > ROTATION_TOLERANCE:
        raise PlacementError(
            f"the pose's rotation scales or shears (R^T R is off by {error:.2g}); orthonormalise it"
        )
    if np.linalg.det(R) < 0.0:
        raise PlacementError(
            "the pose's rotation mirrors (determinant -1); negate one axis to make it right-handed"
        )
