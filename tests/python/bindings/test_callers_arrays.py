"""What callers do to their arrays, their threads and their signals does not reach into the core."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
import time
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import sfmcpp
from sfmcpp import ConstraintGroup, InvalidArgument, Problem, _core
from sfmcpp.ba.arrays import core_arrays
from sfmcpp.model.arrays import FloatArray
from sfmcpp.weighting import PoseConstraint, PoseView
from ticking import again_until, ticking

STRUCTURE = (
    "intrinsics_index",
    "camera_index",
    "point_index",
    "fixed_cameras",
    "fixed_points",
    "fixed_intrinsics",
)


def scene() -> Problem:
    truth = sfmcpp.circle_scene(6, 30, camera_model="perspective", seed=1)
    return sfmcpp.perturb(truth, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=2)


@pytest.mark.parametrize("name", STRUCTURE)
def test_structure_changed_by_a_callback_changes_nothing(name: str) -> None:
    calm, changed = scene(), scene()
    array = getattr(changed, name)
    expected = sfmcpp.solve(calm).final_cost
    found = sfmcpp.solve(changed, callback=lambda _: array.fill(2**30 if array.dtype == np.int32 else 1))
    assert found.final_cost == expected
    np.testing.assert_array_equal(changed.cameras, calm.cameras)


@pytest.mark.parametrize("name", ["pixels", "sigma_px", "cameras", "intrinsics", "points"])
def test_no_callback_resizes_what_the_core_reads_and_writes(name: str) -> None:
    problem = scene()
    problem.sigma_px = np.ones(problem.num_observations)
    array = getattr(problem, name)
    size = array.shape
    with pytest.raises(ValueError, match="cannot resize an array"):
        sfmcpp.solve(problem, callback=lambda _: array.resize((1, *size[1:]), refcheck=False))
    assert array.shape == size


FIELDS = [field.name for field in fields(Problem)]


@pytest.mark.parametrize("value", [None, 5, np.zeros(3), np.zeros((0, 2)), "x"])
@pytest.mark.parametrize("name", FIELDS)
def test_what_a_callback_assigns_to_fields_changes_nothing(name: str, value: object) -> None:
    calm, changed = scene(), scene()
    for problem in (calm, changed):
        problem.metadata.image_sizes = np.tile([[1000, 1000]], (6, 1))
    group = ConstraintGroup("position", np.arange(6), calm.centres, sigma=0.1)
    unknowns = changed.cameras, changed.intrinsics, changed.points

    def assign(_: object) -> None:
        setattr(changed, name, value)
        group.cameras = group.values = group.member_weights = None  # type: ignore[assignment]

    expected = sfmcpp.solve(calm, constraints=[replace(group)], loss="huber")
    found = sfmcpp.solve(changed, constraints=[group], loss="huber", callback=assign)
    assert found.final_cost == expected.final_cost
    assert found.warnings == expected.warnings
    for array, wanted in zip(unknowns, (calm.cameras, calm.intrinsics, calm.points), strict=True):
        np.testing.assert_array_equal(array, wanted)


@pytest.mark.parametrize("name", FIELDS)
def test_a_linear_model_heeds_nothing_that_is_assigned_later(name: str) -> None:
    problem = scene()
    model = sfmcpp.linearize(problem)
    expected, told = model.step().problem, repr(model)
    setattr(problem, name, None)
    np.testing.assert_array_equal(model.step().problem.cameras, expected.cameras)
    assert (repr(model), len(model.parameter_names)) == (told, model.camera_columns.shape[1])


def test_indices_changed_by_another_thread_end_in_nothing_worse_than_an_error() -> None:
    problem, over = scene(), threading.Event()
    kept = problem.point_index.copy()

    def disturb() -> None:
        while not over.is_set():
            problem.point_index[:] = 2**30
            problem.point_index[:] = kept

    thread = threading.Thread(target=disturb)
    thread.start()
    outcomes = set()
    for _ in range(200):
        try:
            outcomes.add(sfmcpp.solve(problem, max_iterations=1).termination)
        except InvalidArgument as error:
            outcomes.add(str(error).split("[")[0])
    over.set()
    thread.join()
    assert outcomes <= {"max_iterations", "converged", "point_index"}


def sweep_of_many_folds() -> tuple[dict[str, Any], list[dict[str, Any]], FloatArray]:
    """View, constraint and start of a sweep that takes a second: weights × observations folds."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-1.0, 1.0, (250, 3)) + np.array([0.0, 0.0, 5.0])
    pixels = 500.0 * points[:, :2] / points[:, 2:] + rng.normal(size=(250, 2))
    view = PoseView(points, pixels, np.array([500.0, 1.0, 0.0, 0.0, 0.0]))
    constraint = PoseConstraint("smoothing-reprojections", previous=np.eye(3, 4), points=points[:50].copy())
    return view.arrays(), [constraint.arrays(0.0)], np.eye(3, 4)


def test_arrays_of_a_sweep_are_held_and_keep_their_sizes_until_it_ends() -> None:
    weights, options = np.geomspace(1e-2, 1e2, 40).tolist(), _core.PoseSweepOptions()
    view, constraints, start = sweep_of_many_folds()
    expected = _core.sweep_pose_weights(view, constraints, 0, weights, start, options)
    arrays = [(view, "points"), (view, "pixels"), (view, "intrinsics"), (constraints[0], "points")]
    begun, refused = threading.Event(), []

    def disturb() -> None:
        begun.wait()
        for array in [start, *(values[name] for values, name in arrays)]:
            try:
                array.resize(3, refcheck=False)
            except ValueError as error:
                refused.append(str(error))
        view.clear()
        constraints[0].clear()

    interval = sys.getswitchinterval()
    thread = threading.Thread(target=disturb)
    thread.start()
    sys.setswitchinterval(60.0)  # the other thread gets the GIL where the sweep releases it, and no earlier
    try:
        begun.set()
        found = _core.sweep_pose_weights(view, constraints, 0, weights, start, options)
    finally:
        sys.setswitchinterval(interval)
    thread.join()
    assert len(refused) == 1 + len(arrays)
    assert not view
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values)


def test_a_linear_model_outlives_the_arrays_it_was_made_of() -> None:
    problem = scene()
    model = sfmcpp.linearize(problem)
    expected = model.step().problem.cameras
    problem.intrinsics_index[:] = 2**30
    problem.intrinsics_index = np.zeros(6, dtype=np.int32)
    np.testing.assert_array_equal(model.step().problem.cameras, expected)


@pytest.mark.parametrize("name", ["cameras", "intrinsics", "points"])
def test_what_cannot_be_written_is_refused_before_the_solve(name: str) -> None:
    problem, steps = scene(), []
    before = problem.cameras.copy()
    getattr(problem, name).flags.writeable = False
    with pytest.raises(InvalidArgument, match=f"{name}: must be writeable"):
        sfmcpp.solve(problem, callback=steps.append)
    assert not steps
    np.testing.assert_array_equal(problem.cameras, before)


OTHER_SHAPES = {
    "transposed": lambda a: np.ascontiguousarray(a.T),
    "flat": lambda a: a.reshape(-1),
    "one more": lambda a: a[..., None],
}


@pytest.mark.parametrize("change", OTHER_SHAPES)
@pytest.mark.parametrize("name", ["cameras", "intrinsics", "points", "pixels", "fixed_intrinsics"])
def test_an_array_of_the_right_size_and_another_shape_is_refused(name: str, change: str) -> None:
    problem = scene()
    setattr(problem, name, OTHER_SHAPES[change](getattr(problem, name)))
    wrong = re.escape(f"{name}: shape {getattr(problem, name).shape}, must be")
    for call in (sfmcpp.solve, sfmcpp.check, sfmcpp.linearize, sfmcpp.residuals):
        with pytest.raises(InvalidArgument, match=wrong):
            call(problem)


def test_sensors_of_rigs_of_another_shape_are_refused() -> None:
    problem = scene()
    problem.rigs = sfmcpp.Rigs(np.eye(3, 4)[None], np.arange(6), np.zeros(6, int))
    sfmcpp.check(problem)
    problem.rigs.sensors = np.ascontiguousarray(problem.rigs.sensors.T)
    with pytest.raises(InvalidArgument, match=r"rigs.sensors: shape \(4, 3, 1\), must be \(any, 3, 4\)"):
        sfmcpp.solve(problem)


AT_EXIT = """
import sys, threading, time, sfmcpp
problem, begun = sfmcpp.circle_scene(6, 300, seed=1), threading.Event()
def work():
    while True:
        begun.set()
        {call}
for _ in range(2):
    threading.Thread(target=work, daemon=True).start()
begun.wait()
time.sleep(0.05)
sys.exit(7)
"""


@pytest.mark.parametrize(
    "call",
    [
        "sfmcpp.solve(problem.copy())",
        "sfmcpp.solve(problem.copy(), callback=lambda _: time.sleep(0.001))",
        "sfmcpp.linearize(problem)",
    ],
)
def test_a_daemon_thread_that_solves_does_not_change_the_exit_code(tmp_path: Path, call: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", AT_EXIT.format(call=call)], cwd=tmp_path, capture_output=True, check=False
    )
    assert (done.returncode, done.stderr) == (7, b"")


def test_threads_that_solve_at_once_find_the_same_bits() -> None:
    problems = [scene() for _ in range(4)]
    for problem in problems[1:]:
        problem.point_index = problems[0].point_index  # what is only read may be shared
    solve = partial(sfmcpp.solve, threads=2, callback=lambda _: time.sleep(0), loss="huber")
    threads = [threading.Thread(target=solve, args=(problem,)) for problem in problems]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for problem in problems[1:]:
        np.testing.assert_array_equal(problem.points, problems[0].points)


def test_other_threads_go_on_while_jacobians_are_checked() -> None:
    problem = sfmcpp.circle_scene(20, 2000, seed=1)
    arrays = core_arrays(problem)
    with ticking() as count:

        def counts_while_it_checks() -> bool:
            before = count()
            _core.check_jacobians(arrays, problem.num_observations)
            return count() > before

        assert again_until(counts_while_it_checks)


def _anywhere(array: NDArray[Any]) -> NDArray[Any]:
    """The same numbers one byte behind where the core would read them."""
    return np.frombuffer(b"x" + array.tobytes(), array.dtype, offset=1).reshape(array.shape)


@pytest.mark.parametrize("name", ["pixels", "sigma_px", "cameras", "intrinsics", "points", "camera_index"])
def test_numbers_of_packed_bytes_are_taken_and_stored_where_the_core_reads_them(name: str) -> None:
    calm = replace(scene(), sigma_px=np.full(scene().num_observations, 2.0))
    packed = replace(calm.copy(), **{name: _anywhere(getattr(calm, name))})
    assert getattr(packed, name).flags.aligned
    assert sfmcpp.solve(packed).final_cost == sfmcpp.solve(calm).final_cost


def test_numbers_of_packed_bytes_are_refused_where_a_solve_would_write_them() -> None:
    problem = scene()
    problem.points = np.frombuffer(bytearray(b"x" + problem.points.tobytes()), offset=1).reshape(-1, 3)
    with pytest.raises(InvalidArgument, match="points: must be aligned in memory"):
        sfmcpp.solve(problem)


@pytest.mark.parametrize("name", ["camera_index", "point_index", "intrinsics_index"])
def test_indices_assigned_as_a_list_keep_the_summary(name: str) -> None:
    calm, listed = scene(), scene()
    setattr(listed, name, list(getattr(calm, name)))
    assert sfmcpp.solve(listed).final_cost == sfmcpp.solve(calm).final_cost


def test_another_thread_that_loads_a_part_of_the_package_is_waited_for_by_a_fork() -> None:
    code = """
import os, signal, sys, threading
import sfmcpp
begun, go_on = threading.Event(), threading.Event()
class Slow:
    def find_spec(self, name, path=None, target=None):
        if name == "sfmcpp.doctor":
            begun.set()
            go_on.wait()
sys.meta_path.insert(0, Slow())
threading.Thread(target=lambda: sfmcpp.diagnose).start()
begun.wait()
threading.Timer(0.3, go_on.set).start()
child = os.fork()
if child == 0:
    signal.alarm(30)
    sfmcpp.diagnose
    os._exit(0)
sys.exit(os.waitpid(child, 0)[1])
"""
    assert subprocess.run([sys.executable, "-c", code], timeout=120, check=False).returncode == 0
