"""Alignment against known truth, SciPy's rotations, a numerical optimiser, and what is left open."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from mvg_helpers import INTRINSICS, Array, angle_deg, project, random_pair
from sfmcpp import InvalidArgument
from sfmcpp.geometry import align_rigid, align_similarity

SEEDS = st.integers(0, 2**32 - 1)


def random_rotation(rng: np.random.Generator) -> Array:
    return Rotation.from_rotvec(rng.uniform(-1.8, 1.8, 3)).as_matrix()


@settings(max_examples=50, deadline=None)
@given(SEEDS, st.floats(1e-3, 1e3), st.integers(3, 40), st.booleans())
def test_exact_points_give_the_true_similarity(seed: int, scale: float, count: int, flat: bool) -> None:
    rng = np.random.default_rng(seed)
    rotation, translation = random_rotation(rng), rng.normal(0, 5, 3)
    source = rng.standard_normal((count, 3)) * ([1, 1, 0] if flat else [1, 1, 1])
    found = align_similarity(source, scale * source @ rotation.T + translation)
    assert found.undetermined == ""
    assert found.scale == pytest.approx(scale, rel=1e-9)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-7)
    np.testing.assert_allclose(
        found.apply(source), scale * source @ rotation.T + translation, atol=1e-9 * scale + 1e-9
    )


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_the_rotation_is_that_of_scipy_with_weights_and_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source, weights = rng.standard_normal((20, 3)), rng.uniform(0, 2, 20)
    target = source @ random_rotation(rng).T + 0.3 * rng.standard_normal((20, 3)) + [1, 2, 3]
    found = align_rigid(source, target, weights)
    mean_source, mean_target = (np.average(x, axis=0, weights=weights) for x in (source, target))
    expected, rssd = Rotation.align_vectors(target - mean_target, source - mean_source, weights=weights)
    np.testing.assert_allclose(found.rotation, expected.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(found.apply(mean_source), mean_target, atol=1e-12)
    assert found.scale == 1.0
    assert found.rms == pytest.approx(rssd / np.sqrt(weights.sum()), rel=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_no_other_similarity_is_nearer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source, weights = rng.standard_normal((15, 3)), rng.uniform(0.1, 2, 15)
    target = 2.5 * source @ random_rotation(rng).T + 0.5 * rng.standard_normal((15, 3))
    found = align_similarity(source, target, weights)

    def residuals(x: Array) -> Array:
        turned = source @ Rotation.from_rotvec(x[:3]).as_matrix().T
        return (np.sqrt(weights)[:, None] * (np.exp(x[3]) * turned + x[4:] - target)).ravel()

    start = np.r_[Rotation.from_matrix(found.rotation).as_rotvec(), np.log(found.scale), found.translation]
    best = least_squares(residuals, start + 0.1 * rng.standard_normal(7), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert found.rms**2 * weights.sum() <= 2 * best.cost * (1 + 1e-12)
    assert found.rms**2 * weights.sum() == pytest.approx(2 * best.cost, rel=1e-9)


def test_a_weight_of_zero_leaves_a_point_out() -> None:
    rng = np.random.default_rng(6)
    source, target = rng.standard_normal((2, 10, 3))
    some = align_similarity(source[:7], target[:7])
    weighted = align_similarity(source, target, np.arange(10) < 7)
    np.testing.assert_allclose(weighted.rotation, some.rotation, atol=1e-12)
    assert weighted.scale == pytest.approx(some.scale)
    assert weighted.rms == pytest.approx(some.rms)


def test_a_mirrored_target_still_gets_a_rotation() -> None:
    source = np.random.default_rng(7).standard_normal((30, 3))
    found = align_rigid(source, source * [1, 1, -1])
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(found.rotation @ found.rotation.T, np.eye(3), atol=1e-12)
    assert found.rms > 0.1


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.booleans())
def test_points_on_a_line_leave_the_rotation_about_it_open(seed: int, turned_round: bool) -> None:
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal(3)
    direction /= np.linalg.norm(direction)
    rotation = -np.eye(3) if turned_round else random_rotation(rng)
    source = rng.standard_normal(8)[:, None] * direction + rng.normal(0, 1, 3)
    target = 3.0 * source @ rotation.T + [4, 5, 6]
    found = align_similarity(source, target, collinear_ratio=1e-7)
    assert found.undetermined == "rotation about a line"
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(found.apply(source), target, atol=1e-6)
    assert found.scale == pytest.approx(3.0, rel=1e-6)
    # Of all rotations that fit, the smallest turns by the angle between the lines and no more.
    smallest = np.degrees(np.arccos(np.clip(direction @ rotation @ direction, -1, 1)))
    assert angle_deg(np.eye(3), found.rotation) == pytest.approx(smallest, abs=1e-4)


def test_two_points_lie_on_a_line() -> None:
    found = align_similarity([[0, 0, 0], [1, 0, 0]], [[1, 1, 1], [1, 3, 1]])
    assert found.undetermined == "rotation about a line"
    assert found.scale == pytest.approx(2.0)
    np.testing.assert_allclose(found.rotation @ [1, 0, 0], [0, 1, 0], atol=1e-12)


def test_a_nearly_straight_path_is_named_from_the_ratio_asked_for() -> None:
    rng = np.random.default_rng(8)
    path = np.column_stack([np.linspace(0, 100, 50), 0.01 * rng.standard_normal((50, 2))])
    assert align_rigid(path, path).undetermined == ""
    assert align_rigid(path, path, collinear_ratio=1e-2).undetermined == "rotation about a line"


@pytest.mark.parametrize("count", [1, 5])
def test_points_at_one_place_leave_rotation_and_scale_open(count: int) -> None:
    found = align_similarity(np.tile([1.0, 2, 3], (count, 1)), np.tile([5.0, 5, 5], (count, 1)))
    assert found.undetermined == "rotation and scale"
    assert found.scale == 1.0
    np.testing.assert_array_equal(found.rotation, np.eye(3))
    np.testing.assert_allclose(found.apply([1.0, 2, 3]), [5, 5, 5])


def test_cameras_move_with_their_points_and_keep_their_images() -> None:
    rng = np.random.default_rng(9)
    pair = random_pair(9, 30)
    found = align_similarity(pair.points, 2.0 * pair.points @ random_rotation(rng).T + [7, 8, 9])
    moved = found.apply_to_cameras(np.stack([np.eye(3, 4), pair.camera]))
    points = found.apply(pair.points)
    np.testing.assert_allclose(project(moved[0], INTRINSICS, points), pair.pixels_1, atol=1e-8)
    np.testing.assert_allclose(project(moved[1], INTRINSICS, points), pair.pixels_2, atol=1e-8)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[0, 0]], [[0, 0]]), r"source: shape \(1, 2\), must be \(any, 3\)"),
        ((np.zeros((0, 3)), np.zeros((0, 3))), "source: 0 points, must be at least 1"),
        ((np.zeros((4, 3)), np.zeros((3, 3))), r"target: shape \(3, 3\), must be \(4, 3\)"),
        ((np.zeros((1, 3)), [[0, np.nan, 0]]), r"target\[0, 1\] = nan: must be finite"),
        ((np.zeros((2, 3)), np.zeros((2, 3)), [1.0]), r"weights: shape \(1,\), must be \(2\)"),
        ((np.zeros((2, 3)), np.zeros((2, 3)), [1.0, -2.0]), r"weights\[1\] = -2.0: must not be negative"),
        (
            (np.zeros((2, 3)), np.zeros((2, 3)), [0.0, 0.0]),
            "weights: all zero, at least one must be positive",
        ),
    ],
)
def test_a_bad_argument_is_named_with_its_value(arguments: Any, message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        align_similarity(*arguments)
    with pytest.raises(InvalidArgument, match=message):
        align_rigid(*arguments)


def test_a_negative_ratio_is_refused() -> None:
    with pytest.raises(InvalidArgument, match=r"collinear_ratio = -0.1: must be finite and not negative"):
        align_rigid(np.eye(3), np.eye(3), collinear_ratio=-0.1)
