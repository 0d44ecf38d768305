"""The belief about where an organ lies: a Gaussian over a rigid move and a breath, learnt from contacts.

A point q of the organ at rest lies, when the organ has a share s of a full breath in it, at

    p = c + Exp(w) (q - c) + u + s b

with c the organ's middle, w a turn [rad], u a shift [m] and b the way of a full breath [m]. Before any contact, w, u
and b are Gaussian about 0. The probe's tip met the surface where it was measured, at p_i; taken back to rest it lies
on the surface of the plan but for an error, so that with the signed distance d

    0 = d(q_i) + e_i,   q_i = c + Exp(-w) (p_i - u - s_i b - c),

with an error e_i of the scale sigma that has Student's t distribution with 5 degrees of freedom. The mean is the most
likely move, found by Gauss-Newton over all contacts with weights that fall with the error, and the covariance the
inverse of that method's matrix there, in the place of the Hessian of Laplace's approximation. Directions that no
contact tells about, such as along a smooth surface, keep their prior's variance: the belief says so. A contact that is
far off, because the probe slid or met something else, counts for less (Lange, Little and Taylor, Robust statistical
modeling using the t distribution, JASA 84(408), 1989).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
SurfaceQuery = Callable[[Array], tuple[Array, Array]]
"""Signed distance of points to the surface of the organ at rest [m], negative inside, and the unit directions in which
it grows, shapes (N,) and (N, 3), from points of shape (N, 3)."""

_FREEDOM = 5.0
_SIDES = 1.5 * np.vstack([np.eye(3)[:2], -np.eye(3)[:2]])
"""Starts of the search beside the last mean: this many of the prior's deviations along x and y, to either side."""
_MANY = 10
"""These starts are tried for so many contacts, and after them once in so many."""
_MOST_STEPS = 20
_STILL = 1e-5
"""The search for the mean ends where a step is shorter than this [m, or rad times 1 m]."""


@dataclass(frozen=True, kw_only=True)
class RigidPrior:
    """What is expected of the move before any contact; standard deviations along, or about, each axis."""

    shift_m: float = 0.010
    """Of the shift u [m]: registrations of a liver in laparoscopy are 7 to 12 mm off."""
    turn_rad: float = np.deg2rad(5.0)
    """Of the turn w [rad]."""
    breath_m: float = 0.0
    """Of the way of a full breath b [m]; 0 of an organ that does not breathe."""
    surface_m: float = 0.0005
    """Of a contact about the surface of the plan [m]: sigma^2 is the sum of its square and those of the contact."""


@dataclass(frozen=True, eq=False)
class Contact:
    """A meeting of the tip with the organ's surface."""

    position_m: Array
    """Where the tip was measured, world frame [m], shape (3,)."""
    inhaled_share: float = 0.0
    """How much of a full breath was in the organ, s."""
    noise_m: float = 0.0
    """Standard deviation of the measured place along each axis [m]."""
    depth_noise_m: float = 0.0
    """Standard deviation of how deep the tip had pressed, which was taken off [m]."""


@dataclass(frozen=True, eq=False)
class _Contacts:
    """Contacts as arrays."""

    positions_m: Array
    """Shape (N, 3)."""
    shares: Array
    """Shape (N,)."""
    noise_m: Array
    """Shape (N,)."""

    def weight(self, distance_m: Array) -> Array:
        """Precisions [1/m^2], shape (..., N): Student's t as a Gaussian whose precision falls with the error."""
        return (_FREEDOM + 1.0) / (_FREEDOM + (distance_m / self.noise_m) ** 2) / self.noise_m**2


class RigidBelief:
    """A Gaussian over how an organ lies, with nine numbers: turn w, shift u, breath b."""

    def __init__(self, surface: SurfaceQuery, middle_m: Array, prior: RigidPrior | None = None) -> None:
        """Begin from the prior: the organ lies as planned, give or take.

        Args:
            surface: Signed distances to the surface of the organ at rest.
            middle_m: The organ's middle c, rest frame [m], shape (3,).
            prior: What is expected of the move.
        """
        prior = prior or RigidPrior()
        self._surface, self._middle_m, self._surface_m = surface, middle_m, prior.surface_m
        deviations = np.repeat([prior.turn_rad, prior.shift_m, prior.breath_m], 3)
        self._is_free = deviations > 0.0
        self._prior_deviation = deviations
        self.mean: Array = np.zeros(9)
        """The most likely w [rad], u [m] and b [m], shape (9,)."""
        self.covariance: Array = np.diag(deviations**2)
        """Their covariance, shape (9, 9)."""
        self.contacts: list[Contact] = []

    def observe(self, contact: Contact) -> None:
        """Learn from one more contact; the belief is that of all contacts so far."""
        self.relearn([*self.contacts, contact])

    def relearn(self, contacts: Sequence[Contact], *, is_near: bool = False) -> None:
        """Learn from contacts in the place of all so far, beginning where the belief is.

        Args:
            contacts: The contacts.
            is_near: Whether they are the same that were just learnt, told a little better: then it begins nowhere else.
        """
        self.contacts = list(contacts)
        # What fits best from where the belief was, and from either side of it, where it might have got stuck.
        starts = [self.mean]
        if not is_near and (len(self.contacts) <= _MANY or len(self.contacts) % _MANY == 0):
            starts += [*(_SIDES * self._prior_deviation[3:6] @ np.eye(3, 9, 3))]
        self._fit(np.array(starts))

    def _sigma_m(self, contact: Contact) -> float:
        """The standard deviation of a contact's distance from the surface [m]."""
        return float(np.linalg.norm([self._surface_m, contact.noise_m, contact.depth_noise_m]))

    def _fit(self, starts: Array) -> None:
        """Set the mean to the most likely nine numbers next to any of some starts, shape (S, 9)."""
        contacts, means = self._arrays(), starts.copy()
        free = np.flatnonzero(self._is_free)
        prior_precision = np.diag(self._prior_deviation[free] ** -2.0)
        # All starts go on together: the surface is asked once a step, which costs little more for many points.
        moving = np.arange(len(means))
        for _ in range(_MOST_STEPS):
            distance_m, J = self._residuals(means[moving], contacts)
            weight, J = contacts.weight(distance_m)[:, :, None], J[:, :, free]
            precision = prior_precision + J.transpose(0, 2, 1) @ (weight * J)
            slope = (J * weight * distance_m[:, :, None]).sum(axis=1) + means[moving][
                :, free
            ] @ prior_precision
            step = -np.linalg.solve(precision, slope[:, :, None])[:, :, 0]
            means[np.ix_(moving, free)] += step
            moving = moving[np.abs(step).max(axis=1) >= _STILL]
            if not moving.size:
                break
        distance_m, J = self._residuals(means, contacts)
        squares = (distance_m / contacts.noise_m) ** 2
        cost = 0.5 * (_FREEDOM + 1.0) * np.log1p(squares / _FREEDOM).sum(axis=1)
        cost += 0.5 * ((means[:, free] / self._prior_deviation[free]) ** 2).sum(axis=1)
        best = int(cost.argmin())
        weight, J = contacts.weight(distance_m[best]), J[best][:, free]
        self.mean, self.covariance = means[best], np.zeros((9, 9))
        self.covariance[np.ix_(free, free)] = np.linalg.inv(prior_precision + J.T @ (weight[:, None] * J))

    def _arrays(self) -> _Contacts:
        return _Contacts(
            np.array([each.position_m for each in self.contacts]),
            np.array([each.inhaled_share for each in self.contacts]),
            np.array([self._sigma_m(each) for each in self.contacts]),
        )

    def T_world_rest(self, inhaled_share: float = 0.0) -> Array:
        """Where the organ most likely lies, as the map from its rest frame to the world, shape (4, 4).

        Args:
            inhaled_share: How much of a full breath is in it.
        """
        w, u, b = self.mean[:3], self.mean[3:6], self.mean[6:]
        T = np.eye(4)
        T[:3, :3] = Rotation.from_rotvec(w).as_matrix()
        T[:3, 3] = self._middle_m - T[:3, :3] @ self._middle_m + u + inhaled_share * b
        return T

    def tip_corrections_m(self) -> Array:
        """By how much the tip of each contact was most likely measured off, to be added, rest frame [m], shape (N, 3).

        At the mean of the belief a contact lies d off the surface along its normal n. That is the expected sum of the
        errors of tip, surface and depth, of which the tip's is sigma_tip^2 / sigma^2.
        Along the surface nothing is known.
        """
        noise_m = np.array([each.noise_m for each in self.contacts])
        if not noise_m.any():
            return np.zeros((len(noise_m), 3))
        contacts = self._arrays()
        away_m, R = self._away_m(self.mean[None], contacts)
        distance_m, outward = self._surface(away_m[0] @ R[0] + self._middle_m)
        share = (noise_m / contacts.noise_m) ** 2
        return -(share * distance_m)[:, None] * outward

    def place_covariance_m2(self, points_m: Array, inhaled_share: float = 0.0) -> Array:
        """How sure it is where points of the organ lie, covariances [m^2], shape (N, 3, 3).

        Args:
            points_m: Points of the organ, rest frame [m], shape (N, 3).
            inhaled_share: How much of a full breath is in it.
        """
        J = self._place_slopes(points_m, inhaled_share)
        return J @ self.covariance @ J.transpose(0, 2, 1)

    def contact_gains_m2(
        self, positions_m: Array, outward: Array, points_m: Array, *, noise_m: float = 0.0
    ) -> Array:
        """By how much one more contact at exhale lowers how far points are off, a mean square [m^2], shape (K,).

        With the covariance C, the slopes A of where a point lies and h of how far a contact lies off the surface,

            gain = mean |A C h|^2 / (sigma^2 + h^T C h).

        Args:
            positions_m: Where K contacts would be on the surface at rest [m], shape (K, 3).
            outward: Its unit normals there, outward, shape (K, 3).
            points_m: The points whose place matters, rest frame [m], shape (N, 3).
            noise_m: Standard deviation of the tip's measured place along each axis [m].
        """
        R = self.T_world_rest()[:3, :3]
        away_m, normals = (positions_m - self._middle_m) @ R.T, outward @ R.T
        h = np.zeros((len(positions_m), 9))
        h[:, :3] = np.cross(normals, away_m) @ _left_jacobian(self.mean[:3])
        h[:, 3:6] = -normals
        A = self._place_slopes(points_m, 0.0)
        told, noise_m2 = h @ self.covariance, noise_m**2 + self._surface_m**2
        squares = np.einsum("nij,nik->jk", A, A) / max(len(A), 1)
        return np.einsum("kj,jl,kl->k", told, squares, told) / (noise_m2 + np.einsum("kj,kj->k", told, h))

    def _place_slopes(self, points_m: Array, inhaled_share: float) -> Array:
        """How the places of points of the organ change with the nine numbers, shape (N, 3, 9)."""
        turned_m = (points_m - self._middle_m) @ self.T_world_rest()[:3, :3].T
        J = np.zeros((len(points_m), 3, 9))
        J[:, :, :3] = -_cross_matrices(turned_m) @ _left_jacobian(self.mean[:3])
        J[:, :, 3:6], J[:, :, 6:] = np.eye(3), inhaled_share * np.eye(3)
        return J

    def _residuals(self, means: Array, contacts: _Contacts) -> tuple[Array, Array]:
        """Signed distances [m] of N contacts taken back to rest by S moves, and their slopes.

        Args:
            means: The moves, shape (S, 9).
            contacts: The contacts.

        Returns:
            Shapes (S, N) and (S, N, 9).
        """
        away_m, R = self._away_m(means, contacts)
        distance_m, outward = self._surface((away_m @ R + self._middle_m).reshape(-1, 3))
        outward_world = outward.reshape(away_m.shape) @ R.transpose(0, 2, 1)
        J = np.empty((*away_m.shape[:2], 9))
        # Turning the organ by a small dw about its middle takes a point at rest back by dw x away.
        J[:, :, :3] = np.cross(outward_world, away_m) @ np.array([_left_jacobian(w) for w in means[:, :3]])
        J[:, :, 3:6], J[:, :, 6:] = -outward_world, -contacts.shares[:, None] * outward_world
        return distance_m.reshape(away_m.shape[:2]), J

    def _away_m(self, means: Array, contacts: _Contacts) -> tuple[Array, Array]:
        """Contacts from where moves put the organ's middle [m], shape (S, N, 3), and the turns, shape (S, 3, 3)."""
        u, b = means[:, None, 3:6], means[:, None, 6:]
        away_m = contacts.positions_m - u - contacts.shares[:, None] * b - self._middle_m
        return away_m, Rotation.from_rotvec(means[:, :3]).as_matrix()


def _cross_matrices(vectors: Array) -> Array:
    """The matrices of the cross products with vectors, shape (N, 3, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)


def _left_jacobian(w: Array) -> Array:
    """How the turn Exp(w) turns further when w changes, shape (3, 3): Exp(w + dw) = Exp(J dw) Exp(w).

    Sola et al., A micro Lie theory for state estimation in robotics, 2018, equation 145.
    """
    angle = float(np.linalg.norm(w))
    W = _cross_matrices(w[None])[0]
    if angle < 1e-6:
        return np.eye(3) + 0.5 * W
    return np.eye(3) + (1.0 - np.cos(angle)) / angle**2 * W + (angle - np.sin(angle)) / angle**3 * (W @ W)
