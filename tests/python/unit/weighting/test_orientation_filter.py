"""The filter on orientations against the truth of simulated motions, in SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.sensors import Mounting
from sfmcpp.weighting import filter_orientations, filter_trajectory, with_orientations

Array = NDArray[np.float64]
STEP_S = 0.1
MOUNTING = Mounting(
    Rotation.from_euler("xyz", [10, -80, 35], degrees=True).as_matrix(), np.array([0.3, 0.1, -0.2])
)


def tumbling(count: int, rng: np.random.Generator) -> Rotation:
    """Orientations that turn by about 0.1 rad a step, about axes that change."""
    turn = Rotation.from_rotvec(0.1 * rng.standard_normal(3))
    found = [Rotation.random(rng=rng)]
    for _ in range(count - 1):
        turn = turn * Rotation.from_rotvec(0.03 * rng.standard_normal(3))
        found.append(found[-1] * turn)
    return Rotation.concatenate(found)


def noisy(rotations: Rotation, sigmas: Array | float, rng: np.random.Generator) -> Rotation:
    return rotations * Rotation.from_rotvec(sigmas * rng.standard_normal((len(rotations), 3)))


def turns_of(rotations: Rotation) -> Rotation:
    return rotations[:-1].inv() * rotations[1:]


def chained(first: Rotation, turns: Rotation) -> Rotation:
    found = [first]
    for turn in turns:
        found.append(found[-1] * turn)
    return Rotation.concatenate(found)


def errors(estimate: Array, truth: Rotation) -> Array:
    """(n, 3) the w of ``R_true = R exp([w]×)``."""
    return np.asarray((Rotation.from_matrix(estimate).inv() * truth).as_rotvec())


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("seed", range(3))
def test_with_the_right_noise_the_filter_is_better_than_either_source(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = tumbling(600, rng)
    turns, measured = noisy(turns_of(truth), 0.004, rng), noisy(truth, 0.03, rng)
    found = filter_orientations(
        turns.as_matrix(), measured.as_matrix(), turn_sigma_rad=0.004, measured_sigma_rad=0.03
    )
    filtered = rms(errors(found.rotations, truth))
    integrated = rms(errors(chained(measured[0], turns).as_matrix(), truth))
    assert filtered < 0.5 * min(integrated, rms(errors(measured.as_matrix(), truth)))


def test_errors_are_as_large_as_the_covariance_says() -> None:
    """Normalised squared errors of independent runs follow χ², each axis with a noise of its own."""
    turn_sigma, measured_sigma = np.array([0.002, 0.01, 0.005]), np.array([0.03, 0.01, 0.05])
    rng = np.random.default_rng(5)
    squares = []
    for _ in range(150):
        truth = tumbling(40, rng)
        found = filter_orientations(
            noisy(turns_of(truth), turn_sigma, rng).as_matrix(),
            noisy(truth, measured_sigma, rng).as_matrix(),
            turn_sigma_rad=turn_sigma,
            measured_sigma_rad=measured_sigma,
        )
        (w,) = errors(found.rotations[-1:], truth[-1:])
        squares.append(w @ np.linalg.solve(found.covariances[-1], w))
    low, high = chi2.ppf([0.005, 0.995], 3 * len(squares))
    assert low < np.sum(squares) < high


def test_about_one_axis_it_is_the_kalman_filter_of_an_angle() -> None:
    rng = np.random.default_rng(2)
    steps, angles = rng.normal(0.02, 0.01, 30), rng.normal(0, 0.1, 31)
    estimate, variance = angles[0], 0.1**2
    expected = [(estimate, variance)]
    for step, angle in zip(steps, angles[1:], strict=True):
        variance += 0.05**2
        gain = variance / (variance + 0.1**2)
        estimate, variance = estimate + step + gain * (angle - estimate - step), (1 - gain) * variance
        expected.append((estimate, variance))

    def about_z(values: Array) -> Array:
        return np.asarray(Rotation.from_rotvec(np.outer(values, [0, 0, 1])).as_matrix())

    found = filter_orientations(about_z(steps), about_z(angles), turn_sigma_rad=0.05, measured_sigma_rad=0.1)
    np.testing.assert_allclose(found.rotations, about_z(np.array(expected)[:, 0]), atol=1e-12)
    np.testing.assert_allclose(found.covariances[:, 2, 2], np.array(expected)[:, 1], rtol=1e-12)


def test_an_exact_source_is_followed_and_the_other_ignored() -> None:
    rng = np.random.default_rng(3)
    truth = tumbling(50, rng)
    turns, measured = noisy(turns_of(truth), 0.05, rng), noisy(truth, 0.05, rng)
    exact_turns, exact_measured = (
        filter_orientations(turns.as_matrix(), measured.as_matrix(), turn_sigma_rad=a, measured_sigma_rad=b)
        for a, b in ((0.0, np.append(0.0, np.ones(49))[:, None]), (1.0, 0.0))
    )
    np.testing.assert_allclose(exact_turns.rotations, chained(measured[0], turns).as_matrix(), atol=1e-12)
    np.testing.assert_allclose(exact_measured.rotations, measured.as_matrix(), atol=1e-12)


def test_missing_orientations_leave_the_prediction_and_missing_turns_begin_anew() -> None:
    rng = np.random.default_rng(4)
    truth = tumbling(30, rng)
    turns, measured = turns_of(truth).as_matrix(), noisy(truth, 0.05, rng).as_matrix()
    measured[10:] = np.nan
    silent = filter_orientations(turns, measured, turn_sigma_rad=0.01, measured_sigma_rad=0.05)
    expected = chained(Rotation.from_matrix(silent.rotations[9]), Rotation.from_matrix(turns[9:]))
    np.testing.assert_allclose(silent.rotations[9:], expected.as_matrix(), atol=1e-12)
    assert (np.diff(np.trace(silent.covariances[9:], axis1=1, axis2=2)) > 0).all()

    turns[19], measured = np.nan, noisy(truth, 0.05, rng).as_matrix()
    lost = filter_orientations(turns, measured, turn_sigma_rad=0.001, measured_sigma_rad=0.05)
    np.testing.assert_allclose(lost.rotations[20], measured[20], atol=1e-3)
    assert np.trace(lost.covariances[20]) > 0.99 * 3 * 0.05**2 > 2 * np.trace(lost.covariances[19])


def drive(seed: int, count: int = 200) -> tuple[Trajectory, Trajectory, Array]:
    """The truth; a trajectory at half its scale whose orientations drift, so that it bends; stamps."""
    rng = np.random.default_rng(seed)
    t_s = STEP_S * np.arange(count)
    truth = tumbling(count, rng)
    steps = np.array([0.0, 0.1, 1.0]) + 0.1 * rng.standard_normal((count - 1, 3))
    drifting = chained(truth[0], noisy(turns_of(truth), 0.01, rng))
    return (*(moved(t_s, r, scale * steps) for r, scale in ((truth, 1.0), (drifting, 0.5))), t_s)


def moved(t_s: Array, rotations: Rotation, steps: Array) -> Trajectory:
    """A trajectory of steps given in the camera's own frame."""
    centres = np.concatenate([np.zeros((1, 3)), np.cumsum(rotations[:-1].apply(steps), axis=0)])
    return Trajectory(t_s, np.concatenate([rotations.as_matrix(), centres[:, :, None]], axis=2))


def test_positions_follow_from_the_orientations_by_the_steps_in_the_camera_frame() -> None:
    truth, drifted, _ = drive(1)
    straight = with_orientations(drifted, truth.rotations)
    np.testing.assert_allclose(straight.centres, 0.5 * truth.centres, atol=1e-12)
    np.testing.assert_array_equal(straight.rotations, truth.rotations)
    same = with_orientations(drifted, drifted.rotations)
    np.testing.assert_allclose(same.poses, drifted.poses, atol=1e-12)


def orientation_stream(truth: Trajectory, seed: int) -> SensorStream:
    """What a body with the mounting above measures in a world of its own, to 0.001 rad."""
    rng = np.random.default_rng(seed)
    bodies = Rotation.from_matrix(truth.rotations @ MOUNTING.camera_from_body)
    elsewhere = Rotation.random(rng=rng) * noisy(bodies, 0.001, rng)
    return SensorStream(truth.t_s, elsewhere.as_rotvec(), "orientation")


@pytest.mark.parametrize("seed", range(3))
def test_a_sensor_that_does_not_drift_straightens_a_drifting_run(seed: int) -> None:
    truth, drifted, _ = drive(seed)
    found = filter_trajectory(
        drifted,
        orientation_stream(truth, seed),
        MOUNTING,
        turn_sigma_rad_sqrt_s=0.01 / np.sqrt(STEP_S),
        orientation_sigma_rad=0.001,
    )
    before = np.linalg.norm(drifted.centres - 0.5 * truth.centres, axis=1).mean()
    after = np.linalg.norm(found.centres - 0.5 * truth.centres, axis=1).mean()
    assert after < 0.2 * before
    assert rms(errors(found.rotations, Rotation.from_matrix(truth.rotations))) < 0.003


def test_gravity_rights_the_tilt_and_leaves_the_heading_to_the_images() -> None:
    truth, drifted, _ = drive(3)
    true = Rotation.from_matrix(truth.rotations)
    vertical = Rotation.from_euler("xyz", [20, -50, 70], degrees=True).as_matrix()
    bodies = Rotation.from_matrix(vertical @ truth.rotations @ MOUNTING.camera_from_body)
    stream = SensorStream(truth.t_s, bodies.as_rotvec(), "orientation")
    found = filter_trajectory(
        drifted,
        stream,
        MOUNTING,
        turn_sigma_rad_sqrt_s=0.01 / np.sqrt(STEP_S),
        orientation_sigma_rad=1e-4,
        heading_sigma_rad=1e3,
    )
    up = vertical[2]

    def tilt_and_heading(rotations: Array) -> tuple[float, float]:
        in_world = true.apply(errors(rotations, true))
        about_up = in_world @ up
        return rms(in_world - about_up[:, None] * up), rms(about_up)

    (tilt, heading), (drifted_tilt, drifted_heading) = map(
        tilt_and_heading, (found.rotations, drifted.rotations)
    )
    assert tilt < 1e-3 < 0.02 < drifted_tilt
    assert heading > 0.3 * drifted_heading


def test_gravity_asks_for_a_sensor_that_tells_orientations() -> None:
    _, drifted, t_s = drive(0, 5)
    rates = SensorStream(t_s, np.zeros((5, 3)), "angular_rate")
    late = SensorStream(t_s + STEP_S, np.zeros((5, 3)), "orientation")
    noise = {"turn_sigma_rad_sqrt_s": 0.1, "orientation_sigma_rad": 0.1, "heading_sigma_rad": 1.0}
    with pytest.raises(InvalidArgument, match=r"heading_sigma_rad = 1\.0: must be None unless"):
        filter_trajectory(drifted, rates, MOUNTING, **noise)
    with pytest.raises(InvalidArgument, match="stream: must tell the orientation at 0 s"):
        filter_trajectory(drifted, late, MOUNTING, **noise)


def test_rates_of_a_gyro_calm_orientations_that_jitter_and_gaps_are_passed_over() -> None:
    truth, _, t_s = drive(7)
    rng = np.random.default_rng(7)
    true = Rotation.from_matrix(truth.rotations)
    jittering = moved(t_s, noisy(true, 0.03, rng), np.zeros((len(t_s) - 1, 3)))
    bodies = true * Rotation.from_matrix(MOUNTING.camera_from_body)
    rates = turns_of(bodies).as_rotvec() / STEP_S
    # A sample in the middle of each step; between them the stream is silent for a second, once.
    kept = np.r_[0:90, 100 : len(rates)]
    middles_s = t_s[:-1] + 0.5 * STEP_S
    stream = SensorStream(
        np.repeat(middles_s[kept], 2) + np.tile([-0.04, 0.04], len(kept)),
        np.repeat(rates[kept], 2, 0),
        "angular_rate",
        max_gap_s=0.1,
    )
    found = filter_trajectory(
        jittering,
        stream,
        MOUNTING,
        turn_sigma_rad_sqrt_s=0.02,
        orientation_sigma_rad=0.03,
        predict_by="sensor",
    )
    w = np.linalg.norm(errors(found.rotations, true), axis=1)
    assert np.median(w) < 0.6 * np.median(np.linalg.norm(errors(jittering.rotations, true), axis=1))
    np.testing.assert_allclose(found.rotations[95], jittering.rotations[95], atol=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"turns": np.zeros((4, 3, 3))}, "turns"),
        ({"measured": np.full((4, 3, 3), np.nan)}, r"measured\[0\]"),
        ({"turn_sigma_rad": -1.0}, "turn_sigma_rad"),
        ({"measured_sigma_rad": np.ones((2, 3))}, "measured_sigma_rad"),
    ],
)
def test_what_cannot_be_filtered_is_refused(change: dict[str, object], message: str) -> None:
    good: dict[str, object] = {
        "turns": np.tile(np.eye(3), (3, 1, 1)),
        "measured": np.tile(np.eye(3), (4, 1, 1)),
        "turn_sigma_rad": 0.1,
        "measured_sigma_rad": 0.1,
    }
    arguments = {**good, **change}
    with pytest.raises(InvalidArgument, match=message):
        filter_orientations(**arguments)  # type: ignore[arg-type]


def test_a_predictor_that_does_not_exist_is_refused() -> None:
    truth, drifted, _ = drive(0, 5)
    with pytest.raises(InvalidArgument, match="predict_by"):
        filter_trajectory(
            drifted,
            orientation_stream(truth, 0),
            MOUNTING,
            turn_sigma_rad_sqrt_s=0.1,
            orientation_sigma_rad=0.1,
            predict_by="odometer",
        )
