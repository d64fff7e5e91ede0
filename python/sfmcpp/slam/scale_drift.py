"""How well images alone hold the scale of a map: the relative standard deviation of each step, and their sum.

The length of a step is measured by the points seen before; new points take their distance from it. So errors
of steps multiply, and the logarithm of the scale walks at random.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import View
from sfmcpp.slam.fusion import pose_view
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import WorldMap
from sfmcpp.weighting import PoseConstraint, conflict

# Of a step that the images leave open: it takes the speed of the step before. With this, log(scale at the end
# / at the start) over its expected standard deviation has a root mean square of 0.8 on the drives for tuning
# and their parts without sensors, but for one that collapses, and of 0.7 with a gyroscope
# (bench/scale_drift.py).
_OPEN_STEP = 0.3
# A warning is given where the scale is uncertain by more than this from start to end …
_LARGE = 0.3
# … which names the steps that this share of the variance comes from.
_NAMED_SHARE = 0.8
# Stretches of frames that it names at most; report.json has all.
_MOST_NAMED = 8
# Frames between which no more than so many lie are named as one stretch.
_NEAR_FRAMES = 5


def step_sigma(world: WorldMap, view: View, pose: FloatArray, settings: SlamSettings) -> float:
    """Relative standard deviation of the distance to the last keyframe, by the images alone.

    Parameters
    ----------
    world : WorldMap
        The map, before the new keyframe.
    view : View
        What the new keyframe sees.
    pose : (3, 4) float64
        Its pose by the images.
    settings : SlamSettings
        Which points are inliers, and the least angle of new points.

    Returns
    -------
    float
        At most that of a step that is left open, as with too few points; 0 for a step too short to give
        points, which takes the scale nowhere.
    """
    images = pose_view(world, view, pose, settings)
    if images is None:
        return _OPEN_STEP
    previous = world.keyframes[-1].pose
    length = float(np.linalg.norm(pose[:, 3] - previous[:, 3]))
    depth = float(np.median((images.points - pose[:, 3]) @ pose[:, 2]))
    if length <= math.tan(math.radians(settings.min_angle_deg)) * depth:
        return 0.0
    step = PoseConstraint("scale", previous=previous, distance=length)
    return min(conflict(images, step, pose).images_sigma / length, _OPEN_STEP)


def scale_sigmas(result: SlamResult) -> FloatArray | None:
    """Standard deviation of the logarithm of the scale at each keyframe, against that at the first.

    The root of the sum of the squares of :attr:`KeyframeRecord.step_sigma` so far; a new part of the map
    begins with a step that is left open.

    Parameters
    ----------
    result : SlamResult
        Of a run, also of one that goes on.

    Returns
    -------
    (n,) float64 or None
        For the n keyframes of the map; None where sensors or right images hold the scale, or there is no map.
    """
    world = result.world
    if world is None or result.metric or world.stereo:
        return None
    steps = _step_sigmas(result)
    variances = np.concatenate([[0.0], np.cumsum(np.square(list(steps.values())))])
    frames = [keyframe.frame for keyframe in world.keyframes]
    return np.asarray(np.sqrt(variances[np.searchsorted(list(steps), frames, side="right")]))


def warn_of_scale(result: SlamResult) -> list[str]:
    """A warning if the images leave the scale uncertain by a third or more from start to end."""
    sigmas = scale_sigmas(result)
    if sigmas is None or not len(sigmas) or sigmas[-1] <= _LARGE:
        return []
    weak = stretches(_weakest(_step_sigmas(result)))
    more = f" and in {len(weak) - _MOST_NAMED} more stretches" if len(weak) > _MOST_NAMED else ""
    where = f"{', '.join(weak[:_MOST_NAMED])}{more}"
    return [
        f"the scale of the map may change from start to end, by {scale_text(float(sigmas[-1]))}: images hold "
        f"the lengths of steps poorly at frames {where}; an odometer, a GPS, an INS or right images hold it"
    ]


def scale_text(sigma: float) -> str:
    """A standard deviation of the logarithm of a scale: a percentage, or a factor if it is large."""
    return f"{100 * sigma:.2g} %" if sigma <= _LARGE else f"a factor of {math.exp(sigma):.2g}"


def _step_sigmas(result: SlamResult) -> dict[int, float]:
    """The relative σ of the step that ends at each frame, in the order of frames."""
    steps = {record.frame: record.step_sigma for record in result.records}
    steps |= dict.fromkeys(result.restarts, _OPEN_STEP)
    return dict(sorted(steps.items()))


def _weakest(steps: dict[int, float]) -> list[int]:
    """Frames, in order, of the fewest steps that most of the variance comes from."""
    frames = sorted(steps, key=lambda frame: -steps[frame])
    sums = np.cumsum([steps[frame] ** 2 for frame in frames])
    return sorted(frames[: 1 + int(np.searchsorted(sums, _NAMED_SHARE * sums[-1]))])


def stretches(frames: Sequence[int], near: int = _NEAR_FRAMES) -> list[str]:
    """Frames in words, those that are `near` each other as one stretch: "144 to 147", "175"."""
    ends: list[list[int]] = []
    for frame in frames:
        if ends and frame - ends[-1][1] <= near:
            ends[-1][1] = frame
        else:
            ends.append([frame, frame])
    return [str(first) if first == last else f"{first} to {last}" for first, last in ends]
