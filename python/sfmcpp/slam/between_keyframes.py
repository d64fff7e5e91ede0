"""Poses of the frames between two keyframes: fitted as they come, and together after the next keyframe."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame, View
from sfmcpp.slam.fusion import FEWEST, Member, grouped_constraints, pose_constraint, pose_view, usual_weights
from sfmcpp.slam.mapping import ROBUST_LOSS, solve_live
from sfmcpp.slam.measurement import PLACE_KINDS, Measurement
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import Keyframe, WorldMap
from sfmcpp.weighting import refine_pose


def fit_latest_frame(
    world: WorldMap,
    view: View,
    pose: FloatArray,
    measurements: Sequence[Measurement],
    settings: SlamSettings,
) -> FloatArray:
    """Fit the pose (3, 4) of a frame between keyframes to images and sensors, at their usual weights so far.

    It stays unless the settings trust declared σ: in the thesis sensors constrain keyframes only.
    """
    if not settings.trusts_declared:
        return pose
    usual = [c for c in usual_weights(world, measurements) if c.weight > 0]
    images = pose_view(world, view, pose, settings)
    if images is None or not usual:
        return pose
    previous = world.keyframes[-1].pose
    weighted = [(pose_constraint(c.measurement, previous), c.weight) for c in usual]
    return refine_pose(images, weighted, pose).pose


def fit_between_keyframes(
    result: SlamResult, frames: Sequence[Frame], sensors: SensorSuite, settings: SlamSettings
) -> None:
    """Fit the frames between the last two keyframes together, with the map and these two held.

    A sensor measures steps from frame to frame much better than the motion since a keyframe far back, and the
    new keyframe holds the frames from the other side. With few and distant points a frame fitted by itself
    may be off by metres between keyframes that are not.

    Parameters
    ----------
    result : SlamResult
        The run so far; the poses of these frames move.
    frames : sequence of Frame
        The latest frames, in the order of time.
    sensors : SensorSuite
        What measures the steps; without measurements frames stay.
    settings : SlamSettings
        Frames stay unless `trusts_declared`: in the thesis sensors constrain keyframes only.
    """
    if not settings.trusts_declared:
        return
    world, path = result.world, result.path
    assert world is not None
    before, after = world.keyframes[-2:]
    between = [
        _Stop.of(frame, frame.number, path.between[frame.number], world)
        for frame in frames
        if before.frame < frame.number < after.frame
    ]
    seeing = [stop for stop in between if len(stop.known.tracks) >= FEWEST]
    start, end = (_Stop.of(keyframe, keyframe.frame, keyframe.pose, world) for keyframe in (before, after))
    stops = [start, *seeing, end]
    groups = grouped_constraints(_step_members(stops, world, sensors))
    if not seeing or not groups:
        return
    problem = _problem(world, stops)
    solve_live(problem, [replace(group, loss=ROBUST_LOSS[0]) for group in groups], ROBUST_LOSS)
    for stop, pose in zip(seeing, problem.cameras[1:-1], strict=True):
        path.settle(stop.number, pose)


@dataclass(frozen=True, eq=False)
class _Stop:
    """A frame or keyframe on the way: its number, time [s] and pose, and what it sees of the map."""

    number: int
    t_s: float
    pose: FloatArray
    known: View

    @classmethod
    def of(cls, seen: Frame | Keyframe, number: int, pose: FloatArray, world: WorldMap) -> _Stop:
        return cls(number, seen.t_s, pose, seen.view.only(world.knows(seen.view.tracks)))


def _step_members(stops: Sequence[_Stop], world: WorldMap, sensors: SensorSuite) -> Iterator[Member]:
    """Constraints from each stop to the next, with the usual weights so far."""
    for k, (start, end) in enumerate(pairwise(stops)):
        rotation, previous = end.pose[:, :3], start.pose[:, :3]
        measured = sensors.measure(start.t_s, end.t_s, rotation, metric=world.metric, previous=previous)
        for constraint in usual_weights(world, measured):
            if constraint.measurement.kind not in PLACE_KINDS:
                yield Member((k, k + 1), constraint, len(end.known.tracks))
            elif k + 2 < len(stops):
                yield Member((k + 1,), constraint, len(end.known.tracks))


def _problem(world: WorldMap, stops: Sequence[_Stop]) -> Problem:
    """The problem of all stops and the points they see; the first and last stop and the points are held."""
    views = [stop.known for stop in stops[1:-1]]
    points, index = np.unique(np.concatenate([view.tracks for view in views]), return_inverse=True)
    return Problem(
        camera_model=world.camera_model,
        cameras=np.stack([stop.pose for stop in stops]),
        intrinsics=world.intrinsics[:1].copy(),
        points=world.points[points],
        camera_index=np.repeat(np.arange(1, len(stops) - 1, dtype=np.int32), [len(v.tracks) for v in views]),
        point_index=index.astype(np.int32),
        pixels=np.concatenate([view.pixels for view in views]),
        intrinsics_index=np.zeros(len(stops), dtype=np.int32),
        fixed_cameras=np.isin(np.arange(len(stops)), [0, len(stops) - 1]),
        fixed_points=np.ones(len(points), dtype=np.bool_),
        fixed_intrinsics=np.ones((1, world.intrinsics.shape[1]), dtype=np.bool_),
    )
