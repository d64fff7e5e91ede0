"""Own cameras that do not see everything: steps beyond the edge of a lens, points exactly at it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sfmcpp
from own_cameras import FISHEYE, Array, bal, copied, fisheye, fisheye_scene, own_bal
from sfmcpp import CameraFunction, InvalidArgument, Problem


def test_a_step_to_where_the_camera_sees_nothing_is_refused() -> None:
    """A lens that ends just beyond the points of the start: some candidates have one outside."""
    met = 0

    def angles(points: Array) -> Array:
        return np.asarray(np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2]))

    def narrow(points: Array, intrinsics: Array) -> Array:
        nonlocal met
        pixels = fisheye(points, intrinsics)
        outside = angles(points) > widest
        met += bool(outside.any())
        pixels[outside] = np.nan
        return pixels

    _, problem = fisheye_scene()
    poses = problem.cameras[problem.camera_index]
    points = problem.points[problem.point_index] - poses[:, :, 3]
    widest = np.max(angles(np.einsum("nji,nj->ni", poses[:, :, :3], points))) + 1e-9
    problem = copied(problem, CameraFunction(narrow, FISHEYE, name="narrow"))
    summary = sfmcpp.solve(problem)
    assert met > 0
    assert summary.final_cost < summary.initial_cost
    assert np.isfinite(sfmcpp.residuals(problem)).all()


@pytest.mark.parametrize("loss", ["tukey", "geman-mcclure", "truncated"])
def test_so_it_is_under_a_loss_that_is_constant_far_off(loss: sfmcpp.model.names.Loss) -> None:
    """A point that is not seen has no cost, rather than that of an outlier."""

    def seen(points: Array) -> Array:
        return np.asarray(
            (points[:, 2] > 0) & (np.hypot(points[:, 0], points[:, 1]) <= widest * points[:, 2])
        )

    def narrow(points: Array, intrinsics: Array) -> Array:
        return np.where(seen(points)[:, None], bal(points, intrinsics), np.nan)

    truth = sfmcpp.circle_scene(6, 40, camera_model="bal", seed=1)
    start = sfmcpp.perturb(truth, point_sigma_m=0.5, position_sigma_m=0.5, rotation_sigma_deg=5.0, seed=2)
    poses = start.cameras[start.camera_index]
    points = np.einsum("nji,nj->ni", poses[:, :, :3], start.points[start.point_index] - poses[:, :, 3])
    widest = 1.001 * np.max(np.hypot(points[:, 0], points[:, 1]) / points[:, 2])
    problem = copied(start, replace(own_bal(), project=narrow))
    summary = sfmcpp.solve(problem, loss=loss, loss_scale_px=50.0)
    assert summary.final_cost < summary.initial_cost
    assert np.isfinite(sfmcpp.residuals(problem)).all()


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
