"""Loop closing: observations lost to drift are restored and adjusted.

The observations that tie both ends of a loop are left out as outliers when the loop comes round. They are
known by their number: one pair of images does not lose many matches, which agreed with an epipolar geometry,
to chance.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.map import Map
from sfmcpp.sfm.map_backup import MapBackup, undone_by_an_error
from sfmcpp.sfm.scene import USUAL_SIGMA_PX
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.sfm.stops import heed_stop
from sfmcpp.sfm.structure import Numbers, Structure
from sfmcpp.weighting import solve

# The robust loss lets go of nothing that a drift explains: its scale falls as the loop closes [px].
_LOSS_SCALES_PX = (64.0, 16.0, 4.0)
_STEPS = 25
# Part of the torn observations that must fit afterwards.
_LEAST_FITTING_SHARE = 0.5


def close_loops(structure: Structure, settings: IncrementalSettings) -> bool:
    """Adjust the model with all observations that pairs of images have lost together; whether they fit then.

    Otherwise the model is as it was, and these observations are not tried again before others join them.
    """
    world = structure.world
    rows = lost_common_observations(structure, settings.min_inliers)
    if np.count_nonzero(~structure.given_up[rows]) < settings.min_inliers:
        return False
    before = MapBackup.of(world)
    with undone_by_an_error([world]):
        structure.observe(rows, structure.tracks[rows])
        for scale_px in _LOSS_SCALES_PX:
            _adjust(world, scale_px)
    points = world.keypoint_points[rows]
    fits = (points >= 0) & (structure.errors_px(rows, structure.tracks[rows]) <= settings.outlier_px)
    if np.count_nonzero(fits) < _LEAST_FITTING_SHARE * len(rows):
        before.restore(world)
        structure.given_up[rows] = True
        return False
    return True


def lost_common_observations(structure: Structure, least: int) -> Numbers:
    """Keypoints whose track has a point that they do not see, where two images share `least` such tracks."""
    world = structure.world
    torn = (structure.tracks >= 0) & (world.keypoint_points < 0)
    rows = np.flatnonzero(torn & world.registered[world.keypoint_images])
    rows = rows[world.known[structure.tracks[rows]]]
    # Where tracks were merged, an image may see a point by another keypoint.
    rows = rows[~structure.sees_already(rows, structure.tracks[rows])]
    seen_by, places = world.observations_with_places(structure.tracks[rows])
    posed = world.registered[world.keypoint_images[seen_by]]
    seen_by, places = seen_by[posed], places[posed]
    images = world.keypoint_images[[rows[places], seen_by]].astype(np.int64)
    key = images[0] * world.num_images + images[1]
    _, pair, counts = np.unique(key, return_inverse=True, return_counts=True)
    wanted = np.zeros(len(rows), dtype=np.bool_)
    wanted[places[counts[pair] >= least]] = True
    return np.asarray(rows[wanted])


def _adjust(world: Map, scale_px: float) -> None:
    local = world.whole_problem(2)
    local.problem.fixed_intrinsics[:] = True
    solve(
        local.problem,
        loss="huber",
        loss_scale_px=scale_px / USUAL_SIGMA_PX,
        max_iterations=_STEPS,
        function_tolerance=1e-4,
        callback=heed_stop,
    ).require_uninterrupted()
    world.take(local)
