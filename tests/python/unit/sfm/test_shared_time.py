"""A time limit holds for all solves of a georeferencing, of control points, of a choice of weights."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
import pytest

import sfmcpp
from flights import flight, in_a_frame_of_its_own
from sfmcpp.ba import Summary, adjust, time_limit
from sfmcpp.ba.time_limit import TimeLimit
from sfmcpp.model import ConstraintGroup
from sfmcpp.sfm import georeference
from test_control_points import fit_control_points, scene

PLACES = np.array([[12.0 * step, 15.0 * row] for row in (0, 1) for step in range(5)])


@pytest.fixture
def limits(monkeypatch: pytest.MonkeyPatch) -> list[float | None]:
    """The time limits of all solves, on a clock by which each takes a second."""
    clock: list[float] = [0.0]
    told: list[float | None] = []

    def timed(problem: Any, groups: Any, options: Any, *more: Any) -> Summary:
        told.append(options.max_seconds)
        clock[0] += 1.0
        options = sfmcpp.SolveOptions.from_dict({**options.to_dict(), "max_seconds": None})
        return adjust(problem, groups, options, *more)

    monkeypatch.setattr(time_limit.time, "monotonic", lambda: clock[0])
    for user in ("solve", "fits"):
        monkeypatch.setattr(import_module(f"sfmcpp.weighting.{user}"), "adjust", timed)
    return told


def test_what_is_left_falls_to_nearly_nothing(limits: list[float | None]) -> None:
    assert TimeLimit(None).of({"loss": "huber"}) == {"loss": "huber"}
    limit = TimeLimit(1.5)
    assert limit.of({"loss": "huber", "max_seconds": 7.0}) == {"loss": "huber", "max_seconds": 1.5}
    assert not limit.is_over
    for _ in range(2):
        sfmcpp.solve(sfmcpp.circle_scene(4, 30, seed=0))
    assert limit.is_over
    assert 0 < limit.of({})["max_seconds"] < 0.01
    assert limits == [None, None]


def test_georeferencing(limits: list[float | None]) -> None:
    truth = flight(PLACES, seed=3)
    positions = truth.centres + np.random.default_rng(3).normal(0, 0.3, truth.centres.shape)
    georeference(in_a_frame_of_its_own(truth, 3), positions, max_seconds=100.0)
    assert len(limits) >= 3
    assert limits == [100.0 - k for k in range(len(limits))]


def test_georeferencing_ends_when_time_is_up(limits: list[float | None]) -> None:
    truth = flight(PLACES, seed=3)
    positions = truth.centres + np.random.default_rng(3).normal(0, 0.3, truth.centres.shape)
    positions[4] += [30, 0, 0]
    georeference(in_a_frame_of_its_own(truth, 3), positions, max_seconds=1.5)
    after = limits[2:]
    assert max(x for x in after if x is not None) < 0.01


def test_control_points(limits: list[float | None]) -> None:
    _, model, control = scene()
    fit_control_points(model, control, max_seconds=5.0)
    assert limits == [5.0, 4.0]


def test_weights_and_the_solve_after_them(limits: list[float | None]) -> None:
    truth = sfmcpp.circle_scene(12, 60, pixel_sigma_px=0.5, seed=0)
    gps = truth.centres + np.random.default_rng(0).normal(0, 0.05, truth.centres.shape)
    group = ConstraintGroup("position", np.arange(12), gps, name="gps")
    sfmcpp.solve(truth, constraints=[group], weight="auto", max_seconds=100.0)
    assert len(limits) > 1
    assert limits == [100.0 - k for k in range(len(limits))]
