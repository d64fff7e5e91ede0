"""Slow slips of odometers, by a map that their distances do not hold."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np

from sfmcpp.ba import LinearModel, SolveOptions
from sfmcpp.errors import InvalidArgument
from sfmcpp.map import LocalProblem
from sfmcpp.model import ConstraintGroup, Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import Slip, find_slip, is_easier_without
from sfmcpp.sensors.odometer import LEAST_STEP_M
from sfmcpp.sensors.slip import SLIP_MARGIN
from sfmcpp.slam.fusion import constraint_groups
from sfmcpp.slam.mapping import ROBUST_LOSS
from sfmcpp.slam.measurement import METRIC_KINDS, Measurement
from sfmcpp.slam.motion_sensors import Odometer
from sfmcpp.slam.odometer_clock import set_odometer_clocks
from sfmcpp.slam.position_sensors import Gps, Ins
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_faults import has_wrong_axes
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import Keyframe, WorldMap
from sfmcpp.weighting import solve

# Tracks that three keyframes in a row must share for the images to keep their scale from one to the next.
_FEWEST_TRACKS = 8
# Keyframes examined together; the next ones overlap by half. Their covariance is a dense matrix.
_MOST_KEYFRAMES = 160
# Standard deviation of a step by the odometer, as a share of it: so loose that only steps that images leave
# open follow it.
_OPEN_SHARE = 0.5
# The loss is that of the final adjustment. Images are off by half a pixel, but for whole tracks: with the
# standard deviation of a pixel for each, steps scatter about the odometers of 0001, 0027, 0036 and 0039 as
# their covariance says.
_LOSS, _LOSS_PX = ROBUST_LOSS
# Tolerance and iterations of the solve, at whose optimum the linear model is made.
_TOLERANCE, _MOST_STEPS = 1e-8, 100
# Share of its diagonal that makes a nearly singular normal matrix invertible.
_RIDGE = 1e-9


def check_odometers(result: SlamResult, sensors: SensorSuite, settings: SlamSettings) -> list[str]:
    """Find clocks of odometers that are off, else their slow slips, at the end of a run.

    Parameters
    ----------
    result : SlamResult
        The run; its map does not move.
    sensors : SensorSuite
        Stamps are moved, and slips are known for a run in hindsight.
    settings : SlamSettings
        Nothing is done where declared σ count for nothing, nor where a mounting or axes are wrong: that has
        bent the map, and the run is begun again without it.

    Returns
    -------
    list of str
        A sentence for each.
    """
    if not settings.trusts_declared or has_wrong_axes(sensors):
        return []
    return set_odometer_clocks(sensors) or _find_slips(result, sensors)


def _find_slips(result: SlamResult, sensors: SensorSuite) -> list[str]:
    """Find slips of odometers, if no other sensor measures metres and all clocks were right."""
    world, told = result.world, []
    others = any(isinstance(sensor, Gps | Ins) for sensor in sensors.sensors)
    if world is None or not world.metric or world.stereo or others or sensors.moved_s:
        return []
    for odometer in sensors.of_type(Odometer):
        told_by_images = [_slip_in(world, part, odometer, sensors) for part in _parts(world)]
        likely = [slip for slip in told_by_images if slip and slip.gain >= _least_gain(world)]
        found = [slip for slip in likely if is_easier_without(odometer.stream, slip)]
        if found:
            likeliest = max(found, key=lambda slip: slip.gain)
            sensors.slips[odometer.name] = likeliest
            told.append(f"{odometer.name}: {likeliest.complaint}")
    return told


def _least_gain(world: WorldMap) -> float:
    """Log-likelihood ratio from which the best of all parts is a slip: more parts give chance more trials."""
    return SLIP_MARGIN + math.log(max(len(world.keyframes) / _MOST_KEYFRAMES, 1.0))


def _parts(world: WorldMap) -> Iterator[range]:
    """Stretches of keyframes through which images keep the scale, none of more than `_MOST_KEYFRAMES`."""
    known = [view.tracks[world.knows(view.tracks)] for view in (k.view for k in world.keyframes)]
    shared = [np.intersect1d(a, b) for a, b in pairwise(known)]
    weak = [k + 1 for k, (a, b) in enumerate(pairwise(shared)) if len(np.intersect1d(a, b)) < _FEWEST_TRACKS]
    for begin, end in pairwise([0, *weak, len(known) - 1]):
        for first in range(begin, max(end - _MOST_KEYFRAMES // 2, begin + 1), _MOST_KEYFRAMES // 2):
            yield range(first, min(first + _MOST_KEYFRAMES, end + 1))


def _slip_in(world: WorldMap, part: range, odometer: Odometer, sensors: SensorSuite) -> Slip | None:
    keyframes = [world.keyframes[k] for k in part]
    steps = [_measured(odometer, *pair, sensors) for pair in pairwise(keyframes)]
    lengths = np.array([np.nan if step is None else _length(step) for step in steps])
    if np.count_nonzero(lengths > LEAST_STEP_M) < 2:
        return None
    lengths[~(lengths > LEAST_STEP_M)] = np.nan
    try:
        ratios, covariance = _scale_of_images(world, part, lengths)
    except InvalidArgument:
        # Images do not determine every keyframe.
        return None
    sigmas = np.array([1.0 if step is None else step.sigma or 0.0 for step in steps])
    noise = np.nan_to_num(sigmas / lengths, nan=1.0)
    stamps_s = np.array([keyframe.t_s for keyframe in keyframes])
    return find_slip(stamps_s, ratios, covariance + np.diag(noise**2))


def _measured(
    odometer: Odometer, before: Keyframe, after: Keyframe, sensors: SensorSuite
) -> Measurement | None:
    told = sensors.since(before, after.t_s, after.pose, metric=True)
    return next((m for m in told if m.sensor == odometer.name and not m.doubtful), None)


def _length(step: Measurement) -> float:
    """Length of a measured step, a distance or a displacement [m]."""
    value = np.asarray(step.value)
    return float(np.linalg.norm(value[:, 3]) if value.ndim else value)


def _scale_of_images(world: WorldMap, part: range, lengths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Logarithms (n,) of the steps by images over those by the odometer, and their covariance (n, n).

    They are those of a copy of the map, adjusted without the sensors that measure metres.
    """
    local = _problem_of(world, part)
    problem = local.problem
    problem.fixed_cameras[0] = True
    groups = [replace(g, loss=_LOSS) for g in constraint_groups(world, local) if g.kind not in METRIC_KINDS]
    groups.append(_open_scale(lengths))
    solve(
        problem,
        constraints=groups,
        loss=_LOSS,
        loss_scale_px=_LOSS_PX,
        function_tolerance=_TOLERANCE,
        max_iterations=_MOST_STEPS,
    ).require_uninterrupted()
    options = SolveOptions(loss=_LOSS, loss_scale_px=_LOSS_PX, gauge="fixed")
    return _step_logarithms(problem, LinearModel(problem, groups, options, _RIDGE), lengths)


def _step_logarithms(
    problem: Problem, model: LinearModel, lengths: FloatArray
) -> tuple[FloatArray, FloatArray]:
    steps = np.diff(problem.cameras[:, :, 3], axis=0)
    squares = (steps**2).sum(axis=1)
    rows, centre = np.arange(len(steps)), slice(3, 6)
    slopes = np.zeros((len(steps), problem.num_cameras, len(model.parameter_names)))
    slopes[rows, rows, centre] = -steps / squares[:, None]
    slopes[rows, rows + 1, centre] = steps / squares[:, None]
    flat = slopes.reshape(len(steps), -1)
    joint = model.covariance(cameras="all", joint=True).joint
    assert joint is not None
    return 0.5 * np.log(squares) - np.log(lengths), flat @ joint @ flat.T


def _problem_of(world: WorldMap, part: range) -> LocalProblem:
    """The problem of the keyframes of a part and the points that two or more of them see."""
    images = np.isin(np.arange(world.num_images), part)
    rows = world.keypoints_of(np.array(part))
    points, views = np.unique(world.keypoint_points[rows], return_counts=True)
    seen = points[(points >= 0) & (views > 1)]
    return world.seen_from(images, seen[np.isfinite(world.points[seen, 0])])


def _open_scale(lengths: FloatArray) -> ConstraintGroup:
    """Constrain steps to their lengths by the odometer, so loosely that images decide wherever they can."""
    (known,) = np.nonzero(np.isfinite(lengths))
    pairs = np.column_stack([known, known + 1]).astype(np.int32)
    return ConstraintGroup("scale", pairs, lengths[known], sigma=_OPEN_SHARE * lengths[known], name="open")
