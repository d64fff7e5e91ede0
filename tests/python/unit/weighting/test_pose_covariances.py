"""The pose of one camera whose images have covariances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion_helpers import make_drive
from sfmcpp import InvalidArgument
from sfmcpp.weighting import select_weight


@pytest.mark.parametrize("method", ["loo", "loo-approx", "l-curve"])
def test_round_covariances_choose_with_the_bits_of_standard_deviations(method: str) -> None:
    drive = make_drive(3)
    sigma = np.random.default_rng(3).uniform(0.5, 2.0, drive.view.count)
    constraint = drive.odometer(0.05)
    by_sigma = replace(drive.view, sigma_px=sigma)
    by_covariance = replace(drive.view, covariance_px2=sigma[:, None, None] ** 2 * np.eye(2))
    found = [
        select_weight(view, constraint, drive.truth, method=method) for view in (by_sigma, by_covariance)
    ]
    assert found[0].weight.hex() == found[1].weight.hex()
    np.testing.assert_array_equal(found[0].pose, found[1].pose)


def test_images_that_tell_the_truth_along_one_axis_alone_are_heard_there() -> None:
    errors = []
    for seed in range(6):
        drive = make_drive(seed, noise_px=0.0)
        covariance = np.array([[9.0, 8.7], [8.7, 9.0]])
        noise = drive.rng.standard_normal((drive.view.count, 2)) @ np.linalg.cholesky(covariance).T
        seen = replace(drive.view, pixels=drive.view.pixels + noise)
        told = replace(seen, covariance_px2=np.tile(covariance, (drive.view.count, 1, 1)))
        constraint = drive.odometer(0.01)
        poses = [select_weight(view, constraint, drive.truth).pose for view in (told, seen)]
        errors.append([np.linalg.norm(pose[:, 3] - drive.truth[:, 3]) for pose in poses])
    with_covariances, without = np.median(errors, axis=0)
    assert with_covariances < without


def test_covariances_that_are_none_are_refused() -> None:
    drive = make_drive(1)
    with pytest.raises(InvalidArgument, match="covariance_px2: given beside sigma_px"):
        replace(drive.view, sigma_px=np.ones(40), covariance_px2=np.tile(np.eye(2), (40, 1, 1)))
    bad = np.tile(np.eye(2), (40, 1, 1))
    bad[5] = [[1.0, 1.0], [1.0, 1.0]]
    view = replace(drive.view, covariance_px2=bad)
    with pytest.raises(InvalidArgument, match=r"covariance_px2\[5\] = .*: must be positive definite"):
        select_weight(view, drive.odometer(0.1), drive.truth)
