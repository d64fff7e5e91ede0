"""Sensor fusion: weights of new constraints, and the constraint groups of the local adjustment."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import islice

import numpy as np

from sfmcpp.geometry import pose_inliers
from sfmcpp.map import LocalProblem
from sfmcpp.model import ConstraintGroup
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import View
from sfmcpp.slam.motion_sensors import PLACE_KINDS, Measurement
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import Keyframe, WeightedMeasurement, WorldMap
from sfmcpp.weighting import (
    PoseConstraint,
    PoseView,
    WeightSelection,
    declared_weight,
    select_weights,
)

# What a track is off by where its images have not told it yet [px].
_SIGMA_PX = 0.5
# Constraints whose weights are the usual ones: a lie lasts for some, and steps are alike.
_LATELY = 5
# Fewer observations than this leave nothing to choose a weight from.
FEWEST = 8


@dataclass(frozen=True, eq=False)
class Fused:
    """A new keyframe with its weighted sensor measurements.

    Attributes
    ----------
    pose : (3, 4) float64
        Its pose, fitted to the images and the weighted constraints.
    constraints : list of WeightedMeasurement
        With the weights chosen.
    selections : list of WeightSelection
        The whole curves, in the same order; empty where the weights are those usual so far.
    """

    pose: FloatArray
    constraints: list[WeightedMeasurement]
    selections: list[WeightSelection] = field(default_factory=list)


def fuse(
    world: WorldMap,
    view: View,
    pose: FloatArray,
    measurements: Sequence[Measurement],
    settings: SlamSettings,
) -> Fused:
    """Choose the weights of the measurements of a new keyframe, and fit its pose (thesis §5.2.3)."""
    if not measurements or settings.weights == "none":
        return Fused(pose, [])
    images = pose_view(world, view, pose, settings)
    if images is None:
        return Fused(pose, usual_weights(world, measurements))
    methods = [_method(m, settings) for m in measurements]
    constraints = [pose_constraint(m, world.keyframes[-1].pose) for m in measurements]
    bounds = settings.weight_bounds
    selections = select_weights(images, constraints, pose, methods, bounds=bounds, threads=0)
    weighted = [WeightedMeasurement(m, s.weight) for m, s in zip(measurements, selections, strict=True)]
    # Sensors without weight must not move the pose: a least-squares fit is not what resection gives.
    used = any(constraint.weight > 0 for constraint in weighted)
    fitted = selections[0].pose
    return Fused(fitted if used and fitted is not None else pose, weighted, selections)


def presumed_weights(
    world: WorldMap, keyframe: Keyframe, previous: Keyframe, measurements: Sequence[Measurement]
) -> list[WeightedMeasurement]:
    """Give each measurement the weight of its declared σ beside images of usual noise; none without a σ."""
    count = max(int(np.count_nonzero(world.knows(keyframe.view.tracks))), 1)
    return [
        WeightedMeasurement(m, declared_weight(pose_constraint(m, previous.pose), count, _SIGMA_PX))
        for m in measurements
        if m.sigma is not None and not m.doubtful
    ]


def usual_weights(world: WorldMap, measurements: Sequence[Measurement]) -> list[WeightedMeasurement]:
    """Give each measurement its sensor's weight so far, where no new one can be chosen."""
    return [WeightedMeasurement(m, _usual_weight(world, m)) for m in measurements]


def constraint_groups(world: WorldMap, local: LocalProblem) -> list[ConstraintGroup]:
    """One group per sensor, of the free keyframes in `local`: with their predecessors, if these are there.

    A predecessor that is free and sees nothing any more says nothing of the motion from it. Beside a sum
    over N pixels instead of their mean, a constraint counts N λ² (thesis eq. 5.3).
    """
    place = {int(k): position for position, k in enumerate(local.images)}
    count = np.bincount(local.problem.camera_index, minlength=len(place))
    known = (count > 0) | local.problem.fixed_cameras
    members: list[Member] = []
    for k, position in place.items():
        if local.problem.fixed_cameras[position]:
            continue
        for constraint in world.keyframes[k].constraints:
            if constraint.measurement.kind in PLACE_KINDS:
                members.append(Member((position,), constraint, int(count[position])))
            elif k - 1 in place and known[place[k - 1]]:
                members.append(Member((place[k - 1], position), constraint, int(count[position])))
    return grouped_constraints(members)


@dataclass(frozen=True, eq=False)
class Member:
    """A constraint on cameras of a problem, and the number of observations beside whose mean it counts."""

    cameras: tuple[int, ...]
    constraint: WeightedMeasurement
    count: int


def grouped_constraints(members: Iterable[Member]) -> list[ConstraintGroup]:
    """One group per sensor and kind, in the order in which they come."""
    groups: dict[tuple[str, str], list[Member]] = {}
    for member in members:
        measured = member.constraint.measurement
        groups.setdefault((measured.sensor, measured.kind), []).append(member)
    return [_group(sensor, kind, found) for (sensor, kind), found in groups.items()]


def _group(sensor: str, kind: str, members: Sequence[Member]) -> ConstraintGroup:
    cameras = np.array([m.cameras for m in members], dtype=np.int32)
    return ConstraintGroup(
        kind,
        cameras[:, 0] if kind in PLACE_KINDS else cameras,
        np.array([m.constraint.measurement.value for m in members], dtype=np.float64),
        member_weights=np.array([m.count * m.constraint.weight**2 for m in members]),
        name=sensor,
    )


def pose_view(world: WorldMap, view: View, pose: FloatArray, settings: SlamSettings) -> PoseView | None:
    """Data for choosing weights: the inliers of a pose on the map (thesis eq. 5.15); None if few."""
    known, row = view.only(world.knows(view.tracks)), world.intrinsics[0]
    points, threshold_px = world.points[known.tracks], settings.resection_threshold_px
    inliers = pose_inliers(pose, points, known.pixels, row, threshold_px)
    if np.count_nonzero(inliers) < FEWEST:
        return None
    return PoseView(points[inliers], known.pixels[inliers], row, world.camera_model)


def _method(measurement: Measurement, settings: SlamSettings) -> str:
    """None without a bound to choose within: a σ that is yet to be learnt."""
    bounded = settings.weight_bounds == "declared"
    unknown = measurement.doubtful or (bounded and measurement.sigma is None)
    return "none" if unknown else settings.weights


def _usual_weight(world: WorldMap, measurement: Measurement) -> float:
    """Median of what this sensor was left of its declared σ lately; 1 before there is any, 0 if doubtful."""
    if measurement.doubtful:
        return 0.0
    weights = (
        constraint.weight * (constraint.measurement.sigma or 1.0)
        for keyframe in reversed(world.keyframes)
        for constraint in reversed(keyframe.constraints)
        if _are_groupable(constraint.measurement, measurement) and not constraint.measurement.doubtful
    )
    lately = list(islice(weights, _LATELY))
    return float(np.median(lately)) / (measurement.sigma or 1.0) if lately else 1.0


def _are_groupable(one: Measurement, other: Measurement) -> bool:
    return (one.sensor, one.kind) == (other.sensor, other.kind)


def pose_constraint(measurement: Measurement, previous: FloatArray) -> PoseConstraint:
    """The measurement as a constraint on a pose, that of the keyframe before held fixed."""
    make = partial(
        PoseConstraint,
        measurement.kind,
        previous=previous,
        sensor_sigma=measurement.sigma,
        yields=measurement.yields,
        slack=measurement.slack,
        name=measurement.sensor,
    )
    value = np.asarray(measurement.value)
    if measurement.kind == "scale":
        return make(distance=float(value))
    if measurement.kind == "position":
        return make(translation=value)
    if measurement.kind in ("pose", "displacement-pose"):
        return make(rotation=value[:, :3], translation=value[:, 3])
    return make(rotation=value)
