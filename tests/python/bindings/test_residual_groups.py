"""Residuals by a Python function: the built-in constraints copied, minima against SciPy, what goes wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import sfmcpp
from constrained import Array, positions, scene
from projection import reference_residuals
from sfmcpp import ConstraintGroup, Problem, ResidualGroup

CAMERAS = np.arange(6)


def copied_positions(centres: Array, with_jacobian: bool) -> ResidualGroup:
    def own(poses: Array) -> Array | tuple[Array, Array]:
        residuals = (poses[:, :, 3] - centres) / np.sqrt(3)
        jacobian = np.zeros((len(poses), 3, 6))
        jacobian[:, :, 3:] = np.eye(3) / np.sqrt(3)
        return (residuals, jacobian) if with_jacobian else residuals

    return ResidualGroup(own, CAMERAS, name="gps", weight=40.0)


def test_single_precision_is_refused() -> None:
    group = ResidualGroup(lambda poses: poses[:, :, 3].astype(np.float32), CAMERAS, name="gps")
    with pytest.raises(sfmcpp.InvalidArgument, match="returns float32, must compute in float64"):
        sfmcpp.solve(scene(), constraints=[group])


@pytest.mark.parametrize("loss", ["squared", "huber", "tukey"])
@pytest.mark.parametrize("method", ["lm-nielsen", "dog-leg"])
def test_a_copy_of_the_position_constraint_takes_the_same_iterations(loss: str, method: str) -> None:
    centres = scene().centres + np.random.default_rng(3).normal(0, 0.05, (6, 3))
    built_in = ConstraintGroup("position", CAMERAS, centres, weight=40.0, name="gps", loss=loss)
    own = copied_positions(centres, with_jacobian=True)
    own.loss = loss
    first, second = scene(), scene()
    less_rounding = {"initial_damping": 1e-4, "acceleration": "none"}
    damped: dict[str, Any] = less_rounding if method == "lm-nielsen" else {}
    expected = sfmcpp.solve(first, constraints=[built_in], method=method, **damped)
    found = sfmcpp.solve(second, constraints=[own], method=method, **damped)
    assert len(expected.iterations) > 3
    of_own, of_built_in = found.history()["cost"], expected.history()["cost"]
    np.testing.assert_allclose(of_own[:12], of_built_in[:12], rtol=1e-11)
    np.testing.assert_allclose(of_own, of_built_in, rtol=1e-9)  # rounding grows from step to step
    np.testing.assert_allclose(second.cameras, first.cameras, atol=1e-9)
    assert found.constraint_costs["gps"][1] == pytest.approx(expected.constraint_costs["gps"][1], rel=1e-9)


def test_derivatives_by_differences_lead_to_the_same_minimum() -> None:
    centres = scene().centres + np.random.default_rng(3).normal(0, 0.05, (6, 3))
    first, second = scene(), scene()
    sfmcpp.solve(first, constraints=[copied_positions(centres, with_jacobian=True)])
    sfmcpp.solve(second, constraints=[copied_positions(centres, with_jacobian=False)])
    np.testing.assert_allclose(second.cameras, first.cameras, atol=1e-7)


def test_differences_are_derivatives_by_a_turn_of_the_camera_and_its_centre() -> None:
    """Against closed forms: R exp([δ]×) a moves by −R [a]× δ, and R_pᵀ (t − t_p) by both poses."""
    problem = scene()
    a = np.array([0.3, -0.2, 0.9])

    def turned(poses: Array) -> Array:
        return np.asarray(poses[:, :, :3] @ a)

    def skew(x: Array) -> Array:
        return np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])

    found = ResidualGroup(turned, CAMERAS).evaluate(problem.cameras[:, None]).by_poses
    assert found is not None
    expected = np.array([-rotation @ skew(a) for rotation in problem.rotations])
    np.testing.assert_allclose(found[:, :, 0, :3], expected, atol=1e-9)
    np.testing.assert_allclose(found[:, :, 0, 3:], 0, atol=1e-12)

    def displacement(poses: Array) -> Array:
        moved = poses[:, 1, :, 3] - poses[:, 0, :, 3]
        return np.einsum("nji,nj->ni", poses[:, 0, :, :3], moved)

    pairs = np.array([[0, 1], [4, 2]])
    poses = problem.cameras[pairs]
    values, found, _ = ResidualGroup(displacement, pairs).evaluate(poses)
    assert found is not None
    np.testing.assert_allclose(found[0, :, 0, :3], skew(values[0]), atol=1e-7)
    np.testing.assert_allclose(found[1, :, 0, 3:], -poses[1, 0, :, :3].T, atol=1e-9)
    np.testing.assert_allclose(found[1, :, 1, 3:], poses[1, 0, :, :3].T, atol=1e-9)


def test_minimum_with_own_residuals_of_pairs_equals_that_of_scipy() -> None:
    """A ratio of two distances, which no kind of constraint knows."""
    pairs = np.array([[0, 1], [1, 2], [2, 3], [3, 4]])

    def log_distance(poses: Array) -> Array:
        distance = np.linalg.norm(poses[:, 1, :, 3] - poses[:, 0, :, 3], axis=1)
        return 30 * np.log(distance / 2.0)[:, None]

    problem = scene("calibrated")
    problem.fixed_cameras[0] = True
    group = ResidualGroup(log_distance, pairs, 2.0)
    sfmcpp.solve(problem, constraints=[group], function_tolerance=1e-14, gauge="free")

    def moved(x: Array) -> Problem:
        other = problem.copy()
        turns = Rotation.from_rotvec(x[:15].reshape(5, 3)).as_matrix()
        other.cameras[1:, :, :3] = problem.rotations[1:] @ turns
        other.cameras[1:, :, 3] += x[15:30].reshape(5, 3)
        other.points += x[30:].reshape(-1, 3)
        return other

    def all_residuals(x: Array) -> Array:
        other = moved(x)
        own = np.sqrt(2.0) * log_distance(other.cameras[pairs]).ravel()
        return np.concatenate([reference_residuals(other).ravel(), own])

    found = least_squares(all_residuals, np.zeros(30 + problem.points.size))
    assert np.abs(log_distance(problem.cameras[pairs])).min() > 1e-3  # images and group disagree
    assert found.cost == pytest.approx(0.5 * np.sum(all_residuals(np.zeros(len(found.x))) ** 2), rel=1e-9)
    np.testing.assert_allclose(moved(found.x).centres, problem.centres, atol=2e-5)


class Broken(Exception):
    pass


@pytest.mark.parametrize("call", [0, 1, 2, 27])
def test_what_the_function_raises_is_raised_and_the_best_state_until_there_kept(call: int) -> None:
    centres, calls = scene().centres + 0.05, 0

    def fails(poses: Array) -> tuple[Array, Array]:
        nonlocal calls
        calls += 1
        if calls > call:
            raise Broken("as it is")
        residuals = (poses[:, :, 3] - centres) / np.sqrt(3)
        jacobian = np.zeros((6, 3, 6))
        jacobian[:, :, 3:] = np.eye(3) / np.sqrt(3)
        return residuals, jacobian

    problem, start = scene(), scene()
    with pytest.raises(Broken, match="as it is"):
        sfmcpp.solve(problem, constraints=[ResidualGroup(fails, CAMERAS)])
    assert calls == call + 1  # it is not asked again
    assert np.isfinite(problem.cameras).all()
    sfmcpp.check(problem)
    moved = not np.array_equal(problem.cameras, start.cameras)
    assert moved == (call == 27)
    if moved:
        assert sfmcpp.cost(problem) < sfmcpp.cost(start)


def test_ctrl_c_inside_the_function_is_raised_as_it_is() -> None:
    def interrupted(poses: Array) -> Array:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sfmcpp.solve(scene(), constraints=[ResidualGroup(interrupted, CAMERAS)])


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (np.zeros(6), r"constraints\['own'\].function: shape \(6,\), must be \(6, any\)"),
        (np.zeros((5, 3)), r"shape \(5, 3\), must be \(6, any\)"),
        (np.full((6, 3), np.nan), r"function\[0, 0\] = nan: must be finite"),
        (np.full((6, 3), 1j), "function: must be an array of real numbers"),
        ((np.zeros((6, 3)), np.zeros((6, 3, 3))), r"derivatives of .*shape \(6, 3, 3\), must be \(6, 3, 6\)"),
    ],
)
def test_an_answer_that_cannot_be_used_is_named(answer: object, message: str) -> None:
    group = ResidualGroup(lambda poses: answer, CAMERAS, name="own")  # type: ignore[arg-type, return-value]
    with pytest.raises(sfmcpp.InvalidArgument, match=message):
        sfmcpp.solve(scene(), constraints=[group])


@pytest.mark.parametrize("calls", range(1, 40, 2))
def test_as_many_rows_as_before_must_be_returned(calls: int) -> None:
    left = [3] * calls

    def other(poses: Array) -> Array:
        return poses[:, :, 3] if left and left.pop() else poses[:, :2, 3]

    group = ResidualGroup(other, CAMERAS, name="own")
    with pytest.raises(
        sfmcpp.InvalidArgument, match=r"shape \(6, 2\), must be \(6, 3\)|of its answer changed"
    ):
        sfmcpp.solve(scene(), constraints=[group])


def test_what_a_group_cannot_be_is_refused_by_name() -> None:
    problem = scene()
    own = copied_positions(problem.centres.copy(), with_jacobian=True)
    with pytest.raises(sfmcpp.InvalidArgument, match=r"'gps'\].cameras: must be from 0 to 5"):
        sfmcpp.solve(problem, constraints=[ResidualGroup(own.function, [0, 6], name="gps")])
    with pytest.raises(sfmcpp.InvalidArgument, match="must be callable"):
        ResidualGroup(3, CAMERAS)  # type: ignore[arg-type]
    with pytest.raises(sfmcpp.InvalidArgument, match="camera_model = 'projective'"):
        sfmcpp.solve(sfmcpp.as_projective(scene()), constraints=[own])


def test_covariances_beside_own_residuals_are_those_beside_the_constraint() -> None:
    problem = scene()
    built_in = positions(problem, problem.copy(), weight=40.0)
    own = copied_positions(problem.centres.copy(), with_jacobian=True)
    expected = sfmcpp.linearize(problem, constraints=[built_in]).covariance(cameras="all").cameras
    found = sfmcpp.linearize(problem, constraints=[own]).covariance(cameras="all").cameras
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-15)


def test_derivatives_that_are_not_those_of_the_function_are_told() -> None:
    def barometer(poses: Array) -> tuple[Array, Array]:
        jacobian = np.zeros((len(poses), 1, 6))
        jacobian[:, 0, 5] = sign
        return poses[:, 2:3, 3] - 1.0, jacobian

    sign = -1.0
    group = ResidualGroup(barometer, CAMERAS, name="height")
    assert group.derivative_error(scene()) == pytest.approx(2.0)
    warnings = sfmcpp.solve(scene(), constraints=[group]).warnings
    assert any(
        "constraints['height']: the derivatives that its function gives are off" in w for w in warnings
    )
    sign = 1.0
    assert group.derivative_error(scene()) < 1e-6
    assert not any("derivatives" in w for w in sfmcpp.solve(scene(), constraints=[group]).warnings)


def heights(poses: Array) -> Array:
    return np.asarray((poses[:, 2, 3:] - scene().centres[:, 2:] - 0.1) / 0.2)


@pytest.mark.parametrize("habit", ["one array for all calls", "changes its argument"])
def test_a_function_may_return_the_same_array_each_time_and_change_its_arguments(habit: str) -> None:
    buffer = np.zeros((6, 1))

    def own(poses: Array) -> Array:
        if habit == "changes its argument":
            poses[:, 2, 3] -= scene().centres[:, 2]
            poses[:, 2, 3] -= 0.1
            return np.asarray(poses[:, 2, 3:] / 0.2)
        buffer[:] = heights(poses)
        return buffer

    first, second = scene(), scene()
    sfmcpp.solve(first, constraints=[ResidualGroup(heights, CAMERAS)])
    summary = sfmcpp.solve(second, constraints=[ResidualGroup(own, CAMERAS)])
    np.testing.assert_array_equal(second.cameras, first.cameras)
    assert not summary.warnings


def test_derivatives_in_an_array_of_the_function_are_compared_with_differences() -> None:
    residuals, jacobian = np.zeros((6, 1)), np.zeros((6, 1, 6))

    def own(poses: Array) -> tuple[Array, Array]:
        residuals[:], jacobian[:] = heights(poses), 0.0
        jacobian[:, 0, 5] = -5.0
        return residuals, jacobian

    assert ResidualGroup(own, CAMERAS).derivative_error(scene()) == pytest.approx(2)


@pytest.mark.parametrize("habit", ["random", "drifts"])
def test_a_function_that_gives_other_values_when_called_again_is_named(habit: str) -> None:
    rng, calls = np.random.default_rng(0), [0]

    def own(poses: Array) -> Array:
        calls[0] += 1
        return heights(poses) + (rng.normal(0, 0.1, (6, 1)) if habit == "random" else 0.01 * calls[0])

    group = ResidualGroup(own, CAMERAS, name="gps")
    (warning,) = sfmcpp.solve(scene(), constraints=[group], max_iterations=2).warnings
    assert "constraints['gps']: its function gives other values when it is called again" in warning


@pytest.mark.parametrize("shape", [(0,), (0, 2)])
def test_a_group_without_members_costs_nothing(shape: tuple[int, ...]) -> None:
    group = ResidualGroup(lambda poses: np.zeros((len(poses), 3)), np.zeros(shape, np.int32), name="none")
    found = sfmcpp.solve(scene(), constraints=[group])
    assert found.final_cost == sfmcpp.solve(scene()).final_cost
    assert found.constraint_costs == {"none": (0.0, 0.0)}
