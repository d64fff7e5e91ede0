"""Direction of travel between two images, and what it may be off."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.geometry.direction_of_travel import Travel, refine_travel

ROW = np.array([700.0, 1.0, 600.0, 200.0, 0.0])
CAMERA = np.column_stack([so3.exp(np.array([0.004, -0.01, 0.002])), [0.05, -0.02, 1.0]])
AHEAD = CAMERA[:, 3] / np.linalg.norm(CAMERA[:, 3])
NOISE_PX = 0.3


def images(seed: int, count: int = 150) -> tuple[np.ndarray, np.ndarray]:
    """Pixels of a street ahead in both images; every tenth match is wrong."""
    rng = np.random.default_rng(seed)
    points = rng.uniform([-12, -3, 6], [12, 2, 40], (count, 3))
    pixels = []
    for camera in (np.eye(3, 4), CAMERA):
        x = (points - camera[:, 3]) @ camera[:, :3]
        pixels.append(700.0 * x[:, :2] / x[:, 2:] + [600.0, 200.0] + rng.normal(0, NOISE_PX, (count, 2)))
    pixels[1][::10] += rng.uniform(5, 40, (len(pixels[1][::10]), 2))
    return pixels[0], pixels[1]


def refined(seed: int) -> Travel:
    """From a start that is off by two degrees."""
    rotation = CAMERA[:, :3] @ so3.exp(np.array([0.003, 0.003, 0.0]))
    start = np.column_stack([rotation, AHEAD + np.array([0.03, 0.02, 0.0])])
    found = refine_travel(*images(seed), ROW, start)
    assert found is not None
    return found


def test_directions_are_as_far_off_as_their_covariances_tell() -> None:
    squares = []
    for seed in range(40):
        found = refined(seed)
        error = (found.direction - AHEAD)[:2]
        squares.append(error @ np.linalg.solve(found.covariance[:2, :2], error))
    # The median of a chi-square number of two degrees of freedom is 1.4; a few minima are wrong.
    assert 0.7 < np.median(squares) < 2.8
    assert np.allclose(found.covariance @ found.direction, 0.0, atol=1e-9)


def test_it_is_better_than_its_start() -> None:
    angles = [np.degrees(np.arccos(refined(seed).direction @ AHEAD)) for seed in range(10)]
    assert np.median(angles) < 0.5


def test_few_matches_or_a_camera_that_stands_tell_nothing() -> None:
    first, second = images(0)
    assert refine_travel(first[:14], second[:14], ROW, CAMERA) is None
    assert refine_travel(first, second, ROW, np.eye(3, 4)) is None
    assert refine_travel(first, first, ROW, CAMERA) is None
