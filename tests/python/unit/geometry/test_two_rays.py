"""Where two lines come nearest, against dense least squares."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.geometry.epipolar import closest_depths, midpoints


@pytest.mark.parametrize("seed", range(5))
def test_depths_and_midpoints_are_the_least_squares_of_the_distance(seed: int) -> None:
    random = np.random.default_rng(seed)
    rays, centres = random.normal(size=(2, 7, 3)), random.normal(size=(2, 7, 3))
    depth_1, depth_2, factor = closest_depths(rays[0], rays[1], centres[1] - centres[0])
    middle = midpoints(rays[0], centres[0], rays[1], centres[1])
    for k in range(7):
        base = centres[1, k] - centres[0, k]
        expected = np.linalg.lstsq(np.column_stack([rays[0, k], -rays[1, k]]), base, rcond=None)[0]
        assert np.array([depth_1[k], depth_2[k]]) / factor[k] == pytest.approx(expected, rel=1e-9)
        ends = [c + d * r for c, d, r in zip(centres[:, k], expected, rays[:, k], strict=True)]
        assert middle[k] == pytest.approx(np.mean(ends, axis=0), rel=1e-9)


def test_parallel_lines_have_no_middle() -> None:
    ray = np.array([[0.0, 0.0, 1.0]])
    _, _, factor = closest_depths(ray, 2 * ray, np.array([[1.0, 0.0, 0.0]]))
    assert factor == [0.0]
    assert not np.isfinite(midpoints(ray, np.zeros((1, 3)), ray, np.array([[1.0, 0, 0]]))).any()
