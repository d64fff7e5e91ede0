"""Metric frames of projective worlds, against the cameras that were there before."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import rq

from projective_scenes import FOCAL, SIZE, Array, metric_scene
from sfmcpp import InvalidArgument, projection_matrices
from sfmcpp.geometry.autocalibration import metric_frames

TYPICAL = float(sum(SIZE))


def assumed(count: int, focal: float = TYPICAL) -> Array:
    return np.tile([[focal, 0, SIZE[0] / 2], [0, focal, SIZE[1] / 2], [0, 0, 1]], (count, 1, 1))


def distorted(motion: str, seed: int) -> Array:
    """Exact cameras in a world turned by a random homography, each of its own scale and sign."""
    rng = np.random.default_rng([seed, 2])
    matrices = projection_matrices(metric_scene(motion, seed)) @ rng.standard_normal((4, 4))
    return matrices * rng.normal(size=(len(matrices), 1, 1))


def calibrations(matrices: Array) -> Array:
    """K of each camera by decomposition, of positive diagonal and last entry one."""
    found = []
    for matrix in matrices:
        upper = rq(matrix[:, :3])[0]
        upper = upper * np.sign(np.diag(upper))
        found.append(upper / upper[2, 2])
    return np.array(found)


@pytest.mark.parametrize("motion", ["turntable", "fixating", "general"])
@pytest.mark.parametrize("focal", ["shared", "varying"])
def test_exact_cameras_get_back_their_calibration(motion: str, focal: str) -> None:
    for seed in range(3):
        matrices = distorted(motion, seed)
        best = metric_frames(matrices, assumed(len(matrices)), focal=focal)[0]
        np.testing.assert_allclose(best.focals * TYPICAL, FOCAL, rtol=1e-5)
        truth = assumed(len(matrices), FOCAL)
        np.testing.assert_allclose(calibrations(matrices @ best.homography), truth, atol=1e-2)


def test_focal_lengths_may_differ() -> None:
    matrices = distorted("general", 5)
    zoom = np.linspace(0.5, 2.0, len(matrices))
    kernels = assumed(len(matrices), FOCAL)
    zoomed = kernels.copy()
    zoomed[:, 0, 0] *= zoom
    zoomed[:, 1, 1] *= zoom
    matrices = zoomed @ np.linalg.solve(kernels, matrices)
    best = metric_frames(matrices, assumed(len(matrices)), focal="varying")[0]
    np.testing.assert_allclose(best.focals * TYPICAL, FOCAL * zoom, rtol=1e-5)
    shared = metric_frames(matrices, assumed(len(matrices)), focal="shared")
    assert not shared or shared[0].cost > 0.1


@pytest.mark.parametrize("motion", ["turntable", "general", "line", "nadir"])
def test_known_cameras_need_no_particular_motion(motion: str) -> None:
    matrices = distorted(motion, 1)
    best = metric_frames(matrices, assumed(len(matrices), FOCAL), focal="known")[0]
    truth = assumed(len(matrices), FOCAL)
    np.testing.assert_allclose(calibrations(matrices @ best.homography), truth, atol=1e-2)


def test_two_known_cameras_are_enough() -> None:
    matrices = distorted("general", 3)[:2]
    found = metric_frames(matrices, assumed(2, FOCAL), focal="known")
    truth = assumed(2, FOCAL)
    errors = [np.abs(calibrations(matrices @ frame.homography) - truth).max() for frame in found]
    assert min(errors) < 1e-2


@pytest.mark.parametrize("motion", ["line", "nadir"])
def test_a_motion_that_does_not_tell_the_focal_length_leaves_several(motion: str) -> None:
    matrices = distorted(motion, 2)
    found = metric_frames(matrices, assumed(len(matrices)))
    good = [frame.focals[0] for frame in found if frame.cost < 1e-6]
    assert len(good) > 1
    assert max(good) > 1.5 * min(good)


def test_the_frame_of_the_world_does_not_matter() -> None:
    rng = np.random.default_rng(8)
    matrices = distorted("turntable", 4)
    matrices = (
        matrices
        + 1e-3
        * np.linalg.norm(matrices, axis=(1, 2))[:, None, None]
        * rng.normal(size=matrices.shape)
        / np.array([1, 1, 1000])[:, None]
    )
    costs = [
        metric_frames(matrices @ rng.standard_normal((4, 4)), assumed(len(matrices)))[0].cost
        for _ in range(3)
    ]
    assert costs[0] > 1e-6
    np.testing.assert_allclose(costs, costs[0], rtol=1e-4)


def test_what_cannot_be_used_is_refused() -> None:
    matrices = distorted("general", 0)
    with pytest.raises(InvalidArgument, match="at least 3"):
        metric_frames(matrices[:2], assumed(2))
    with pytest.raises(InvalidArgument, match="centre"):
        metric_frames(np.tile(matrices[0], (4, 1, 1)), assumed(4))
    with pytest.raises(InvalidArgument, match="focal"):
        metric_frames(matrices, assumed(len(matrices)), focal="zoom")
    with pytest.raises(InvalidArgument, match="calibrations"):
        metric_frames(matrices, assumed(3))
    with pytest.raises(InvalidArgument, match=r"calibrations\[0\]: must have a rank of three"):
        metric_frames(matrices, 0 * assumed(len(matrices)))
    for spoilt in (np.zeros((3, 4)), matrices[2] * [[1], [1], [0]]):
        broken = matrices.copy()
        broken[2] = spoilt
        with pytest.raises(InvalidArgument, match=r"projections\[2\]: must have a rank of three"):
            metric_frames(broken, assumed(len(broken)))
