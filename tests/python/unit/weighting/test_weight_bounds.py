"""Bounds of weights: from above what a sensor declares, from below what a conflict leaves of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from fusion_helpers import Array, Drive, make_drive, moved, project
from sfmcpp import InvalidArgument
from sfmcpp.weighting import (
    WEIGHT_BOUNDS,
    PoseConstraint,
    declared_bounds,
    declared_weight,
    equivalent_sigma,
    refine_pose,
    select_weight,
    select_weights,
)

CHOOSING = ("loo", "loo-approx", "l-curve", "l-curve-scaled", "ltn")
SIGMA_M, SIGMA_RAD = 0.02, 0.002


def odometer(drive: Drive, off_m: float = 0.0) -> PoseConstraint:
    correct = drive.odometer(0.0, declared=SIGMA_M)
    return replace(correct, distance=correct.distance + off_m)


@pytest.mark.parametrize("kind", ["odometer", "gyro", "gps"])
def test_the_declared_weight_amounts_to_the_declared_sigma(kind: str) -> None:
    constraint = getattr(make_drive(1), kind)(0.01, declared=0.03)
    assert equivalent_sigma(constraint, declared_weight(constraint, 40, 0.7), 40, 0.7) == pytest.approx(0.03)


@pytest.mark.parametrize(
    ("weight", "count", "pixel_sigma", "told"),
    [
        (np.nan, 40, 1.0, "weight"),
        (-1.0, 40, 1.0, "weight"),
        (1.0, 0, 1.0, "count"),
        (1.0, 40, np.nan, "pixel"),
    ],
)
def test_what_is_no_weight_or_sigma_is_refused(
    weight: float, count: int, pixel_sigma: float, told: str
) -> None:
    constraint = make_drive(1).odometer(0.01, declared=0.03)
    with pytest.raises(InvalidArgument, match=told):
        equivalent_sigma(constraint, weight, count, pixel_sigma)
    if told != "weight":
        with pytest.raises(InvalidArgument, match=told):
            declared_weight(constraint, count, pixel_sigma)
    with pytest.raises(InvalidArgument, match="distance = 'far'"):
        replace(constraint, distance="far")
    with pytest.raises(InvalidArgument, match="yields = 'no'"):
        replace(constraint, yields="no")


def test_at_the_declared_weight_the_pose_is_the_most_likely_one() -> None:
    """Against residuals over their standard deviations, minimised by SciPy."""
    drive = make_drive(5)
    gyro = drive.gyro(SIGMA_RAD, declared=SIGMA_RAD, log=True)
    distance = drive.odometer(SIGMA_M, declared=SIGMA_M)
    pixel_sigma, count = 1.3, drive.view.count
    weighted = [(c, declared_weight(c, count, pixel_sigma)) for c in (distance, gyro)]

    def residuals(delta: Array) -> Array:
        pose = moved(drive.truth, delta)
        pixels = (project(pose, drive.view.points) - drive.view.pixels).ravel() / pixel_sigma
        turn = gyro.rotation.T @ pose[:, :3]
        axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        angle = np.arctan2(np.linalg.norm(axis), np.trace(turn) - 1)
        along = axis * (angle / np.linalg.norm(axis))
        off = np.linalg.norm(pose[:, 3]) - distance.distance
        return np.concatenate([pixels, along / SIGMA_RAD, [off / SIGMA_M]])

    likeliest = moved(drive.truth, least_squares(residuals, np.full(6, 1e-6), xtol=1e-14, ftol=1e-14).x)
    found = refine_pose(drive.view, weighted, drive.truth).pose
    np.testing.assert_allclose(found, likeliest, atol=2e-6)
    assert np.abs(found - refine_pose(drive.view, [], drive.truth).pose).max() > 5e-4


@pytest.mark.parametrize("method", CHOOSING)
@pytest.mark.parametrize("off_m", [0.0, 0.05, -0.3])
def test_every_method_chooses_within_the_bounds(method: str, off_m: float) -> None:
    for seed in range(4):
        drive = make_drive(seed)
        constraint = odometer(drive, off_m)
        found = select_weight(drive.view, constraint, drive.truth, method, bounds="declared")
        alone = refine_pose(drive.view, [], drive.truth)
        bounds = declared_bounds(
            constraint, drive.view.count, drive.view.pixel_sigma(alone.vision), found.conflict
        )
        assert bounds.smallest * (1 - 1e-9) <= found.weight <= bounds.largest * (1 + 1e-9)
        assert found.sensor_sigma >= SIGMA_M * (1 - 1e-9)
        assert found.weights[found.admissible].size >= 1


def test_a_sensor_that_agrees_has_nearly_its_declared_weight() -> None:
    drive = make_drive(2, noise_px=0.3)
    found = select_weight(drive.view, odometer(drive), drive.truth, bounds="declared")
    assert SIGMA_M <= found.sensor_sigma * (1 + 1e-9) < 1.2 * SIGMA_M


def test_a_conflict_takes_weight_away_smoothly_and_never_all() -> None:
    drive = make_drive(2, noise_px=0.3)
    weights = []
    for off_m in np.linspace(0.0, 0.4, 21):
        found = select_weight(drive.view, odometer(drive, off_m), drive.truth, bounds="declared")
        smallest = found.weights[found.admissible].min()
        weights.append(smallest)
        assert found.weight > 0
    assert (np.diff(weights[1:]) < 0).all()
    assert (np.array(weights[1:]) > 0.5 * np.array(weights[:-1])).all()
    assert weights[-1] < 0.1 * weights[0]


def test_a_sensor_that_does_not_yield_keeps_its_declared_weight_in_conflict() -> None:
    drive = make_drive(2, noise_px=0.3)
    for off_m in (0.0, 0.3):
        firm = replace(odometer(drive, off_m), yields=False)
        found = select_weight(drive.view, firm, drive.truth, bounds="declared")
        assert found.sensor_sigma == pytest.approx(SIGMA_M)
    assert found.conflict.conflicting


def test_without_bounds_the_choice_is_that_of_the_thesis() -> None:
    drive = make_drive(3)
    constraint = odometer(drive)
    free = select_weight(drive.view, constraint, drive.truth)
    assert free.weight == select_weight(drive.view, constraint, drive.truth, bounds="none").weight
    assert free.weights.size == 100


@pytest.mark.parametrize("method", ["fixed:7", "none"])
def test_a_prescribed_weight_has_no_bounds(method: str) -> None:
    drive = make_drive(3)
    found = select_weight(drive.view, odometer(drive, 0.3), drive.truth, method, bounds="declared")
    assert found.weight == (7.0 if method == "fixed:7" else 0.0)


def test_several_sensors_are_bounded_each_by_its_own() -> None:
    drive = make_drive(4)
    sensors = [odometer(drive), drive.gyro(SIGMA_RAD, declared=SIGMA_RAD)]
    found = select_weights(drive.view, sensors, drive.truth, bounds="declared")
    assert found[0].sensor_sigma >= SIGMA_M * (1 - 1e-9)
    assert found[1].sensor_sigma >= SIGMA_RAD * (1 - 1e-9)


def test_bounds_need_a_declared_sigma_and_a_name_that_exists() -> None:
    drive = make_drive(4)
    with pytest.raises(InvalidArgument, match="sensor_sigma = None: bounds = 'declared' needs"):
        select_weight(drive.view, drive.odometer(SIGMA_M), drive.truth, bounds="declared")
    with pytest.raises(InvalidArgument, match=f"bounds = 'both': must be one of {', '.join(WEIGHT_BOUNDS)}"):
        select_weight(drive.view, odometer(drive), drive.truth, bounds="both")
