"""Camera models by Python functions: a built-in one copied, a fisheye against SciPy, what goes wrong."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import sfmcpp
from own_cameras import Array, bal, bal_jacobians, copied, fisheye, fisheye_scene, own_bal
from sfmcpp import CameraFunction, ConstraintGroup, DatasetError, InvalidArgument, Problem


def scene(seed: int = 1) -> Problem:
    truth = sfmcpp.circle_scene(6, 40, camera_model="bal", seed=seed)
    return sfmcpp.perturb(
        truth, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=seed + 1
    )


@pytest.mark.parametrize("options", [
    {"loss": "cauchy", "max_iterations": 12},
    {"method": "dog-leg"},
    {"method": "gauss-newton", "linear_solver": "dense"},
    {"method": "lm", "linear_solver": "sparse"},
    {"method": "gradient-descent", "max_iterations": 4},
    {"method": "alternation", "max_iterations": 4},
    {"linear_solver": "iterative", "pcg_tolerance": 1e-8},  # rough steps differ by as much as they are rough
    {"line_search": "soft"},
    {"line_search": "backtracking"},
    {"threads": 2},
])  # fmt: skip
def test_a_copy_of_a_built_in_model_takes_the_same_iterations(options: dict[str, Any]) -> None:
    first, second = scene(), copied(scene(), own_bal())
    straight = {"point_steps": "whole", "intrinsic_steps": "whole", "acceleration": "none"}
    # Derivatives differ in their last digits, which matter less with more damping.
    damped = {} if "method" in options else {"initial_damping": 1e-4}
    alike: dict[str, Any] = {"gauge": "fixed", **straight, **damped, **options}
    expected, found = sfmcpp.solve(first, **alike), sfmcpp.solve(second, **alike)
    assert len(expected.iterations) > 3
    np.testing.assert_allclose(found.history()["cost"], expected.history()["cost"], rtol=1e-6)
    assert found.final_cost == pytest.approx(expected.final_cost, rel=1e-9)
    np.testing.assert_allclose(second.cameras, first.cameras, atol=1e-6)
    np.testing.assert_allclose(second.intrinsics, first.intrinsics, rtol=1e-6, atol=1e-6)


def test_steps_bend_as_those_of_the_built_in_model() -> None:
    first, second = scene(), copied(scene(), own_bal())
    options: dict[str, Any] = {"point_steps": "whole", "acceleration": "geodesic"}
    expected, found = sfmcpp.solve(first, **options), sfmcpp.solve(second, **options)
    plain = sfmcpp.solve(scene(), **(options | {"acceleration": "none"}))
    costs, others, without = (s.history()["cost"] for s in (found, expected, plain))
    assert abs(costs[1] - others[1]) < 1e-3 * abs(costs[1] - without[1])


def test_single_precision_is_refused() -> None:
    """Differences of it are noise, and derivatives in it lead to another minimum."""
    halved = replace(own_bal(False), project=lambda x, k: bal(x, k).astype(np.float32))
    with pytest.raises(InvalidArgument, match="project: returns float32, must compute in float64"):
        sfmcpp.solve(copied(scene(), halved))
    rough = replace(
        own_bal(), jacobians=lambda x, k: tuple(part.astype(np.float32) for part in bal_jacobians(x, k))
    )
    with pytest.raises(InvalidArgument, match="derivatives: returns float32"):
        sfmcpp.solve(copied(scene(), rough))


@pytest.mark.parametrize("with_jacobians", [True, False])
def test_minima_are_those_of_the_built_in_model(with_jacobians: bool) -> None:
    """Shared and fixed intrinsics, covariances of the images, a fixed gauge."""

    def prepared() -> Problem:
        problem = scene()
        problem.intrinsics[:] = problem.intrinsics[0]
        problem.intrinsics_index[:] = [0, 0, 0, 3, 3, 5]
        problem.set_free_intrinsics("f", "k1")
        problem.covariance_px2 = np.tile([[1.0, 0.3], [0.3, 2.0]], (problem.num_observations, 1, 1))
        return problem

    first, second = prepared(), copied(prepared(), own_bal(with_jacobians))
    for problem in (first, second):
        sfmcpp.solve(problem, gauge="fixed", loss="huber", function_tolerance=1e-15, max_iterations=50)
    np.testing.assert_allclose(second.intrinsics, first.intrinsics, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(second.cameras, first.cameras, atol=1e-7)
    np.testing.assert_allclose(second.points, first.points, atol=1e-7)
    assert (second.intrinsics[1] == scene().intrinsics[0]).all()  # nobody's row


def test_residuals_covariances_and_costs_along_a_step_are_those_of_the_built_in_model() -> None:
    first, second = scene(), copied(scene(), own_bal())
    np.testing.assert_allclose(sfmcpp.residuals(second), sfmcpp.residuals(first), atol=1e-9)
    assert sfmcpp.cost(second) == pytest.approx(sfmcpp.cost(first), rel=1e-12)
    for problem in (first, second):
        sfmcpp.solve(problem, gauge="fixed", function_tolerance=1e-12)
    expected, found = (sfmcpp.linearize(p).covariance(cameras="all").cameras for p in (first, second))
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-12)


def test_constraints_on_poses_and_focal_lengths_go_with_a_function() -> None:
    first, second = scene(), copied(scene(), own_bal())
    for problem in (first, second):
        groups = [
            ConstraintGroup("position", np.arange(6), scene().centres, weight=40.0, name="gps"),
            ConstraintGroup("focal", [1], [problem.intrinsics[1, 0] + 5], weight=1e4, name="focal"),
        ]
        sfmcpp.solve(problem, constraints=groups, function_tolerance=1e-14)
    np.testing.assert_allclose(second.cameras, first.cameras, atol=1e-6)
    np.testing.assert_allclose(second.intrinsics, first.intrinsics, rtol=1e-6, atol=1e-6)


def test_fisheye_that_sees_behind_itself_is_calibrated_to_the_minimum_of_scipy() -> None:
    truth, problem = fisheye_scene()
    problem.fixed_cameras[:2] = True
    start = problem.copy()
    sfmcpp.solve(problem, function_tolerance=1e-14, gauge="free")

    def moved(x: Array) -> Problem:
        other = start.copy()
        turns = Rotation.from_rotvec(x[:12].reshape(4, 3)).as_matrix()
        other.cameras[2:, :, :3] = problem.rotations[2:] @ turns
        other.cameras[2:, :, 3] = problem.centres[2:] + x[12:24].reshape(4, 3)
        other.intrinsics[0] = problem.intrinsics[0] + x[24:29] * [1, 1, 1, 1e-3, 1e-3]
        other.points[:] = problem.points + x[29:].reshape(-1, 3)
        return other

    def residuals(x: Array) -> Array:
        p = moved(x)
        poses = p.cameras[p.camera_index]
        in_camera = np.einsum("nji,nj->ni", poses[:, :, :3], p.points[p.point_index] - poses[:, :, 3])
        rows = np.repeat(p.intrinsics, p.num_observations, axis=0)
        return np.asarray(p.pixels - fisheye(in_camera, rows)).ravel()

    at_ours = residuals(np.zeros(29 + problem.points.size))
    found = least_squares(residuals, np.zeros(29 + problem.points.size))
    assert found.cost == pytest.approx(0.5 * at_ours @ at_ours, rel=1e-9)
    np.testing.assert_allclose(moved(found.x).cameras, problem.cameras, atol=1e-5)
    np.testing.assert_allclose(problem.intrinsics, truth.intrinsics, rtol=0.02, atol=0.003)


def test_bits_are_the_same_for_every_number_of_threads() -> None:
    states = []
    for threads in (1, 2, 3):
        _, problem = fisheye_scene()
        sfmcpp.solve(problem, threads=threads)
        states.append((problem.cameras.tobytes(), problem.intrinsics.tobytes(), problem.points.tobytes()))
    assert states[0] == states[1] == states[2]


def test_every_call_has_all_observations_and_comes_from_the_calling_thread() -> None:
    import threading

    calls = []

    def watched(points: Array, intrinsics: Array) -> Array:
        calls.append((points.shape, intrinsics.shape, threading.get_ident()))
        return bal(points, intrinsics)

    problem = copied(scene(), CameraFunction(watched, ("f", "k1", "k2"), free_by_default=("f",)))
    sfmcpp.solve(problem, threads=2)
    count = problem.num_observations
    assert set(calls) == {((count, 3), (count, 3), threading.get_ident())}


def test_check_jacobians_tells_wrong_derivatives_from_right_ones() -> None:
    def wrong(points: Array, intrinsics: Array) -> tuple[Array, Array]:
        by_point, by_intrinsics = bal_jacobians(points, intrinsics)
        by_intrinsics[:, :, 1] *= 1.01
        return by_point, by_intrinsics

    good = sfmcpp.check_jacobians(copied(scene(), own_bal()), 40)
    assert good.worst_error < 1e-6
    assert good.entries > 400
    bad = sfmcpp.check_jacobians(
        copied(scene(), CameraFunction(bal, ("f", "k1", "k2"), wrong, name="own")), 40
    )
    assert bad.worst_parameter == "k1"
    assert bad.worst_error == pytest.approx(0.01, rel=0.1)
    assert repr(bad).startswith("JacobianCheck(")
    assert repr(pickle.loads(pickle.dumps(bad))) == repr(bad)
    assert f"k1 of observation {bad.worst_observation}" in repr(bad)


def test_derivatives_that_are_not_those_of_the_function_are_told() -> None:
    def wrong(points: Array, intrinsics: Array) -> tuple[Array, Array]:
        by_point, by_intrinsics = bal_jacobians(points, intrinsics)
        return by_point, by_intrinsics * [1, 1, -1]

    model = CameraFunction(bal, ("f", "k1", "k2"), wrong, name="own", free_by_default=("f",))
    assert model.derivative_error(copied(scene(), model)) == pytest.approx(2.0)
    warnings = sfmcpp.solve(copied(scene(), model)).warnings
    assert any("camera_model 'own': the derivatives that its function gives are off" in w for w in warnings)
    assert own_bal().derivative_error(copied(scene(), own_bal())) < 1e-6
    assert not any("derivatives" in w for w in sfmcpp.solve(copied(scene(), own_bal())).warnings)


class Broken(Exception):
    pass


@pytest.mark.parametrize("call", [0, 1, 2, 20])
def test_what_the_function_raises_is_raised_and_the_best_state_until_there_kept(call: int) -> None:
    calls = 0

    def fails(points: Array, intrinsics: Array) -> Array:
        nonlocal calls
        calls += 1
        if calls > call:
            raise Broken("as it is")
        return bal(points, intrinsics)

    problem = copied(scene(), CameraFunction(fails, ("f", "k1", "k2")))
    with pytest.raises(Broken, match="as it is"):
        sfmcpp.solve(problem)
    assert calls == call + 1  # it is not asked again
    moved = not np.array_equal(problem.cameras, scene().cameras)
    assert moved == (call == 20)
    fitted = copied(problem, own_bal())
    assert sfmcpp.cost(fitted) <= sfmcpp.cost(copied(scene(), own_bal()))


def test_ctrl_c_inside_the_function_is_raised_as_it_is() -> None:
    def interrupted(points: Array, intrinsics: Array) -> Array:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sfmcpp.solve(copied(scene(), CameraFunction(interrupted, ("f", "k1", "k2"))))


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda n: np.zeros(n), r"camera_model 'own': project: shape \(240,\), must be \(240, 2\)"),
        (lambda n: np.zeros((n, 3)), r"shape \(240, 3\), must be \(240, 2\)"),
        (lambda n: np.full((n, 2), np.nan), r"project gives no number for observation 0, .*240 of 240"),
        (lambda n: "text", r"must be an array of numbers"),
    ],
)
def test_pixels_that_cannot_be_used_are_named(answer: Any, message: str) -> None:
    model = CameraFunction(lambda points, _: answer(len(points)), ("f", "k1", "k2"), name="own")
    with pytest.raises(InvalidArgument, match=message):
        sfmcpp.solve(copied(scene(), model))


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ((np.zeros((240, 2)), np.zeros((240, 2, 3))), r"by points: shape \(240, 2\), must be \(240, 2, 3\)"),
        (
            (np.zeros((240, 2, 3)), np.full((240, 2, 3), np.inf)),
            r"derivatives by intrinsics\[0, 0, 0\] = inf",
        ),
        (None, "derivatives: must be two arrays, by points and by intrinsics"),
        (np.zeros((2, 240, 2, 3)), "must be two arrays"),
        ((np.zeros((240, 2, 3)),), "must be two arrays"),
    ],
)
def test_derivatives_that_cannot_be_used_are_named(answer: Any, message: str) -> None:
    model = CameraFunction(bal, ("f", "k1", "k2"), lambda *_: answer, name="own")
    with pytest.raises(InvalidArgument, match=message):
        sfmcpp.solve(copied(scene(), model))


def test_what_needs_more_than_images_is_refused_by_name(tmp_path: Path) -> None:
    problem = copied(scene(), own_bal())
    for options, message in [
        ({"line_search": "g-als"}, r"'own', a function, with line_search = 'g-als'"),
        ({"point_steps": "refitted"}, r"'own', a function, with point_steps = 'refitted'"),
        ({"intrinsic_steps": "late"}, r"'own', a function, with intrinsic_steps = 'late'"),
        (
            {"checkpoint": sfmcpp.CheckpointFolder(tmp_path / "runs")},
            "name of a model in a run that is saved",
        ),
    ]:
        with pytest.raises(InvalidArgument, match=message):
            sfmcpp.solve(problem, **options)
    for refused in (sfmcpp.as_projective, sfmcpp.projection_matrices):
        with pytest.raises(InvalidArgument, match="camera_model = 'own'"):
            refused(problem)
    with pytest.raises(DatasetError, match="camera model 'own' is a function, which no file holds"):
        sfmcpp.write(problem, tmp_path / "own.npz")
    images = ConstraintGroup("smoothing-reprojections", [[0, 1]], points=[problem.points[:4]], name="smooth")
    with pytest.raises(InvalidArgument, match=r"'smooth'\]: camera_model = 'own', a function"):
        sfmcpp.solve(problem, constraints=[images])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"project": 3}, "project = 3: must be callable"),
        ({"jacobians": 3}, "jacobians = 3: must be callable"),
        ({"intrinsics": ()}, "must be 1 to 12 names"),
        ({"intrinsics": ("f", "f")}, "a name is there twice"),
        ({"intrinsics": 3}, "must be names"),
        ({"free_by_default": ("k9",)}, "'k9' is none of f, k1, k2"),
        ({"name": 3}, "name = 3: must be text"),
    ],
)
def test_a_function_that_cannot_be_a_camera_model_is_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        CameraFunction(**({"project": bal, "intrinsics": ("f", "k1", "k2")} | arguments))


def test_a_problem_names_its_function() -> None:
    problem = copied(scene(), own_bal())
    assert "Problem('own': 6 cameras" in repr(problem)
    assert "own" in problem._repr_html_()
    assert problem.intrinsic_names == ("f", "k1", "k2")
    assert problem.is_metric
    assert repr(own_bal()) == "CameraFunction('own': f, k1, k2)"
    with pytest.raises(InvalidArgument, match="camera model 'own' has f, k1, k2"):
        problem.set_free_intrinsics("skew")
    with pytest.raises(InvalidArgument, match="must be names one by one, or none to fix all"):
        problem.set_free_intrinsics(["f", "k1"])  # type: ignore[arg-type]


@pytest.mark.parametrize("habit", ["one array for all calls", "changes its arguments"])
def test_a_function_may_return_the_same_array_each_time_and_change_its_arguments(habit: str) -> None:
    first = copied(scene(), own_bal(with_jacobians=False))
    buffer = np.empty((first.num_observations, 2))

    def own(points: Array, intrinsics: Array) -> Array:
        if habit == "changes its arguments":
            pixels = bal(points, intrinsics)
            points += 0.01
            intrinsics *= 1.01
            return pixels
        buffer[:] = bal(points, intrinsics)
        return buffer

    second = copied(first, CameraFunction(own, ("f", "k1", "k2"), free_by_default=("f", "k1", "k2")))
    sfmcpp.solve(first)
    assert not sfmcpp.solve(second).warnings
    np.testing.assert_array_equal(second.cameras, first.cameras)


def test_a_function_that_gives_other_values_when_called_again_is_named() -> None:
    rng = np.random.default_rng(0)
    noisy = CameraFunction(
        lambda points, row: bal(points, row) + rng.normal(0, 0.01, (len(points), 2)),
        ("f", "k1", "k2"),
        name="own",
    )
    warnings = sfmcpp.solve(copied(scene(), noisy), max_iterations=2).warnings
    assert "camera_model 'own': its function gives other values when it is called again" in warnings[0]


def test_what_is_wrong_with_a_problem_is_told_before_its_derivatives_are_looked_at() -> None:
    problem = copied(scene(), own_bal())
    nothing = problem.with_observations([])
    with pytest.raises(InvalidArgument, match="observations: there are none"):
        sfmcpp.solve(nothing, constraints=[ConstraintGroup("position", [0, 1], nothing.centres[:2])])
    problem.camera_index[3] = 99
    with pytest.raises(InvalidArgument, match=r"camera_index\[3\]"):
        sfmcpp.solve(problem)
