"""Rotation matrices against SciPy's, and frames along directions against what they promise."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.world.frames import frames_along, quaternion_matrix

ROUNDING = 1e-14
"""A matrix is a few products and sums of numbers up to 1, each rounded to 1e-16."""


def unit_vectors(n: int, seed: int, size: int = 3) -> np.ndarray:
    vectors = np.random.default_rng(seed).normal(size=(n, size))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def normals() -> np.ndarray:
    """Directions all over the sphere, along the axes, and close to where the frame changes its side."""
    axes = np.vstack([np.eye(3), -np.eye(3)])
    turn = np.linspace(0.0, 2.0 * np.pi, 50)
    x = np.repeat([0.9 - 1e-9, 0.9 + 1e-9], 25)
    rim = np.column_stack([x, np.sqrt(1.0 - x**2) * np.cos(turn), np.sqrt(1.0 - x**2) * np.sin(turn)])
    return np.vstack([unit_vectors(500, 0), axes, rim, -rim])


def test_quaternions_turn_as_scipy_turns_them() -> None:
    quaternions = unit_vectors(200, 1, size=4)
    expected = Rotation.from_quat(quaternions, scalar_first=True).as_matrix()
    np.testing.assert_allclose(quaternion_matrix(quaternions), expected, atol=ROUNDING)
    shaped = quaternion_matrix(quaternions.reshape(4, 50, 4))
    np.testing.assert_array_equal(shaped.reshape(-1, 3, 3), quaternion_matrix(quaternions))
    np.testing.assert_array_equal(quaternion_matrix([1, 0, 0, 0]), np.eye(3))


def test_matrices_have_the_bits_of_the_states_that_mujoco_computes() -> None:
    quaternions = unit_vectors(20, 2, size=4)
    for quaternion in quaternions:
        text = " ".join(map(repr, quaternion.tolist()))
        model = mujoco.MjModel.from_xml_string(
            f'<mujoco><worldbody><site quat="{text}"/></worldbody></mujoco>'
        )
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        np.testing.assert_array_equal(data.site_xmat[0].reshape(3, 3), quaternion_matrix(model.site_quat[0]))


def test_frames_are_rotations_along_their_normals(normals) -> None:
    frames = frames_along(normals)
    np.testing.assert_array_equal(frames[:, :, 2], normals)
    np.testing.assert_allclose(
        frames.transpose(0, 2, 1) @ frames, np.tile(np.eye(3), (len(normals), 1, 1)), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=1e-14)


def test_frames_lean_towards_x_and_near_to_it_towards_y(normals) -> None:
    """SciPy's best rotation of z to the normal and of x to the leaning, the first weighing infinitely more."""
    frames = frames_along(normals)
    for normal, frame in zip(normals, frames, strict=True):
        leaning = [1.0, 0.0, 0.0] if abs(normal[0]) < 0.9 else [0.0, 1.0, 0.0]
        best, _ = Rotation.align_vectors([normal, leaning], [[0, 0, 1], [1, 0, 0]], weights=[np.inf, 1.0])
        # Near the rim the leaning is 26 degrees off the normal, which doubles rounding.
        np.testing.assert_allclose(frame, best.as_matrix(), atol=1e-13)


def test_frames_lean_towards_what_they_are_given_unless_it_is_the_normal_itself(normals) -> None:
    towards = unit_vectors(len(normals), 3)
    frames = frames_along(normals, towards)
    across = np.vecdot(frames[:, :, 1], towards)
    np.testing.assert_allclose(across, 0.0, atol=1e-13)
    assert (np.vecdot(frames[:, :, 0], towards) > 0.0).all()
    for sign in (1.0, -1.0):
        np.testing.assert_array_equal(frames_along(normals, sign * normals), frames_along(normals))


def test_a_frame_along_one_normal_is_that_of_many(normals) -> None:
    together = frames_along(normals)
    alone = np.concatenate([frames_along(normal[None]) for normal in normals])
    np.testing.assert_array_equal(alone, together)
