"""Which distortion the images of a model show: as much of it as lowers the cost for good.

A model of too few parameters bends the scene, focal length and heights first; one of too many takes up noise.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.map import Map
from sfmcpp.sfm.adjusting import FINE, adjusted
from sfmcpp.sfm.cameras import PERSPECTIVE
from sfmcpp.sfm.settings import IncrementalSettings

# What is freed, each on top of what was worth it before, and what the model is called then.
_STEPS = ((("k2",), "radial"), (("aspect", "cx", "cy"), "opencv"))
# Intrinsics stay free if they lower the cost by this part. Noise alone lowers that of M observations by less
# than 1 / M for each; what other errors of a model lend to any parameter is seldom more than one percent.
_WORTH = 0.015


def choose_camera_model(world: Map, settings: IncrementalSettings) -> str:
    """Free more intrinsics of the cameras of a model, as long as that is worth it.

    Parameters
    ----------
    world : Map
        Adjusted with ``"simple-radial"`` cameras; it is adjusted with those that are chosen.
    settings : IncrementalSettings
        Scale of the loss, and how many images a camera needs.

    Returns
    -------
    str
        Name of the richest camera model that is needed.
    """
    name, best = "simple-radial", adjusted(world, settings, **FINE)
    for intrinsics, richer in _STEPS:
        local = world.whole_problem(2)
        estimated = ~local.problem.fixed_intrinsics.all(axis=1)
        for intrinsic in intrinsics:
            local.problem.fixed_intrinsics[estimated, PERSPECTIVE.index(intrinsic)] = False
        freed = local.problem.fixed_intrinsics.copy()
        cost = adjusted(world, settings, local, **FINE)
        if cost < (1 - _WORTH) * best:
            world.take(local)
            world.fixed_intrinsics[local.cameras] = freed
            name, best = richer, cost
    for camera in np.flatnonzero(~world.fixed_intrinsics.all(axis=1)):
        world.camera_names[camera] = name.upper().replace("-", "_")
    return name
