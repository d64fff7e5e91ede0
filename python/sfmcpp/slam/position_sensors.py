"""Sensors as sources of positions and poses of keyframes: GPS, INS."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import check_fields
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sensors import (
    Mounting,
    displaced_positions,
    longest_lost_fix,
    pose_at,
    position_at,
    smoothed_positions,
    without_leaps,
    without_repeats,
)
from sfmcpp.sensors.gps import position_sigma
from sfmcpp.slam.measurement import Measurement, require_sigma


@dataclass(frozen=True, eq=False)
class Gps:
    """Positions: constrains the centre of a keyframe (thesis table 5.1).

    Attributes
    ----------
    stream : SensorStream
        Of kind ``"position"``: where the antenna, the origin of the body, is in the sensor's world [m]. Of
        kind ``"geodetic"``: see :func:`sfmcpp.sensors.local_positions`.
    mounting : Mounting, optional
        How the camera sits on the body, whose z axis points up. Default: the antenna is at the camera, which
        is upright.
    name : str
        Name in reports.
    sigma_m : float, optional
        Standard deviation along each axis [m]; None: estimated during the run.
    origin : WorldOrigin, optional
        Where the sensor's world has its origin, if that is known.

    Raises
    ------
    InvalidArgument
        If a value is of another type, or `sigma_m` is not positive.
    """

    stream: SensorStream
    mounting: Mounting | None = None
    name: str = "gps"
    sigma_m: float | None = 1.0
    origin: WorldOrigin | None = None

    def __post_init__(self) -> None:
        check_fields(self, "stream", "mounting", "name", "origin")
        require_sigma("sigma_m", self.sigma_m)

    @cached_property
    def measured(self) -> SensorStream:
        """The positions without repeats of the one before."""
        return without_repeats(self.stream)

    @cached_property
    def reachable(self) -> SensorStream:
        """The measured positions that a vehicle can have reached from the others."""
        return without_leaps(self.measured, self.sigma_m)

    @cached_property
    def displaced(self) -> NDArray[np.bool_]:
        """Which of the reachable positions have jumped away from the others, (n,)."""
        return displaced_positions(self.reachable, self.likely_sigma_m)

    @cached_property
    def believed(self) -> SensorStream:
        """The positions that have not, smoothed."""
        return smoothed_positions(self.reachable.only(~self.displaced), self.likely_sigma_m)

    @property
    def likely_sigma_m(self) -> float:
        """Standard deviation along each axis [m]: the declared one, or 1 m."""
        return 1.0 if self.sigma_m is None else self.sigma_m

    def remarks(self) -> list[str]:
        """What is wrong with the stream by itself, a sentence each."""
        stream = f"stream {self.stream.name!r}: "
        found = _unreachable(self.measured, self.reachable)
        if (lost := longest_lost_fix(self.stream, self.likely_sigma_m)) is not None:
            found.append(
                f"{stream}one position is repeated for {lost[1]:.1f} s from {lost[0]:.3f} s on, as without a "
                "fix: repeats get no weight"
            )
        if self.displaced.any():
            away = self.reachable.t_s[self.displaced]
            found.append(
                f"{stream}{len(away)} of {len(self.measured)} positions jump away from the others, first at "
                f"{away[0]:.3f} s: they get no weight"
            )
        return found

    def at(self, time_s: float, rotation: FloatArray) -> FloatArray | None:
        """Centre (3,) of a camera with that rotation world_from_camera [m]."""
        antenna = position_at(self.believed, time_s)
        if antenna is None or self.mounting is None:
            return antenna
        return np.asarray(antenna + rotation @ self.mounting.camera_from_body @ self.mounting.lever_arm_m)

    @property
    def up_in_camera(self) -> FloatArray:
        """Direction (3,) that is up in the frame of an upright camera."""
        if self.mounting is None:
            return np.array([0.0, -1.0, 0.0])
        return np.asarray(self.mounting.camera_from_body[:, 2])

    def measure(self, start_s: float, end_s: float, rotation: FloatArray) -> Measurement | None:
        """Centre of this keyframe."""
        centre, sigma_m = self.at(end_s, rotation), position_sigma(self.believed, end_s, self.sigma_m)
        return None if centre is None else Measurement(self.name, "position", centre, sigma_m)


@dataclass(frozen=True, eq=False)
class Ins:
    """Poses: constrains the pose of a keyframe (thesis eq. 5.22).

    Attributes
    ----------
    stream : SensorStream
        Of kind ``"pose"``, world_from_body.
    mounting : Mounting
        How the camera sits on the body.
    name : str
        Name in reports.
    sigma_m : float, optional
        Standard deviation of a position along each axis [m]; None: estimated during the run.

    Raises
    ------
    InvalidArgument
        If a value is of another type, or `sigma_m` is not positive.
    """

    stream: SensorStream
    mounting: Mounting
    name: str = "ins"
    sigma_m: float | None = 0.5

    def __post_init__(self) -> None:
        check_fields(self, "stream", "mounting", "name")
        require_sigma("sigma_m", self.sigma_m)

    @cached_property
    def believed(self) -> SensorStream:
        """The stream without poses that it shows cannot be right."""
        return without_leaps(self.stream, self.sigma_m)

    def remarks(self) -> list[str]:
        """What is wrong with the stream by itself, a sentence each."""
        return _unreachable(self.stream, self.believed)

    def at(self, time_s: float) -> FloatArray | None:
        """Pose (3, 4) of the camera, world_from_camera."""
        body = pose_at(self.believed, time_s)
        return None if body is None else self.mounting.camera_poses(body)

    def measure(self, start_s: float, end_s: float, rotation: FloatArray) -> Measurement | None:
        """Pose of this keyframe."""
        pose = self.at(end_s)
        return None if pose is None else Measurement(self.name, "pose", pose, self.sigma_m)


def _unreachable(stream: SensorStream, reachable: SensorStream) -> list[str]:
    if not (lost := len(stream) - len(reachable)):
        return []
    return [
        f"stream {stream.name!r}: {lost} of {len(stream)} positions are where no vehicle can have got to "
        "from the others: they get no weight"
    ]
