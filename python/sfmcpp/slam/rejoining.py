"""A new part of the map, after the images had lost the one before."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from sfmcpp.geometry.similarity import Similarity
from sfmcpp.slam.fusing import usual_weights
from sfmcpp.slam.localisation import Follower
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.world_map import WorldMap


def rejoin(result: SlamResult, part: WorldMap, sensors: SensorSuite, follower: Follower) -> None:
    """Put a part that has just started where its frames were followed to, and into the map.

    Its first keyframe stays at the pose that bridges the gap; its scale makes its way as long as the odometer
    says, or the speed before the loss. From here on sensors constrain its keyframes as all others.

    Parameters
    ----------
    result : SlamResult
        The run; its map takes the part in, its poses stay as they are.
    part : WorldMap
        Three keyframes of a frame and a unit of their own.
    sensors : SensorSuite
        What measures the motion.
    follower : Follower
        Tells the length of a way.
    """
    world = result.world
    assert world is not None
    doubtful = result.doubtful
    lengths = [
        follower.length(a.t_s, b.t_s, result.path, doubtful, metric=result.metric)
        for a, b in pairwise(part.keyframes)
    ]
    centres = part.poses()[:, :, 3]
    own = np.linalg.norm(np.diff(centres, axis=0), axis=1).sum()
    scale = sum(lengths) / own if sum(lengths) > 0 else 1.0
    # The first camera of the part is its world.
    anchor = result.poses[part.keyframes[0].frame]
    for before, keyframe in pairwise(part.keyframes):
        rotation = anchor[:, :3] @ keyframe.pose[:, :3]
        measured = sensors.measure(before.t_s, keyframe.t_s, rotation, metric=result.metric)
        keyframe.constraints = usual_weights(world, measured)
    world.join(part, Similarity(float(scale), anchor[:, :3], anchor[:, 3]))
