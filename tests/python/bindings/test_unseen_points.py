"""Points that an own camera model does not see: steps to where they are unseen are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sfmcpp
from own_cameras import FISHEYE, Array, bal, copied, fisheye, fisheye_scene, own_bal
from sfmcpp import CameraFunction


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
