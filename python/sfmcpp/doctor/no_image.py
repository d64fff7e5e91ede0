"""Observations of points that have no image in their camera; all other checks need them removed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sfmcpp.ba.check import observations_without_image
from sfmcpp.doctor.finding import Finding, counted, named, numbers
from sfmcpp.model import Problem


def no_image(problem: Problem) -> Iterator[Finding]:
    """Find points at the centre or at depth zero of a camera that observes them."""
    rows = observations_without_image(problem)
    if len(rows):
        points = np.unique(problem.point_index[rows])
        yield Finding(
            "no-image",
            "error",
            f"{counted(len(rows), 'observation')} of a point at the camera centre or at depth zero: the cost "
            "is undefined",
            "use --fix to drop them, or triangulate these points again",
            named("point", numbers(points)),
            points=numbers(points),
            observations=numbers(rows),
        )
