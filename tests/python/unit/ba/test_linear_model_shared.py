"""A linear model that several threads ask at once, that pickle is given, or that is one of nothing."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from conftest import TIMEOUT_S

import sfmcpp
from sfmcpp import InvalidArgument

# In a process of their own, which may crash.
MADE = """
import copy, pickle, threading
import numpy as np
import sfmcpp
scene = sfmcpp.circle_scene(20, 1000, seed=1)
make = lambda: sfmcpp.linearize(scene, threads=2)
"""
THREADS = """
asked = [lambda m: m.leverages(), lambda m: m.covariance(cameras=[0]).cameras, lambda m: m.log_determinant]
expected = [ask(make()) for ask in asked]
for _ in range(5):
    model, found = make(), {}
    def answer(k):
        found[k] = asked[k % 3](model)
    threads = [threading.Thread(target=answer, args=(k,)) for k in range(6)]
    for thread in threads: thread.start()
    for thread in threads: thread.join()
    for k in range(6):  # what is known already when one is asked changes the last digits
        size = np.abs(expected[k % 3]).max()
        np.testing.assert_allclose(found[k], expected[k % 3], rtol=1e-6, atol=1e-6 * size)
"""
PICKLE = """
for way in [copy.deepcopy, *(lambda m, k=k: pickle.dumps(m, k) for k in range(6))]:
    try:
        way(make())
    except TypeError as error:
        assert "linearize the problem anew" in str(error), error
    else:
        raise AssertionError("not refused")
"""


@pytest.mark.parametrize("script", [THREADS, PICKLE], ids=["threads", "pickle"])
def test_no_process_is_lost(script: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", MADE + script], capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("way", [sfmcpp.linearize, lambda p: sfmcpp.solve(p, gauge="fixed"), sfmcpp.diagnose])
@pytest.mark.parametrize("points", [0, 3])
def test_problems_without_cameras_are_refused(way: Callable[[sfmcpp.Problem], object], points: int) -> None:
    nothing = np.zeros(0, np.int32)
    problem = sfmcpp.Problem(
        "calibrated",
        np.zeros((0, 3, 4)),
        np.zeros((0, 5)),
        np.ones((points, 3)),
        nothing,
        nothing,
        np.zeros((0, 2)),
    )
    problem.fixed_points[:] = True
    if way is sfmcpp.diagnose:
        assert str(way(problem))
        return
    with pytest.raises(InvalidArgument, match="there are none"):
        way(problem)


def test_the_bits_do_not_depend_on_what_was_asked_before() -> None:
    scene = sfmcpp.circle_scene(5, 30, seed=1)
    group = sfmcpp.ConstraintGroup("position", [1, 2, 3], scene.centres[[1, 2, 3]], 10.0)
    fresh, asked = (sfmcpp.linearize(scene, constraints=[group]) for _ in range(2))
    asked.leverages()
    asked.covariance()
    for ask in (
        lambda model: model.covariance(cameras=[1], points=[2], joint=True).joint,
        lambda model: model.hat_matrix(0),
    ):
        np.testing.assert_array_equal(ask(fresh), ask(asked))
