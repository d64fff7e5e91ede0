"""Sensor fusion: weights of new constraints, and the constraint groups of the local adjustment."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice

import numpy as np

from sfmcpp.geometry import pose_inliers
from sfmcpp.map import LocalProblem
from sfmcpp.model import ConstraintGroup
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import View
from sfmcpp.slam.measurement import PLACE_KINDS, Measurement
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import Keyframe, WeightedMeasurement, WorldMap
from sfmcpp.weighting import (
    PoseConstraint,
    PoseView,
    WeightSelection,
    declared_weight,
    select_weights,
)

# Standard deviation of the images where no fit has estimated it yet [px].
_SIGMA_PX = 0.5
# The usual weight of a sensor is the median of so many, the latest: a fault lasts for several keyframes, and
# consecutive steps are alike.
_LATELY = 5
# With fewer observations than this no weight is chosen.
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
    images_wrong : bool
        Whether a sensor is farther from the images than it can be off.
    """

    pose: FloatArray
    constraints: list[WeightedMeasurement]
    selections: list[WeightSelection] = field(default_factory=list)
    images_wrong: bool = False


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
    wrong = any(m.is_beyond_reach(s.conflict) for m, s in zip(measurements, selections, strict=True))
    if wrong:
        constraints = [replace(constraint, yields=False) for constraint in constraints]
        selections = select_weights(images, constraints, pose, methods, bounds=bounds, threads=0)
    weighted = [WeightedMeasurement(m, s.weight) for m, s in zip(measurements, selections, strict=True)]
    # Sensors without weight must not move the pose: a least-squares fit is not what resection gives.
    used = any(constraint.weight > 0 for constraint in weighted)
    fitted = selections[0].pose
    return Fused(fitted if used and fitted is not None else pose, weighted, selections, wrong)


def presumed_weights(
    world: WorldMap, keyframe: Keyframe, previous: Keyframe, measurements: Sequence[Measurement]
) -> list[WeightedMeasurement]:
    """Give measurements the weights of their declared σ beside images of usual noise.

    Those without a σ and doubtful ones are left out.
    """
    count = max(int(np.count_nonzero(world.knows(keyframe.view.tracks))), 1)
    return [
        WeightedMeasurement(m, declared_weight(pose_constraint(m, previous.pose), count, _SIGMA_PX))
        for m in measurements
        if m.sigma is not None and not m.doubtful
    ]


def usual_weights(world: WorldMap, measurements: Sequence[Measurement]) -> list[WeightedMeasurement]:
    """Give each measurement the usual weight of its sensor so far, where no new one can be chosen."""
    return [WeightedMeasurement(m, _usual_weight(world, m)) for m in measurements]


def constraint_groups(world: WorldMap, local: LocalProblem) -> list[ConstraintGroup]:
    """Constraints on the free keyframes in `local`, a group per sensor and kind.

    Those on the motion from the keyframe before are left out if that is not in `local`, or is free without
    any observation. Beside a sum over N pixels instead of their mean, a constraint has the weight N λ²
    (thesis eq. 5.3).
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
    """A constraint on cameras of a problem, and the number N of observations that its λ refers to."""

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
    """Inliers of a pose on the map, for the choice of weights (thesis eq. 5.15); None if they are few."""
    known, row = view.only(world.knows(view.tracks)), world.intrinsics[0]
    points, threshold_px = world.points[known.tracks], settings.resection_threshold_px
    inliers = pose_inliers(pose, points, known.pixels, row, threshold_px)
    if np.count_nonzero(inliers) < FEWEST:
        return None
    return PoseView(points[inliers], known.pixels[inliers], row, world.camera_model)


def _method(measurement: Measurement, settings: SlamSettings) -> str:
    """How to choose a weight; "none", no weight, for doubtful ones, or while σ has yet to be estimated."""
    bounded = settings.weight_bounds == "declared"
    unknown = measurement.doubtful or (bounded and measurement.sigma is None)
    return "none" if unknown else settings.weights


def _usual_weight(world: WorldMap, measurement: Measurement) -> float:
    """Median of the latest λ σ of the sensor over the σ of this measurement; 0 if it is doubtful.

    Without earlier weights it is 1.
    """
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
    """The measurement as a constraint on one pose; `previous` (3, 4), the keyframe before, is held."""
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
