"""The conflict report against plain NumPy, and against the chances it states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm

from fusion_helpers import Array, Drive, error_vector, make_drive, moved, project
from sfmcpp.weighting import PoseConstraint, conflict, declared_weight, refine_pose
from sfmcpp.weighting.conflict import CONFLICT_SIGMAS, _sigma_limit, equivalent_sigmas


def numeric_jacobian(f, size: int = 6, step: float = 1e-6) -> Array:  # type: ignore[no-untyped-def]
    return np.column_stack([(f(step * e) - f(-step * e)) / (2 * step) for e in np.eye(size)])


def minimal_error(constraint: PoseConstraint, pose: Array) -> Array:
    """The error in the sensor's unit and in as many numbers as it has freedoms."""
    if constraint.kind == "displacement-rotation":
        return np.sqrt(3) * error_vector(
            PoseConstraint("displacement-rotation-log", rotation=constraint.rotation, previous=np.eye(3, 4)),
            pose,
        )
    return np.sqrt(constraint.unit.spread) * error_vector(constraint, pose)


def reference(drive: Drive, constraint: PoseConstraint, pose: Array) -> tuple[float, int]:
    view = drive.view
    images = numeric_jacobian(lambda d: project(moved(pose, d), view.points).ravel())
    residual = (view.pixels - project(pose, view.points)).ravel()
    variance = residual @ residual / (len(residual) - 6)
    covariance = variance * np.linalg.inv(images.T @ images)
    error = minimal_error(constraint, pose)
    by_pose = numeric_jacobian(lambda d: minimal_error(constraint, moved(pose, d)))
    total = by_pose @ covariance @ by_pose.T + (constraint.sensor_sigma or 0.0) ** 2 * np.eye(len(error))
    return float(error @ np.linalg.solve(total, error)), len(error)


@pytest.mark.parametrize("declared", [None, 0.01])
@pytest.mark.parametrize("name", ["odometer", "gyro", "gps"])
def test_report_is_the_mahalanobis_distance_of_plain_numpy(name: str, declared: float | None) -> None:
    drive = make_drive(3)
    constraint = getattr(drive, name)(0.01, declared=declared)
    pose = refine_pose(drive.view, [], drive.truth).pose
    report = conflict(drive.view, constraint, pose)
    squared, freedom = reference(drive, constraint, pose)
    assert report.squared_mahalanobis == pytest.approx(squared, rel=1e-3)
    assert report.degrees_of_freedom == freedom
    assert report.discrepancy == pytest.approx(np.linalg.norm(minimal_error(constraint, pose)), rel=1e-3)


@pytest.mark.parametrize(("name", "sigma"), [("odometer", 0.02), ("gyro", 0.003), ("gps", 0.02)])
def test_distances_of_correct_sensors_follow_the_chi_square_distribution(name: str, sigma: float) -> None:
    reports = []
    for seed in range(200):
        drive = make_drive(seed)
        constraint = getattr(drive, name)(sigma, declared=sigma)
        reports.append(conflict(drive.view, constraint, refine_pose(drive.view, [], drive.truth).pose))
    freedom = reports[0].degrees_of_freedom
    mean = np.mean([r.squared_mahalanobis for r in reports])
    assert abs(mean - freedom) < 4 * np.sqrt(2 * freedom / 200)
    assert np.count_nonzero([r.conflicting for r in reports]) <= 4


def test_rotation_by_matrix_and_by_logarithm_report_the_same() -> None:
    drive = make_drive(4)
    by_matrix = drive.gyro(0.01, declared=0.01)
    by_log = PoseConstraint(
        "displacement-rotation-log", rotation=by_matrix.rotation, previous=np.eye(3, 4), sensor_sigma=0.01
    )
    pose = refine_pose(drive.view, [], drive.truth).pose
    a, b = (conflict(drive.view, c, pose) for c in (by_matrix, by_log))
    assert a.sigmas == pytest.approx(b.sigmas, rel=1e-3)
    assert a.discrepancy == pytest.approx(b.discrepancy, rel=1e-3)
    assert (a.unit, a.degrees_of_freedom) == ("rad", 3) == (b.unit, b.degrees_of_freedom)


@pytest.mark.parametrize("freedom", range(1, 8))
@pytest.mark.parametrize("x", [0.0, 0.3, 2.0, 11.0, 80.0])
def test_chances_are_those_of_the_chi_square_distribution(freedom: int, x: float) -> None:
    assert equivalent_sigmas(x, freedom) == pytest.approx(norm.isf(chi2.sf(x, freedom) / 2), abs=1e-7)


def test_sigmas_of_one_number_are_its_distance_even_far_beyond_all_chances() -> None:
    assert equivalent_sigmas(9.0, 1) == pytest.approx(3.0)
    assert equivalent_sigmas(1e6, 1) == pytest.approx(1e3)
    assert equivalent_sigmas(1e6, 3) == pytest.approx(1e3, rel=1e-2)
    assert equivalent_sigmas(5.0, 0) == 0.0


def test_a_standing_camera_says_nothing_of_an_odometer() -> None:
    drive = make_drive(1)
    pose = refine_pose(drive.view, [], drive.truth).pose
    odometer = PoseConstraint("scale", distance=1.0, previous=pose, name="wheel")
    report = conflict(drive.view, odometer, pose)
    assert (report.degrees_of_freedom, report.sigmas, report.conflicting) == (0, 0.0, False)
    assert report.describe() == "wheel: its error does not depend on the pose, so the images cannot test it"


def test_sentence_names_sensor_distance_unit_and_sigmas() -> None:
    drive = make_drive(1, noise_px=0.0)
    pose = refine_pose(drive.view, [], drive.truth).pose
    faulty = PoseConstraint(
        "position", translation=drive.truth[:, 3] + [0, 0, 0.5], sensor_sigma=0.1, name="GPS"
    )
    assert conflict(drive.view, faulty, pose).describe() == (
        "GPS (σ = 0.1 m) disagrees with the images: 0.5 m apart, 4.3 σ"
    )
    correct = PoseConstraint("position", translation=drive.truth[:, 3], name="GPS")
    assert (
        conflict(drive.view, correct, pose)
        .describe()
        .startswith("GPS (taken as exact) agrees with the images")
    )


def test_a_conflict_is_judged_by_the_slack_of_a_sensor_its_weight_is_not() -> None:
    drive = make_drive(0)
    pose = refine_pose(drive.view, [], drive.truth).pose
    strict = drive.gyro(0.01, declared=0.003)
    lax, wide = replace(strict, slack=0.004), replace(strict, sensor_sigma=0.005)
    told = conflict(drive.view, lax, pose)
    assert told.squared_mahalanobis == pytest.approx(conflict(drive.view, wide, pose).squared_mahalanobis)
    assert told.sigmas < conflict(drive.view, strict, pose).sigmas
    assert declared_weight(lax, 40, 1.0) == declared_weight(strict, 40, 1.0)


def test_few_members_raise_the_limit_of_the_worst_and_so_do_many_numbers() -> None:
    few, more, all_but_endless = (_sigma_limit(1, members) for members in (4, 16, 10**8))
    assert few > more > all_but_endless == pytest.approx(CONFLICT_SIGMAS, rel=1e-3)
    assert _sigma_limit(20, 16) > more
