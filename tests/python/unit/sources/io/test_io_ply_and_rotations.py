"""PLY as another program would read it; rotations against SciPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from io_helpers import ROTATION_ATOL, random_problem, random_rotations
from sfmcpp import DatasetError
from sfmcpp.geometry.so3 import (
    angle_axis_from_rotation,
    nearest_rotation,
    quaternion_from_rotation,
    rotation_from_angle_axis,
    rotation_from_quaternion,
)
from sfmcpp.sources.io import write


def test_ply_holds_points_then_red_camera_centres(tmp_path: Path) -> None:
    problem = random_problem(5, "bal", {"f": 900}, least=2)
    write(problem, tmp_path / "x.ply")
    header, body = (tmp_path / "x.ply").read_bytes().split(b"end_header\n", 1)
    count = problem.num_points + problem.num_cameras
    lines = header.split(b"\n")
    assert lines[:3] == [b"ply", b"format binary_little_endian 1.0", b"element vertex %d" % count]
    kinds = {b"double": "<f8", b"uchar": "u1"}
    properties = [line.split() for line in lines if line.startswith(b"property")]
    dtype = np.dtype([(name.decode(), kinds[kind]) for _, kind, name in properties])
    vertices = np.frombuffer(body, dtype)
    positions = np.stack([vertices[axis] for axis in "xyz"], axis=1)
    colors = np.stack([vertices[c] for c in ("red", "green", "blue")], axis=1)
    np.testing.assert_array_equal(positions, np.concatenate([problem.points, problem.cameras[:, :, 3]]))
    np.testing.assert_array_equal(colors[: problem.num_points], problem.metadata.point_colors)
    np.testing.assert_array_equal(colors[problem.num_points :], [[255, 0, 0]] * problem.num_cameras)


def test_ply_refuses_colours_of_other_points(tmp_path: Path) -> None:
    problem = random_problem(5, "bal", {"f": 900}, least=2)
    problem.metadata.point_colors = np.zeros((99, 3), np.uint8)
    with pytest.raises(DatasetError, match="point_colors has 99 entries"):
        write(problem, tmp_path / "x.ply")


@pytest.mark.parametrize("angle", [0.0, 5e-324, 1e-200, 1e-9, 1e-4, 1.0, np.pi - 1e-7, np.pi, 5.0, 100.0])
def test_rotations_agree_with_scipy(angle: float) -> None:
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    axes = np.random.default_rng(1).normal(size=(50, 3))
    vectors = angle * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    expected = rotation.from_rotvec(vectors)
    np.testing.assert_allclose(rotation_from_angle_axis(vectors), expected.as_matrix(), atol=ROTATION_ATOL)
    wxyz = quaternion_from_rotation(expected.as_matrix())
    np.testing.assert_allclose(
        np.abs(np.sum(wxyz[:, [1, 2, 3, 0]] * expected.as_quat(), axis=1)), 1, atol=1e-15
    )
    np.testing.assert_allclose(rotation_from_quaternion(1e-7 * wxyz), expected.as_matrix(), atol=1e-15)


def test_angle_axis_and_matrix_are_inverse() -> None:
    rotations = random_rotations(np.random.default_rng(2), 500)
    vectors = angle_axis_from_rotation(rotations)
    assert (np.linalg.norm(vectors, axis=1) <= np.pi * (1 + 1e-15)).all()
    np.testing.assert_allclose(rotation_from_angle_axis(vectors), rotations, atol=1e-15 * 4)


@pytest.mark.parametrize("angle", [1e-300, 1e-12, 1e-5, 1.0, 3.0, np.pi - 1e-8])
def test_angle_axis_vectors_keep_their_digits(angle: float) -> None:
    axes = np.random.default_rng(3).normal(size=(50, 3))
    vectors = angle * axes / np.linalg.norm(axes, axis=1, keepdims=True)
    again = angle_axis_from_rotation(rotation_from_angle_axis(vectors))
    np.testing.assert_allclose(again, vectors, rtol=1e-14, atol=4e-15)


def test_huge_and_tiny_quaternions_lose_nothing() -> None:
    quaternions = np.random.default_rng(4).normal(size=(20, 4))
    expected = rotation_from_quaternion(quaternions)
    for scale in (1e-300, 1e300):
        np.testing.assert_allclose(rotation_from_quaternion(scale * quaternions), expected, atol=1e-15)


def test_the_nearest_rotation_is_nearer_than_its_neighbours() -> None:
    rng = np.random.default_rng(5)
    matrices = random_rotations(rng, 20) + 1e-3 * rng.normal(size=(20, 3, 3))
    nearest = nearest_rotation(matrices)
    distance = np.linalg.norm(matrices - nearest, axis=(1, 2))
    for _ in range(20):
        turned = nearest @ rotation_from_angle_axis(1e-4 * rng.normal(size=(20, 3)))
        assert (np.linalg.norm(matrices - turned, axis=(1, 2)) > distance).all()
