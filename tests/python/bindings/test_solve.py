"""The solve as Python sees it, against NumPy and SciPy."""

from __future__ import annotations

import os
import signal
import threading
import time
from xml.etree import ElementTree

import numpy as np
import pytest

import sfmcpp
from projection import minimum_by_scipy, reference_residuals
from sfmcpp import InvalidArgument, Metadata, Problem
from ticking import again_until, ticking

MODELS = ("calibrated", "perspective", "bal")


def scene(camera_model: str = "calibrated", cameras: int = 6, points: int = 30, seed: int = 1) -> Problem:
    truth = sfmcpp.circle_scene(cameras, points, camera_model=camera_model, seed=seed)
    return sfmcpp.perturb(
        truth, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=seed + 1
    )


def arrays_of(problem: Problem) -> tuple[np.ndarray, ...]:
    return problem.cameras.copy(), problem.intrinsics.copy(), problem.points.copy()


@pytest.mark.parametrize("model", MODELS)
def test_residuals_equal_an_independent_projection(model: str) -> None:
    problem = scene(model)
    rng = np.random.default_rng(3)
    problem.sigma_px = rng.uniform(0.5, 2.0, problem.num_observations)
    if model != "calibrated":
        names = problem.intrinsic_names
        distortion = [names.index(n) for n in names if n[0] in "kp"]
        problem.intrinsics[:, distortion] = rng.normal(0, 0.05, (problem.num_cameras, len(distortion)))
    np.testing.assert_allclose(
        sfmcpp.residuals(problem), reference_residuals(problem), rtol=1e-12, atol=1e-10
    )


def test_minimum_equals_that_of_scipy() -> None:
    problem = scene()
    expected = minimum_by_scipy(problem, reference_residuals)
    summary = sfmcpp.solve(problem, function_tolerance=1e-12)
    assert summary.converged
    assert summary.final_cost == pytest.approx(expected, rel=1e-8)
    assert summary.final_cost == pytest.approx(0.5 * np.sum(reference_residuals(problem) ** 2), rel=1e-12)


@pytest.mark.parametrize("linear_solver", ["dense", "sparse", "iterative"])
def test_result_has_the_same_bits_for_every_number_of_threads(linear_solver: str) -> None:
    results = []
    for threads in (1, 2, 3, 2):
        problem = scene("bal", cameras=12, points=300)
        sfmcpp.solve(problem, threads=threads, linear_solver=linear_solver, max_iterations=8)
        results.append(arrays_of(problem))
    for other in results[1:]:
        for a, b in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(a, b)


def test_other_threads_run_while_it_solves() -> None:
    with ticking() as count:

        def counts_while_it_solves() -> bool:
            counts: list[int] = []
            sfmcpp.solve(
                scene(cameras=40, points=2000), callback=lambda _: counts.append(count()), max_iterations=20
            )
            return counts[-1] > counts[0]

        assert again_until(counts_while_it_solves)


def test_callback_sees_every_iteration_and_can_stop() -> None:
    seen: list[sfmcpp.Iteration] = []

    def stop_after_three(iteration: sfmcpp.Iteration) -> bool | None:
        seen.append(iteration)
        return False if iteration.iteration == 3 else None

    summary = sfmcpp.solve(scene(), callback=stop_after_three, function_tolerance=0.0)
    assert summary.termination == "stopped_by_callback"
    assert seen == summary.iterations
    assert [i.iteration for i in seen] == [0, 1, 2, 3]


@pytest.mark.parametrize("answer", [np.False_, np.True_, 0, [], "stop"])
def test_no_answer_but_false_stops(answer: object) -> None:
    summary = sfmcpp.solve(scene(), callback=lambda _: answer, max_iterations=2)  # type: ignore[arg-type,return-value]
    assert summary.termination == ("stopped_by_callback" if answer is np.False_ else "max_iterations")


def test_exception_of_the_callback_is_raised_and_the_best_state_is_kept() -> None:
    problem = scene()
    start = sfmcpp.cost(problem)

    def fail(iteration: sfmcpp.Iteration) -> None:
        if iteration.iteration == 2:
            raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        sfmcpp.solve(problem, callback=fail)
    assert sfmcpp.cost(problem) < 0.1 * start


def test_interrupt_returns_the_best_state() -> None:
    problem = scene()

    def press_ctrl_c(iteration: sfmcpp.Iteration) -> None:
        if iteration.iteration == 2:
            os.kill(os.getpid(), signal.SIGINT)

    start = sfmcpp.cost(problem)
    summary = sfmcpp.solve(problem, callback=press_ctrl_c, function_tolerance=0.0)
    assert summary.termination == "interrupted"
    with pytest.raises(KeyboardInterrupt):
        summary.require_uninterrupted()
    assert summary.final_cost == pytest.approx(sfmcpp.cost(problem), rel=1e-12)
    assert summary.final_cost < 0.1 * start


def test_interrupt_ends_a_step_that_takes_seconds() -> None:
    problem = scene("bal", 500, 300)
    start = arrays_of(problem)
    pressed_s = []

    def press_ctrl_c() -> None:
        pressed_s.append(time.process_time())
        os.kill(os.getpid(), signal.SIGINT)

    def let_the_first_step_begin(iteration: sfmcpp.Iteration) -> None:
        threading.Timer(0.1, press_ctrl_c).start()

    summary = sfmcpp.solve(problem, linear_solver="dense", callback=let_the_first_step_begin, threads=1)
    # Of work, not by the clock: other programs may use the processor meanwhile.
    assert time.process_time() - pressed_s[0] < 1.0
    assert summary.termination == "interrupted"
    assert len(summary.iterations) == 1
    for before, after in zip(start, arrays_of(problem), strict=True):
        np.testing.assert_array_equal(after, before)


def test_time_limit_returns_the_best_state() -> None:
    problem = scene(cameras=40, points=2000)
    summary = sfmcpp.solve(problem, max_seconds=1e-9)
    assert summary.termination == "max_seconds"
    assert summary.final_cost == pytest.approx(sfmcpp.cost(problem), rel=1e-12)


def test_broken_contract_leaves_the_problem_untouched() -> None:
    problem = scene()
    problem.point_index[5] = problem.num_points
    before = arrays_of(problem)
    with pytest.raises(InvalidArgument, match=r"point_index\[5\] = 30: must be in \[0, 30\)"):
        sfmcpp.solve(problem)
    for a, b in zip(before, arrays_of(problem), strict=True):
        np.testing.assert_array_equal(a, b)


def test_shared_intrinsics_stay_shared_and_find_the_focal_length() -> None:
    truth = sfmcpp.circle_scene(8, 80, camera_model="perspective", seed=4, pixel_sigma_px=0.1)
    start = sfmcpp.perturb(truth, point_sigma_m=0.05, position_sigma_m=0.05, rotation_sigma_deg=0.5, seed=5)
    problem = Problem(
        "perspective",
        start.cameras,
        start.intrinsics[:1] * 1.0,
        start.points,
        start.camera_index,
        start.point_index,
        start.pixels,
        intrinsics_index=np.zeros(8, dtype=np.int32),
    )
    problem.intrinsics[0, 0] *= 1.05
    summary = sfmcpp.solve(problem, max_iterations=100)
    assert summary.converged
    assert problem.intrinsics[0, 0] == pytest.approx(truth.intrinsics[0, 0], rel=5e-3)
    np.testing.assert_array_equal(problem.intrinsics[0, 1:], start.intrinsics[0, 1:])


def test_jacobian_check_finds_nothing_wrong() -> None:
    for model in MODELS:
        report = sfmcpp.check_jacobians(scene(model))
        assert report.entries > 1000
        assert report.worst_error < 1e-6


def test_check_names_what_is_isolated() -> None:
    problem = scene()
    keep = (problem.camera_index != 2) & (problem.point_index != 7)
    problem.camera_index = problem.camera_index[keep]
    problem.point_index = problem.point_index[keep]
    problem.pixels = np.ascontiguousarray(problem.pixels[keep])
    warnings = sfmcpp.check(problem)
    assert any(w.startswith("camera 2: no observations") for w in warnings)
    assert any(w.startswith("point 7: no observations") for w in warnings)
    before = problem.copy()
    summary = sfmcpp.solve(problem)
    assert warnings[0] in summary.warnings
    np.testing.assert_array_equal(problem.cameras[2], before.cameras[2])
    np.testing.assert_array_equal(problem.points[7], before.points[7])


def test_the_history_is_a_table_of_columns_and_prints_stay_short() -> None:
    problem = sfmcpp.circle_scene(6, 40, seed=3)
    problem.metadata.image_names = [f"{k}.png" for k in range(6)]
    problem.metadata.image_sizes = np.full((6, 2), 640)
    summary = sfmcpp.solve(sfmcpp.perturb(problem, seed=4), line_search="t-als")
    history = summary.history()
    assert {column.shape for column in history.values()} == {(len(summary.iterations),)}
    lengths = list(zip(history["step_length_camera"], history["step_length_point"], strict=True))
    assert lengths == [i.step_lengths for i in summary.iterations]
    pandas = pytest.importorskip("pandas")
    assert len(pandas.DataFrame(history)) == len(summary.iterations)
    for thing in (summary, summary.iterations[-1], problem.metadata, problem):
        assert len(repr(thing)) < 200
        assert "array(" not in repr(thing)
    assert repr(problem.metadata) == "Metadata(6 image_names; 6 image_sizes)"
    assert repr(Metadata()) == "Metadata()"


def test_a_problem_draws_itself_as_a_table_in_notebooks() -> None:
    problem = sfmcpp.circle_scene(4, 10, camera_model="bal", seed=0)
    problem.metadata.source_format = "<script>"
    (table,) = ElementTree.fromstring(f"<page>{problem._repr_html_()}</page>")
    rows = {row[0].text: row[1].text for row in table}
    assert rows["camera model"] == "bal"
    assert (rows["cameras"], rows["points"]) == ("4", "10")
    assert rows["intrinsics"] == "4 of f, k1, k2"
    assert rows["observations"] == str(problem.num_observations)
    assert rows["read from"] == "<script>"


def test_a_summary_draws_itself_as_a_table_in_notebooks() -> None:
    problem = sfmcpp.circle_scene(4, 10, seed=0)
    centres = problem.centres.copy()
    gps = sfmcpp.ConstraintGroup("position", [0, 1, 2, 3], centres, name="<script>")
    summary = sfmcpp.solve(problem, constraints=[gps])
    (table,) = ElementTree.fromstring(f"<page>{summary._repr_html_()}</page>")
    rows = {row[0].text: row[1].text for row in table}
    assert rows.keys() >= {"cost", "cost of '<script>'", "RMS [px]", "termination"}
    assert rows["termination"] == f"{summary.termination}: {summary.message}"
    lengths = {len(column) for column in summary.history().values()}
    assert lengths == {len(summary.iterations)}  # columns of one length, as a data frame takes them
