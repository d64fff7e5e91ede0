"""Points that an image sees by several keypoints: COLMAP's tracks may hold that, observations may not.

SIFT gives one corner several orientations, and each becomes a keypoint. The first in the track is the
observation; the others become keypoints without a point, are remembered, and put back on writing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import Problem
from sfmcpp.model.metadata import KEYPOINTS, LOOSE, SECOND_SIGHTINGS
from sfmcpp.sources.io.checks import LARGEST_COUNT
from sfmcpp.sources.io.colmap.tables import Int64Array, rows_of_ids


def with_second_sightings(problem: Problem, point_ids: Int64Array) -> Problem:
    """The problem as COLMAP has it: every sighting an observation, the second ones last.

    A second sighting goes with the first: where that is no observation any more, or the point or the keypoint
    is gone, it is left out.
    """
    extra = problem.metadata.extra
    if any(name not in extra for name in (SECOND_SIGHTINGS, KEYPOINTS, *LOOSE)):
        return problem
    cameras, numbers, ids = np.asarray(extra[SECOND_SIGHTINGS]).T
    images, loose_numbers, pixels = (np.asarray(extra[name]) for name in LOOSE)
    rows = rows_of_ids(_pair_keys(images, loose_numbers), _pair_keys(cameras, numbers))
    points = rows_of_ids(point_ids, ids)
    observed = np.isin(_pair_keys(cameras, points), _pair_keys(problem.camera_index, problem.point_index))
    kept = (rows >= 0) & observed
    loose = np.delete(np.arange(len(images)), rows[kept])
    restored = {name: np.asarray(extra[name])[loose] for name in LOOSE}
    restored[KEYPOINTS] = np.concatenate([extra[KEYPOINTS], numbers[kept]])
    return replace(
        problem,
        camera_index=np.concatenate([problem.camera_index, cameras[kept]]),
        point_index=np.concatenate([problem.point_index, points[kept]]),
        pixels=np.concatenate([problem.pixels, pixels[rows[kept]]]),
        sigma_px=None,
        covariance_px2=None,
        metadata=replace(problem.metadata, extra=extra | restored),
    )


def _pair_keys(first: NDArray[Any], second: NDArray[Any]) -> Int64Array:
    """One number for each pair of numbers; a second of −1 is no other pair's."""
    return np.asarray(first.astype(np.int64) * (LARGEST_COUNT + 2) + second)
