"""Own cameras with a point exactly at the edge of what they see: differences of a function end there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import sfmcpp
from own_cameras import FISHEYE, Array, copied, fisheye, fisheye_scene
from sfmcpp import CameraFunction, InvalidArgument, Problem


def cut_at_its_widest_point(is_outside: Any) -> Problem:
    """A fisheye whose lens ends at a point of the start; `is_outside` is given offsets (n, 3) from it."""
    _, problem = fisheye_scene()
    poses = problem.cameras[problem.camera_index]
    points = np.einsum("nji,nj->ni", poses[:, :, :3], problem.points[problem.point_index] - poses[:, :, 3])
    edge = points[np.argmax(np.hypot(points[:, 0], points[:, 1]) / points[:, 2])]

    def cut(points: Array, intrinsics: Array) -> Array:
        offsets = points - edge
        outside = (np.linalg.norm(offsets, axis=1) < 1e-3) & is_outside(offsets)
        return np.where(outside[:, None], np.nan, fisheye(points, intrinsics))

    return copied(problem, CameraFunction(cut, FISHEYE, name="cut"))


def test_a_point_at_the_edge_of_a_lens_has_the_derivatives_beside_it() -> None:
    """An edge along y that curves: both neighbours in y are outside."""
    cut = cut_at_its_widest_point(lambda offsets: offsets[:, 0] + 1e3 * offsets[:, 1] ** 2 > 0)
    whole = cut_at_its_widest_point(lambda offsets: np.zeros(len(offsets), dtype=bool))
    gradient, expected = (sfmcpp.linearize(problem).gradient() for problem in (cut, whole))
    np.testing.assert_allclose(gradient, expected, rtol=1e-4, atol=1e-4 * np.abs(expected).max())
    summary = sfmcpp.solve(cut)
    assert summary.termination == "converged"
    assert summary.final_cost < summary.initial_cost


def test_a_point_that_alone_is_seen_ends_the_solve_and_is_named() -> None:
    problem = cut_at_its_widest_point(lambda offsets: np.abs(offsets).max(axis=1) > 0)
    with pytest.raises(InvalidArgument, match=r"'cut': project has no derivatives at observation \d+"):
        sfmcpp.linearize(problem)
    summary = sfmcpp.solve(problem)
    assert summary.termination == "numerical_failure"
    assert "a derivative of its residual is not a finite number" in summary.warnings[-1]
