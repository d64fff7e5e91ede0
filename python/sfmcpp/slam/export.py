"""The whole map as a bundle adjustment problem, for files and for a final adjustment."""

from __future__ import annotations

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.slam.world_map import WorldMap

_FEWEST_VIEWS = 2


def problem_of(world: WorldMap) -> Problem:
    """Make the problem of all keyframes and of all points that two or more of them see.

    Parameters
    ----------
    world : WorldMap
        The map; it is not changed.

    Returns
    -------
    Problem
        Cameras are the keyframes in their order, points are ordered by track; one row of intrinsics for all.
        The images are named by their frames. No camera is fixed.
    """
    whole = world.whole().problem
    views = np.bincount(whole.point_index, minlength=whole.num_points)
    kept = views >= _FEWEST_VIEWS
    observed = kept[whole.point_index]
    new_index = np.cumsum(kept) - 1
    problem = Problem(
        whole.camera_model,
        whole.cameras,
        whole.intrinsics,
        whole.points[kept],
        whole.camera_index[observed],
        new_index[whole.point_index[observed]].astype(np.int32),
        whole.pixels[observed],
        intrinsics_index=whole.intrinsics_index,
    )
    problem.metadata.image_names = [f"frame_{keyframe.frame:06d}" for keyframe in world.keyframes]
    return problem
