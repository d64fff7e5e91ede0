"""Rotations against SciPy's, from tiny angles to half turns."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.geometry import so3

ANGLES = [0.0, 1e-300, 1e-12, 1e-6, 1e-3, 0.5, 2.0, 3.0, 3.0999, 3.1001, np.pi - 1e-6, np.pi - 1e-12]


def vectors_of(angle: float, count: int = 50, seed: int = 0) -> np.ndarray:
    axes = np.random.default_rng(seed).normal(size=(count, 3))
    return angle * axes / np.linalg.norm(axes, axis=1, keepdims=True)


@pytest.mark.parametrize("angle", [*ANGLES, np.pi, 5.0])
def test_exp_is_scipys(angle: float) -> None:
    vectors = vectors_of(angle)
    np.testing.assert_allclose(
        so3.exp(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-15, rtol=0
    )


@pytest.mark.parametrize("angle", ANGLES)
def test_log_undoes_exp(angle: float) -> None:
    vectors = vectors_of(angle)
    found = so3.log(Rotation.from_rotvec(vectors).as_matrix())
    np.testing.assert_allclose(found, vectors, rtol=0, atol=1e-15 + 4e-15 * angle)


def test_log_of_a_half_turn_is_one_of_its_two_axes() -> None:
    vectors = np.concatenate([vectors_of(np.pi), np.pi * np.eye(3)])
    rotations = Rotation.from_rotvec(vectors).as_matrix()
    found = so3.log(rotations)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), np.pi, rtol=1e-15)
    np.testing.assert_allclose(Rotation.from_rotvec(found).as_matrix(), rotations, atol=1e-14)


def test_log_keeps_the_shape_of_a_batch() -> None:
    vectors = vectors_of(1.0, 12).reshape(3, 4, 3)
    np.testing.assert_allclose(so3.log(so3.exp(vectors)), vectors, atol=1e-14)
    np.testing.assert_allclose(so3.log(so3.exp(vectors[0, 0])), vectors[0, 0], atol=1e-14)


def test_the_nearest_rotation_of_a_reflection_is_a_rotation() -> None:
    mirrored = Rotation.random(rng=np.random.default_rng(3)).as_matrix() @ np.diag([1.0, 1.0, -0.2])
    assert np.linalg.det(so3.nearest_rotation(mirrored)) == pytest.approx(1.0)
