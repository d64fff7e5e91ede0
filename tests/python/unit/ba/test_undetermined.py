"""A linear model that has no inverse names the cameras that nothing determines."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import sfmcpp

ASKED: list[Callable[[sfmcpp.LinearModel], Any]] = [
    lambda model: model.covariance(cameras="all"),
    lambda model: model.covariance(cameras=[1], joint=True),
    lambda model: model.leverages(),
    lambda model: model.num_determined,
    lambda model: model.step(),
]


def with_few(observations: int, *cameras: int, **options: Any) -> sfmcpp.Problem:
    """A circle whose `cameras` see so many points."""
    problem = sfmcpp.circle_scene(6, 60, pixel_sigma_px=1.0, seed=0, **options)
    kept = np.ones(problem.num_observations, dtype=bool)
    for camera in cameras:
        kept[np.flatnonzero(problem.camera_index == camera)[observations:]] = False
    return problem.with_observations(kept)


@pytest.mark.parametrize("ask", ASKED)
def test_cameras_with_too_few_observations_are_named(ask: Callable[[sfmcpp.LinearModel], Any]) -> None:
    with pytest.raises(sfmcpp.InvalidArgument, match="; camera 4 would be undetermined"):
        ask(sfmcpp.linearize(with_few(2, 4)))
    with pytest.raises(sfmcpp.InvalidArgument, match="; cameras 2, 4 would be undetermined"):
        ask(sfmcpp.linearize(with_few(1, 2, 4)))


@pytest.mark.parametrize("camera", [0, 1, 2, 4, 5])
def test_a_camera_that_rounding_alone_determines_is_named(camera: int) -> None:
    """Rounding decides whether there is a factor, and then which parameters it loses.

    With SSE2 it loses some of camera 1 first where camera 3 is the one.
    """
    problem = with_few(4, camera, camera_model="perspective").set_free_intrinsics("f", "k1", "k2")
    named = rf"^camera {camera}, \w+ ?\w*: not determined by|; camera {camera} would be undetermined"
    with pytest.raises(sfmcpp.InvalidArgument, match=named):
        sfmcpp.linearize(problem).covariance(cameras="all")


def test_cameras_that_are_determined_are_not_named() -> None:
    assert np.isfinite(sfmcpp.linearize(with_few(3, 4)).covariance(cameras="all").cameras).all()
    with pytest.raises(sfmcpp.InvalidArgument, match=r"cameras: 7, must be in \[0, 6\)"):
        sfmcpp.linearize(with_few(1, 4)).covariance(cameras=[7])
