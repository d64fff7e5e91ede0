"""A solve does not pass over in silence what makes its result worth less than it looks."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfmcpp import ConstraintGroup, InvalidArgument, Problem
from sfmcpp.ba import as_projective


def scene(camera_model: str = "calibrated", seed: int = 0) -> Problem:
    truth = sfmcpp.circle_scene(12, 80, camera_model=camera_model, seed=seed)
    return sfmcpp.perturb(truth, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=seed)


@pytest.mark.parametrize("unit", [1e-12, 1e-6, 1e7, 1e9, 1e12])
@pytest.mark.parametrize("camera_model", ["calibrated", "bal"])
def test_the_unit_of_lengths_changes_no_result(camera_model: str, unit: float) -> None:
    metres, others = scene(camera_model), scene(camera_model)
    others.centres[:] *= unit
    others.points[:] *= unit
    expected, found = sfmcpp.solve(metres), sfmcpp.solve(others)
    assert found.termination == "converged"
    assert found.final_cost == pytest.approx(expected.final_cost, rel=1e-6)
    assert len(found.iterations) == len(expected.iterations)


@pytest.mark.parametrize("sigma_px", [1e-6, 1e8, 1e9])
def test_the_unit_of_standard_deviations_changes_no_result(sigma_px: float) -> None:
    problem = scene()
    expected = sfmcpp.solve(scene()).final_cost
    problem.sigma_px = np.full(problem.num_observations, sigma_px)
    assert sfmcpp.solve(problem).final_cost * sigma_px**2 == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(("seed", "method"), [(14, "lm-nielsen"), (14, "lm"), (10, "dog-leg")])
def test_steps_are_not_measured_by_how_far_away_the_origin_is(seed: int, method: str) -> None:
    truth = sfmcpp.sphere_scene(6, 40, seed=seed)
    near = sfmcpp.perturb(truth, point_sigma_m=0.2, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=seed)
    away = near.copy()
    away.points += 1e8
    away.centres[:] += 1e8
    expected = sfmcpp.solve(near, method=method, loss="huber").final_cost
    found = sfmcpp.solve(away, method=method, loss="huber")
    assert found.termination == "converged"
    assert found.final_cost == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("method", ["lm", "lm-nielsen", "gauss-newton"])
def test_ordinary_problems_converge(method: str) -> None:
    assert sfmcpp.solve(scene(), method=method, function_tolerance=1e-12).termination == "converged"


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("method", ["lm", "lm-nielsen"])
def test_the_cost_told_is_that_of_the_state_where_points_lie_in_cameras(seed: int, method: str) -> None:
    metric = scene(seed=seed)
    problem = as_projective(metric)
    problem.points[:5] = np.column_stack([metric.centres[:5], np.ones(5)])
    summary = sfmcpp.solve(problem, method=method)
    assert summary.final_cost == pytest.approx(sfmcpp.cost(problem), rel=1e-9)


def test_points_seen_from_one_place_are_named() -> None:
    problem = scene()
    assert sfmcpp.solve(problem.copy()).warnings == sfmcpp.check(problem) == []
    problem.cameras[:, :, 3] = [0.0, 1.0, 2.0]
    told = "80 points (0, 1, 2, 3, 4, …): seen from one place, the depth is held by damping alone"
    assert told in sfmcpp.check(problem)
    assert told in sfmcpp.solve(problem).warnings


def test_nothing_holds_the_depths_of_points_that_are_fixed() -> None:
    problem = scene()
    problem.fixed_points[:] = True
    alone = problem.with_observations(problem.camera_index == 2)
    problem.cameras[:, :, 3] = [0.0, 1.0, 2.0]
    for known in (alone, problem):
        for warnings in (sfmcpp.check(known), sfmcpp.solve(known.copy()).warnings):
            assert not any("depth" in warning for warning in warnings)
    alone.fixed_points[3] = False
    assert "point 3: seen by one camera only, the depth is held by damping alone" in sfmcpp.check(alone)


def test_a_loss_of_a_group_whose_square_vanishes_is_refused() -> None:
    group = ConstraintGroup("position", [0], np.zeros((1, 3)), loss="cauchy", loss_scale=1e-320)
    with pytest.raises(InvalidArgument, match="must be positive and finite, and its square too"):
        sfmcpp.solve(scene(), constraints=[group])


def two_views_with_free_intrinsics() -> sfmcpp.Problem:
    """A problem that its data hardly tell: the cost lies in long valleys."""
    scene = sfmcpp.circle_scene(2, 30, camera_model="bal")
    return sfmcpp.perturb(scene, point_sigma_m=0.2, position_sigma_m=0.2, rotation_sigma_deg=1.0, seed=1)


@pytest.mark.parametrize("search", ["g-als", "exact", "soft", "backtracking"])
def test_a_step_that_a_line_search_saved_leaves_no_path_of_the_place_before(search: str) -> None:
    plain = sfmcpp.solve(two_views_with_free_intrinsics(), method="dog-leg", max_iterations=200)
    searched = sfmcpp.solve(
        two_views_with_free_intrinsics(), method="dog-leg", line_search=search, max_iterations=200
    )
    assert searched.final_cost < 1.3 * plain.final_cost


def test_a_long_step_that_gains_nothing_by_chance_is_no_convergence() -> None:
    start, tried = two_views_with_free_intrinsics(), {"loss": "cauchy", "loss_scale_px": 2.0, "method": "lm"}
    summary = sfmcpp.solve(start, **tried, line_search="g-als", max_iterations=200)
    best = sfmcpp.solve(two_views_with_free_intrinsics(), **tried, max_iterations=200).final_cost
    assert summary.final_cost < 1.1 * best


def test_a_point_without_an_image_is_named_where_the_cost_at_the_start_is_no_number() -> None:
    problem = scene()
    problem.points[7] = problem.centres[2]
    before = problem.copy()
    summary = sfmcpp.solve(problem)
    assert summary.termination == "numerical_failure"
    (row,) = np.flatnonzero((problem.point_index == 7) & (problem.camera_index == 2))
    assert [told for told in summary.warnings if "not a finite number" in told] == [
        "point 7: its squared residual is not a finite number in camera 2, "
        f"observation {row} (1 such observations)"
    ]
    np.testing.assert_array_equal(problem.points, before.points)


def test_a_pixel_that_is_none_is_named_and_no_other_warning_is_printed() -> None:
    problem = scene()
    problem.pixels[3] = 1e300
    summary = sfmcpp.solve(problem)
    assert summary.termination == "numerical_failure"
    assert any("observation 3 (1 such observations)" in told for told in summary.warnings)


@pytest.mark.parametrize("damping", [1e9, 1e20, 1e300, 1.7e308])
@pytest.mark.parametrize("method", ["lm", "lm-nielsen"])
def test_much_damping_at_the_start_is_no_convergence(method: str, damping: float) -> None:
    problem, best = scene(), sfmcpp.solve(scene()).final_cost
    summary = sfmcpp.solve(problem, method=method, initial_damping=damping, max_iterations=60)
    if summary.termination == "converged":
        assert summary.final_cost == pytest.approx(best, rel=1e-5)
    assert (summary.termination == "converged") == (damping == 1e9)


@pytest.mark.parametrize("radius", [1e-6, 1e-12, 1e-300])
def test_a_small_radius_at_the_start_is_no_convergence(radius: float) -> None:
    problem, best = scene(), sfmcpp.solve(scene()).final_cost
    summary = sfmcpp.solve(problem, method="dog-leg", initial_radius=radius, max_iterations=100)
    assert summary.termination != "converged" or summary.final_cost == pytest.approx(best, rel=1e-5)


def turned_at_one_place(unit: float, sigma_px: float) -> Problem:
    """Six cameras at one place look at points near and far; the start has them a little apart."""
    rng = np.random.default_rng(3)
    angles = np.linspace(-0.3, 0.3, 6)
    cameras = np.tile(np.eye(3, 4), (6, 1, 1))
    cameras[:, 0, 0] = cameras[:, 2, 2] = np.cos(angles)
    cameras[:, 0, 2], cameras[:, 2, 0] = np.sin(angles), -np.sin(angles)
    points = rng.uniform([-2, -2, 5], [2, 2, 20], (60, 3))
    intrinsics = np.tile([800.0, 1.0, 320.0, 240.0, 0.0], (6, 1))
    of_camera, of_point = (index.ravel().astype(np.int32) for index in np.indices((6, 60)))
    problem = Problem("calibrated", cameras, intrinsics, points, of_camera, of_point, np.zeros((360, 2)))
    problem.pixels -= sfmcpp.residuals(problem) + sigma_px * rng.standard_normal((360, 2))
    problem.centres[:] += 0.02 * rng.standard_normal((6, 3))
    problem.points += 0.05 * rng.standard_normal((60, 3))
    problem.centres[:] *= unit
    problem.points *= unit
    return problem


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("sigma_px", [0.1, 0.5, 1.0])
def test_images_from_one_place_do_not_converge_in_silence(unit: float, sigma_px: float) -> None:
    summary = sfmcpp.solve(turned_at_one_place(unit, sigma_px), max_iterations=100)
    assert any("have a parallax within the noise: the images do not tell" in w for w in summary.warnings)


def in_units_of_the_focal_length() -> Problem:
    """The σ of one pixel that is not given is wrong by the focal length: what is found counts."""
    problem = scene()
    problem.pixels -= problem.intrinsics[0, 2:4]
    problem.pixels /= problem.intrinsics[0, 0]
    problem.intrinsics[:, [0, 2, 3]] = [1.0, 0.0, 0.0]
    return problem


def test_a_baseline_is_told_from_none() -> None:
    healthy = (scene(), scene("perspective"), scene("bal"), in_units_of_the_focal_length())
    noisy = sfmcpp.corridor_scene(20, 400, pixel_sigma_px=2.0, seed=0)
    outliers, _ = sfmcpp.add_outliers(scene(), 0.2, seed=0)
    for problem in (*healthy, noisy, outliers):
        assert not any("parallax" in warning for warning in sfmcpp.solve(problem).warnings)
