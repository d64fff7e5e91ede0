"""Distortion inside the image is invertible, and what it would fold back from outside is not seen."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfmcpp import InvalidArgument
from sfmcpp.sources.synthetic import circle_scene
from sfmcpp.sources.synthetic.image_geometry import undistorted_radius


@pytest.mark.parametrize("distortion", [(0.0, 0.0), (-0.2, 0.0), (-0.2, 0.02), (0.3, -0.05), (0.5, 2.0)])
def test_the_undistorted_radius_is_the_first_that_gives_the_distorted_one(
    distortion: tuple[float, float],
) -> None:
    k1, k2 = distortion
    radius = undistorted_radius(0.7, distortion)
    candidates = np.linspace(0, radius, 10_001)
    distorted = candidates * (1 + k1 * candidates**2 + k2 * candidates**4)
    assert distorted[-1] == pytest.approx(0.7, rel=1e-14)
    assert (np.diff(distorted) > 0).all()


@pytest.mark.parametrize("distortion", [(-0.5, 0.0), (0.1, -0.5), (-1.0, 0.15)])
def test_a_distortion_that_folds_inside_the_image_is_refused(distortion: tuple[float, float]) -> None:
    # Independent of the closed form: the image radius stops growing before it reaches the corner at 0.8.
    radius = np.linspace(0, 3, 100_001)
    distorted = radius * (1 + distortion[0] * radius**2 + distortion[1] * radius**4)
    first_maximum = distorted[np.argmax(np.diff(distorted) < 0)]
    assert first_maximum < 0.8
    with pytest.raises(InvalidArgument, match=f"folds the image at {first_maximum:.4g} focal lengths"):
        circle_scene(3, 10, camera_model="bal", focal_px=500.0, distortion=distortion)


def test_points_folded_back_into_the_image_are_not_seen() -> None:
    # Cameras amid the points; the image corner is at 0.4, the fold at sqrt(1 / 0.6) = 1.29.
    problem = circle_scene(
        6, 2000, radius_m=2.0, camera_model="bal", distortion=(-0.2, 0.0), pixel_sigma_px=0.0
    )
    observed = np.zeros((problem.num_cameras, problem.num_points), dtype=bool)
    observed[problem.camera_index, problem.point_index] = True
    in_camera = np.einsum("cji,cnj->cni", problem.rotations, problem.points[None] - problem.centres[:, None])
    radius = np.hypot(in_camera[..., 0], in_camera[..., 1]) / in_camera[..., 2]
    in_front = in_camera[..., 2] > 0
    factor = 1 - 0.2 * radius**2
    pixels = 1000 * factor[..., None] * in_camera[..., :2] / in_camera[..., 2:]
    in_image = in_front & (np.abs(pixels) <= [320, 240]).all(-1)
    folded = in_image & (radius > np.sqrt(1 / 0.6))
    assert folded.sum() > 50
    np.testing.assert_array_equal(observed, in_image & ~folded)
    assert np.abs(sfmcpp.residuals(problem)).max() < 1e-9
