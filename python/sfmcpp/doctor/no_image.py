"""Observations of points that have no image in their camera: with them nothing else can be judged."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sfmcpp.ba.check import observations_without_image
from sfmcpp.doctor.finding import Finding, counted, named, numbers
from sfmcpp.model import Problem


def no_image(problem: Problem) -> Iterator[Finding]:
    """Find points in the centre of a camera that observes them, or beside it."""
    rows = observations_without_image(problem)
    if len(rows):
        points = np.unique(problem.point_index[rows])
        yield Finding(
            "no-image",
            "error",
            f"{counted(len(rows), 'observation')} of a point in the centre of the camera, or at depth zero",
            "--fix drops them; or triangulate these points anew: a solve has no cost to start from",
            named("point", numbers(points)),
            points=numbers(points),
            observations=numbers(rows),
        )
