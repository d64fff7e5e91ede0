"""Localisation: pose of a frame from the points of the map."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sfmcpp.geometry import resection, resection_of_rotation
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import View
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import WorldMap

# Few tracks often fit two poses: one whose rotation differs by more from a gyroscope's is the wrong one.
SAME_TURN_RAD = float(np.radians(1.0))
# With less parallax images do not distinguish a motion from a rotation on the spot [px].
LEAST_PARALLAX_PX = 0.3
# Samples that RANSAC draws at most for the pose of one frame.
RANSAC_ITERATIONS = 1000
# Images support a gyroscope's rotation if its pose has this share of the inliers of their best pose, or of
# half the points where that has fewer.
_SUPPORT = 0.9
_LEAST_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Located:
    """Pose (3, 4) of a view, world_from_camera, and that by the images alone; None where these give none."""

    pose: FloatArray
    seen: FloatArray | None


def locate(
    world: WorldMap, view: View, settings: SlamSettings, rotation: FloatArray | None = None
) -> Located | None:
    """Pose of a view by resection from the points of the map; None if too few points agree on one.

    The `rotation` (3, 3) by a gyroscope, world_from_camera, is kept where the images support it nearly as
    well as their own best pose.
    """
    known = view.only(world.knows(view.tracks))
    if len(known.tracks) < settings.min_inliers:
        return None
    points, row = world.points[known.tracks], world.intrinsics[0]
    threshold_px, least = settings.resection_threshold_px, settings.min_inliers
    free = resection(
        points,
        known.pixels,
        row,
        threshold_px=threshold_px,
        min_inliers=least,
        max_iterations=RANSAC_ITERATIONS,
        seed=settings.seed,
    )
    if rotation is not None:
        least = max(least, math.ceil(_SUPPORT * max(free.num_inliers, _LEAST_SHARE * len(points))))
        rotated = resection_of_rotation(
            points,
            known.pixels,
            row,
            rotation,
            threshold_px=threshold_px,
            min_inliers=least,
            seed=settings.seed,
        )
        if rotated.success:
            return Located(rotated.camera, free.camera if free.success else None)
    return Located(free.camera, free.camera) if free.success else None


def expected_rotation(world: WorldMap, sensors: SensorSuite, time_s: float) -> FloatArray | None:
    """Rotation (3, 3) world_from_camera at a time [s], by a gyroscope from the keyframe before it on."""
    before = next((k for k in reversed(world.keyframes) if k.t_s < time_s), None)
    turn = None if before is None else sensors.rotation(before.t_s, time_s)
    return None if before is None or turn is None else before.pose[:, :3] @ turn
