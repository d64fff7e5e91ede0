"""Free rig sensors whose poses are undetermined."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sfmcpp.doctor.case import Case
from sfmcpp.doctor.finding import Finding, named, numbers
from sfmcpp.doctor.trial import Trial, radii_px, ridged_model
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.pinhole import pinhole_rows
from sfmcpp.model import Problem, Rigs
from sfmcpp.model.arrays import FloatArray

# One standard deviation that moves the rim of the image by half of its radius leaves open what a pose is.
_HALF = 0.5


def mounting(case: Case) -> Iterator[Finding]:
    """Find free sensors with observations whose poses in their rig are undetermined."""
    trial, rigs = case.sound_trial, case.problem.rigs
    if rigs is None or trial is None:
        return
    free = _observing_sensors(trial.problem, rigs)
    shares = _rim_shares(case, trial, free)
    if isinstance(shares, str):
        case.skipped.append(f"poses of sensors in their rigs: {shares}")
    elif (shares > _HALF).any():
        yield _undetermined(rigs, free[shares > _HALF])


def _observing_sensors(problem: Problem, rigs: Rigs) -> NDArray[np.int64]:
    """Free sensors with an observation, without the first of a rig that is all free: a solve holds it.

    It does not where all frames of the rig are fixed, as those of a robot's hand are to find its camera.
    """
    free = rigs.free_sensors.copy()
    origins = rigs.origin_of_sensor()
    free[origins[rigs.sensor_of_camera[~problem.fixed_cameras]]] = False
    return np.intersect1d(np.flatnonzero(free), rigs.sensor_of_camera[problem.camera_index])


def _rim_shares(case: Case, trial: Trial, free: NDArray[np.int64]) -> FloatArray | str:
    """How far one standard deviation of each sensor moves the rim, over its radius; or why that is not known.

    Infinite for the sensors that nothing tells: of those that are so with all others held, or else of all.
    """
    try:
        return _shares_with_free(case, trial, free, free)
    except InvalidArgument:
        pass
    try:
        _shares_with_free(case, trial, free[:0], free)
    except InvalidArgument as error:
        return str(error)
    shares = np.array([_share_alone(case, trial, k) for k in free])
    return shares if np.isinf(shares).any() else np.full(len(free), np.inf)


def _share_alone(case: Case, trial: Trial, sensor: int) -> float:
    only = np.array([sensor])
    try:
        return float(_shares_with_free(case, trial, only, only)[0])
    except InvalidArgument:
        return np.inf


def _shares_with_free(
    case: Case, trial: Trial, free: NDArray[np.int64], wanted: NDArray[np.int64]
) -> FloatArray:
    """Shares (n,) of the wanted sensors if these are free and no others."""
    problem, rigs = trial.problem, trial.problem.rigs
    assert rigs is not None
    model = ridged_model(problem, case.constraints, *free)
    sensors = rigs.sensor_of_camera[problem.camera_index]
    cameras = problem.camera_index[[int(np.argmax(sensors == k)) for k in wanted]]
    variances = np.diagonal(model.covariance(cameras=cameras).cameras, axis1=1, axis2=2)[:, -6:]
    sigmas = np.sqrt(np.maximum(variances, 0)) * trial.sigma_px / case.stated_sigma_px
    turn, shift = sigmas[:, :3].max(axis=1), sigmas[:, 3:].max(axis=1)
    focal_px = pinhole_rows(problem.intrinsics)[problem.intrinsics_index[cameras], 0]
    distance = np.array([_median_distance(problem, sensors == k) for k in wanted])
    return np.asarray((turn + shift / distance) * focal_px / radii_px(problem)[cameras])


def _median_distance(problem: Problem, chosen: NDArray[np.bool_]) -> float:
    """Median distance of the points from the cameras of these observations."""
    rays = problem.points[problem.point_index[chosen]] - problem.centres[problem.camera_index[chosen]]
    return float(np.median(np.linalg.norm(rays, axis=1)))


def _undetermined(rigs: Rigs, sensors: NDArray[np.int64]) -> Finding:
    return Finding(
        "undetermined-sensors",
        "warning",
        "the data do not determine the poses of free sensors in their rig; this happens if the rig never "
        "turns about two axes and no point is seen by two of its sensors",
        "fix the sensors (--rigs fixed), turn the rig more, or let its sensors see common points",
        named("sensor", sensors.tolist()),
        cameras=numbers(np.flatnonzero(np.isin(rigs.sensor_of_camera, sensors))),
    )
