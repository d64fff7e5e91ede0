"""Selection of weights: the fits and scores behind it against SciPy, and what a choice must obey."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from fusion_helpers import Array, Drive, make_drive, moved, project, slow_fit, slow_leave_one_out, stacked
from sfmcpp import InvalidArgument
from sfmcpp.weighting import (
    POSE_METHODS,
    PoseConstraint,
    PoseView,
    WeightSweep,
    equivalent_sigma,
    refine_pose,
    select_weight,
    select_weights,
    sweep_weights,
    weight_grid,
)

SENSORS = ("odometer", "gyro", "gps")
NAMED = [name for name in POSE_METHODS if name != "fixed:λ"]


def sensor(drive: Drive, name: str, sigma: float = 0.02) -> PoseConstraint:
    return getattr(drive, name)(sigma)


def sweep(drive: Drive, constraint: PoseConstraint, weights: Array) -> WeightSweep:
    return sweep_weights(
        drive.view, constraint, weights, drive.truth, leave_one_out=True, approximate_leave_one_out=True
    )


@pytest.mark.parametrize("name", SENSORS)
def test_sweep_has_the_optima_and_errors_of_a_slow_fit(name: str) -> None:
    drive = make_drive(3)
    constraint, weights = sensor(drive, name), np.array([0.0, 1.0, 30.0, 300.0])
    found = sweep(drive, constraint, weights)
    for k, weight in enumerate(weights):
        pose = slow_fit(drive.view, [(constraint, weight)], drive.truth)
        np.testing.assert_allclose(found.poses[k], pose, atol=2e-7)
        cost = np.sum(stacked(drive.view, [(constraint, weight)], pose) ** 2)
        assert found.vision[k] + weight**2 * found.constraint[k] == pytest.approx(cost, rel=1e-9)
        distances = np.linalg.norm(drive.view.pixels - project(pose, drive.view.points), axis=1)
        assert found.inliers[k] == np.count_nonzero(distances <= 2)
        assert found.converged[k]


@pytest.mark.parametrize("name", SENSORS)
def test_leave_one_out_is_that_of_slow_refits(name: str) -> None:
    drive = make_drive(4, count=15)
    constraint, weights = sensor(drive, name), np.array([0.0, 10.0, 100.0])
    found = sweep(drive, constraint, weights)
    for k, weight in enumerate(weights):
        expected = slow_leave_one_out(drive.view, [(constraint, weight)], found.poses[k])
        assert found.leave_one_out[k] == pytest.approx(expected, rel=1e-4)
        assert found.approximate_leave_one_out[k] == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("seed", range(3))
def test_closed_form_is_within_five_percent_over_the_whole_grid_where_residuals_are_small(
    name: str, seed: int
) -> None:
    drive = make_drive(seed)
    found = sweep(drive, sensor(drive, name), weight_grid())
    np.testing.assert_allclose(found.approximate_leave_one_out, found.leave_one_out, rtol=0.05)


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("seed", range(5))
def test_images_fit_worse_and_the_sensor_better_as_the_weight_grows(name: str, seed: int) -> None:
    drive = make_drive(seed)
    found = sweep(drive, sensor(drive, name), weight_grid())
    assert (np.diff(found.vision) >= -1e-10 * found.vision[1:]).all()
    assert (np.diff(found.constraint) <= 1e-10 * found.constraint[:-1]).all()
    assert found.vision[-1] > found.vision[0]
    assert found.constraint[-1] < found.constraint[0]


# The images alone tell the pose to about a centimetre and half a milliradian.
SIGMAS = {"odometer": (0.003, 0.03, 0.3), "gyro": (1e-4, 1e-3, 1e-2), "gps": (0.003, 0.03, 0.3)}


@pytest.mark.parametrize("method", ["loo", "loo-approx"])
@pytest.mark.parametrize("name", SENSORS)
def test_noisier_sensors_get_smaller_weights(method: str, name: str) -> None:
    medians = []
    for sigma in SIGMAS[name]:
        drives = [make_drive(seed) for seed in range(25)]
        chosen = [select_weight(d.view, sensor(d, name, sigma), d.truth, method).weight for d in drives]
        medians.append(np.median(chosen))
    assert medians[0] > 1.5 * medians[1]
    assert medians[1] > 1.5 * medians[2]


def pose_error(name: str, pose: Array, truth: Array) -> float:
    """What the sensor measures: the angle between rotations, or the distance between centres."""
    if name == "gyro":
        return float(Rotation.from_matrix(pose[:, :3].T @ truth[:, :3]).magnitude())
    return float(np.linalg.norm(pose[:, 3] - truth[:, 3]))


@pytest.mark.parametrize("name", SENSORS)
def test_a_good_sensor_makes_the_pose_better(name: str) -> None:
    alone, fused = [], []
    for seed in range(25):
        drive = make_drive(seed, count=25)
        choice = select_weight(drive.view, sensor(drive, name, SIGMAS[name][0]), drive.truth, "loo")
        vision = refine_pose(drive.view, [], drive.truth).pose
        alone.append(pose_error(name, vision, drive.truth))
        fused.append(pose_error(name, choice.pose, drive.truth))
    assert np.mean(fused) < 0.97 * np.mean(alone)


@pytest.mark.parametrize("method", NAMED)
def test_a_lying_sensor_is_reported_and_cannot_drive_out_the_inliers(method: str) -> None:
    for seed in range(10):
        drive = make_drive(seed)
        faulty = drive.odometer(0.0, factor=1.3, declared=0.02)
        choice = select_weight(drive.view, faulty, drive.truth, method)
        assert choice.conflict.conflicting
        assert "disagrees with the images" in choice.describe()
        inliers = sweep_weights(drive.view, faulty, [0.0, choice.weight], drive.truth).inliers
        assert inliers[1] >= 0.9 * inliers[0]
        correct = drive.odometer(0.0, declared=0.02)
        assert not select_weight(drive.view, correct, drive.truth, method).conflict.conflicting


def test_cross_validation_gives_a_lying_sensor_little_weight() -> None:
    drives = [make_drive(seed) for seed in range(15)]
    faulty = [select_weight(d.view, d.odometer(0.0, factor=1.3), d.truth).weight for d in drives]
    truths = [select_weight(d.view, d.odometer(0.0), d.truth).weight for d in drives]
    assert np.median(faulty) < 0.05 * np.median(truths)


@pytest.mark.parametrize("name", SENSORS)
def test_equivalent_sigma_makes_the_optimum_that_of_maximum_likelihood(name: str) -> None:
    drive = make_drive(6)
    constraint, weight = sensor(drive, name, 0.01), 25.0
    pixel_sigma = 0.8
    sigma = equivalent_sigma(constraint, weight, drive.view.count, pixel_sigma)
    components = {"odometer": 1, "gyro": 3, "gps": 3}[name]

    def errors(pose: Array) -> Array:
        if name == "gyro":  # the small rotation itself, in radians
            cross = pose[:, :3].T @ constraint.rotation
            return (
                np.array([cross[2, 1] - cross[1, 2], cross[0, 2] - cross[2, 0], cross[1, 0] - cross[0, 1]])
                / 2
            )
        if name == "gps":
            return pose[:, 3] - constraint.translation
        return np.array([np.linalg.norm(pose[:, 3]) - constraint.distance])

    def likelihood(delta: Array) -> Array:
        pose = moved(drive.truth, delta)
        images = (drive.view.pixels - project(pose, drive.view.points)).ravel()
        assert len(errors(pose)) == components
        return np.concatenate([images / pixel_sigma, errors(pose) / sigma])

    best = moved(drive.truth, least_squares(likelihood, np.zeros(6), method="lm", xtol=1e-14, ftol=1e-14).x)
    np.testing.assert_allclose(
        refine_pose(drive.view, [(constraint, weight)], drive.truth).pose, best, atol=2e-6
    )
    assert equivalent_sigma(constraint, 0.0, 40, 1.0) == np.inf


@pytest.mark.parametrize("method", ["loo", "l-curve-scaled", "ltn"])
def test_millimetres_instead_of_metres_change_the_unit_and_nothing_else(method: str) -> None:
    drive = make_drive(8)
    metres = drive.odometer(0.03)
    view = drive.view
    in_mm = PoseView(1000 * view.points, view.pixels, view.intrinsics)
    millimetres = PoseConstraint("scale", distance=1000 * metres.distance, previous=np.eye(3, 4))
    start = np.column_stack([drive.truth[:, :3], 1000 * drive.truth[:, 3]])
    a = select_weight(view, metres, drive.truth, method, weights=weight_grid())
    b = select_weight(in_mm, millimetres, start, method, weights=weight_grid() / 1000)
    assert a.weight > 0
    assert b.weight == pytest.approx(a.weight / 1000)
    assert b.sensor_sigma == pytest.approx(1000 * a.sensor_sigma, rel=1e-6)
    assert b.conflict.sigmas == pytest.approx(a.conflict.sigmas, rel=1e-6)
    np.testing.assert_allclose(b.pose[:, 3], 1000 * a.pose[:, 3], rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("method", NAMED)
def test_selection_carries_the_curve_it_was_chosen_from(method: str) -> None:
    drive = make_drive(9)
    gyro = drive.gyro(0.01)
    choice = select_weight(drive.view, gyro, drive.truth, method)
    index = int(np.flatnonzero(choice.weights == choice.weight)[0])
    expected = refine_pose(drive.view, [(gyro, choice.weight)], drive.truth)
    np.testing.assert_allclose(choice.pose, expected.pose, atol=1e-9)
    assert choice.vision[index] == pytest.approx(expected.vision)
    assert choice.constraint_error[index] == pytest.approx(expected.constraints[0])
    assert choice.admissible[index]
    usable = choice.score[choice.admissible & np.isfinite(choice.score)]
    assert choice.score[index] == usable.min() or method in ("l-curve", "l-curve-scaled", "ltn")


def test_fixed_and_none_take_what_they_say() -> None:
    drive = make_drive(2)
    gyro = drive.gyro(0.01)
    fixed = select_weight(drive.view, gyro, drive.truth, "fixed:12.5")
    assert fixed.weight == 12.5
    np.testing.assert_allclose(
        fixed.pose, refine_pose(drive.view, [(gyro, 12.5)], drive.truth).pose, atol=1e-9
    )
    none = select_weight(drive.view, gyro, drive.truth, "none")
    assert (none.weight, none.sensor_sigma) == (0.0, np.inf)
    assert select_weight(drive.view, gyro, drive.truth, "fixed:0").weight == 0


def test_several_sensors_are_fitted_together_at_their_weights() -> None:
    drive = make_drive(5)
    sensors = [drive.odometer(0.01), drive.gyro(0.002)]
    choices = select_weights(drive.view, sensors, drive.truth, ["loo", "fixed:40"])
    assert choices[1].weight == 40
    weighted = [(s, c.weight) for s, c in zip(sensors, choices, strict=True)]
    expected = slow_fit(drive.view, weighted, drive.truth)
    for choice in choices:
        np.testing.assert_allclose(choice.pose, expected, atol=2e-7)
    alone = select_weight(drive.view, sensors[0], drive.truth, held=[(sensors[1], 40.0)])
    assert choices[0].weight == alone.weight
    np.testing.assert_array_equal(choices[0].score, alone.score)


def test_one_sensor_among_several_is_the_same_as_alone() -> None:
    drive = make_drive(5)
    gyro = drive.gyro(0.002)
    [choice] = select_weights(drive.view, [gyro], drive.truth)
    alone = select_weight(drive.view, gyro, drive.truth)
    assert choice.weight == alone.weight
    np.testing.assert_allclose(choice.pose, alone.pose, atol=1e-9)
    assert select_weights(drive.view, [], drive.truth) == []


def test_the_same_question_has_the_same_answer() -> None:
    first, second = (
        select_weight(d.view, d.gps(0.05), d.truth).score for d in (make_drive(11), make_drive(11))
    )
    np.testing.assert_array_equal(first, second)


def test_refusals_name_argument_and_rule() -> None:
    drive = make_drive(1)
    gyro = drive.gyro(0.01)
    with pytest.raises(InvalidArgument, match="method = 'best': must be one of loo, loo-approx"):
        select_weight(drive.view, gyro, drive.truth, "best")
    with pytest.raises(
        InvalidArgument, match="method = 'variance': is for a whole problem; for one pose must"
    ):
        select_weight(drive.view, gyro, drive.truth, "variance")
    with pytest.raises(InvalidArgument, match="method = 'fixed:much': the weight must be a number"):
        select_weight(drive.view, gyro, drive.truth, "fixed:much")
    with pytest.raises(InvalidArgument, match="weights: must begin with zero"):
        select_weight(drive.view, gyro, drive.truth, weights=[1.0, 2.0])
    with pytest.raises(InvalidArgument, match="method: 1, must be one for each of 2"):
        select_weights(drive.view, [gyro, gyro], drive.truth, ["loo"])
    with pytest.raises(InvalidArgument, match="points: 3, must be at least 4"):
        select_weight(PoseView(np.ones((3, 3)), np.ones((3, 2)), drive.view.intrinsics), gyro, drive.truth)
    with pytest.raises(InvalidArgument, match="kind = 'gyro'"):
        PoseConstraint("gyro")
    with pytest.raises(InvalidArgument, match="previous = None: a scale constraint"):
        PoseConstraint("scale", distance=1.0)
    with pytest.raises(InvalidArgument, match=r"sensor_sigma = -1\.0"):
        PoseConstraint("position", sensor_sigma=-1.0)
    with pytest.raises(InvalidArgument, match=r"constraints\[0\]\.rotation: must be a rotation"):
        select_weight(drive.view, PoseConstraint("orientation", rotation=2 * np.eye(3)), drive.truth)
