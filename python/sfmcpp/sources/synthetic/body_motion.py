"""A body that moves smoothly, what sensors on it measure, and the drive that is recorded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.model.checks import require_finite, require_not_negative, require_positive

# From times (n,) [s] to poses (n, 3, 4) world_from_body.
Motion = Callable[[FloatArray], FloatArray]

# Rates are differences of orientations over this time [s]: short beside any motion, long beside rounding.
_DIFFERENCE_S = 1e-3
# Sines that make up a sway.
_WAVES = 6


@dataclass(frozen=True)
class BodySensors:
    """Sensors on a body, with the rates and standard deviations of thesis table 1.1.

    The gyroscope is its XSENS MTi, the navigation system its IXSEA PHINS. It tells nothing of the odometer's
    errors nor of biases; ours are usual ones: one percent of a tyre's radius, a rate of a degree a minute.

    Attributes
    ----------
    odometer_hz, gyro_hz, navigation_hz : float
        Samples a second.
    odometer_sigma_m_s : float
        Standard deviation of each speed [m/s].
    odometer_scale : float
        Speeds are so many times the true ones.
    gyro_sigma_deg_s : float
        Standard deviation of each component of each angular rate [deg/s].
    gyro_bias_deg_s : float
        Length of its constant error, in a direction of chance [deg/s].
    navigation_sigma_deg : float
        Standard deviation of each component of each orientation [deg].
    """

    odometer_hz: float = 25.0
    gyro_hz: float = 100.0
    navigation_hz: float = 100.0
    odometer_sigma_m_s: float = 0.05
    odometer_scale: float = 1.01
    gyro_sigma_deg_s: float = 0.1
    gyro_bias_deg_s: float = 0.0167
    navigation_sigma_deg: float = 0.01

    def __post_init__(self) -> None:
        for name in ("odometer_hz", "gyro_hz", "navigation_hz", "odometer_scale"):
            require_positive(name, getattr(self, name))
        for name in ("odometer_sigma_m_s", "gyro_sigma_deg_s", "navigation_sigma_deg"):
            require_not_negative(name, getattr(self, name))
        require_finite("gyro_bias_deg_s", self.gyro_bias_deg_s)

    def odometer(self, speed: FloatArray, t_s: FloatArray, rng: np.random.Generator) -> SensorStream:
        """Measure speeds (n,) [m/s] at times (n,) [s]."""
        noise = self.odometer_sigma_m_s * rng.standard_normal(len(t_s))
        return SensorStream(t_s, self.odometer_scale * speed + noise, "speed", "odometer")

    def gyro(self, motion: Motion, seconds: float, rng: np.random.Generator) -> SensorStream:
        """Measure the angular rates of a motion from 0 to `seconds`."""
        t_s = stamps(seconds, self.gyro_hz)
        direction = rng.standard_normal(3)
        bias = np.deg2rad(self.gyro_bias_deg_s) * direction / np.linalg.norm(direction)
        noise = np.deg2rad(self.gyro_sigma_deg_s) * rng.standard_normal((len(t_s), 3))
        return SensorStream(t_s, angular_rates(motion, t_s) + bias + noise, "angular_rate", "gyro")

    def navigation(self, motion: Motion, seconds: float, rng: np.random.Generator) -> SensorStream:
        """Measure the orientations of a motion from 0 to `seconds`."""
        t_s = stamps(seconds, self.navigation_hz)
        noise = np.deg2rad(self.navigation_sigma_deg) * rng.standard_normal((len(t_s), 3))
        noisy = motion(t_s)[:, :, :3] @ so3.exp(noise)
        return SensorStream(t_s, so3.log(noisy), "orientation", "navigation")


@dataclass(frozen=True, eq=False)
class SyntheticDrive:
    """A motion: n frames, M observations of tracks, and what was measured on the way.

    Names and frames are those of :class:`sfmcpp.sources.io.kitti_mat.KittiDrive`, where it has the same.

    Attributes
    ----------
    t_s : (n,) float64
        Time of each frame [s].
    frame_index, track_index : (M,) int32
        Frame and track of each observation, by frame and then by track.
    pixels : (M, 2) float64
        Where the frame sees it [px].
    num_tracks : int
        Number of tracks.
    intrinsics : (5,) float64
        ``(f, aspect, cx, cy, skew)``.
    camera_from_body : (3, 3) float64
        Rotation of the camera's mounting.
    lever_arm_m : (3,) float64
        Centre of the camera in the body frame [m].
    odometer : SensorStream or None
        Speed of the body's origin, kind ``"speed"``; None where nothing rolls.
    angular_rate : SensorStream
        What a gyroscope shows of the body's turning, in the body frame, kind ``"angular_rate"``.
    orientation : SensorStream
        What a navigation system says of the body's orientation, kind ``"orientation"``.
    truth : Trajectory
        True poses of the camera.
    """

    t_s: FloatArray
    frame_index: IndexArray
    track_index: IndexArray
    pixels: FloatArray
    num_tracks: int
    intrinsics: FloatArray
    camera_from_body: FloatArray
    lever_arm_m: FloatArray
    odometer: SensorStream | None
    angular_rate: SensorStream
    orientation: SensorStream
    truth: Trajectory


class Sway:
    """A smooth random motion about zero: sines of several frequencies for each component.

    Parameters
    ----------
    sigmas : (k,) float64
        Standard deviation of each component over a long time, in its unit.
    lowest_hz, highest_hz : float
        Between which the frequencies lie.
    rng : numpy.random.Generator
        Draws frequencies and phases.
    """

    def __init__(
        self, sigmas: FloatArray, lowest_hz: float, highest_hz: float, rng: np.random.Generator
    ) -> None:
        shape = (_WAVES, len(sigmas))
        self._amplitudes = sigmas * np.sqrt(2 / _WAVES)
        self._turns_s = 2 * np.pi * rng.uniform(lowest_hz, highest_hz, shape)
        self._phases = rng.uniform(0, 2 * np.pi, shape)

    def at(self, t_s: FloatArray) -> FloatArray:
        """(n, k) values at times (n,) [s]."""
        waves = np.sin(self._turns_s * t_s[:, None, None] + self._phases)
        return np.asarray(self._amplitudes * waves.sum(axis=1))


def stamps(seconds: float, rate_hz: float) -> FloatArray:
    """Times from 0 to `seconds`, `rate_hz` of them a second."""
    return np.arange(int(np.floor(seconds * rate_hz)) + 1) / rate_hz


def angular_rates(motion: Motion, t_s: FloatArray) -> FloatArray:
    """(n, 3) true angular rates in the body frame [rad/s], by central differences."""
    before = motion(t_s - 0.5 * _DIFFERENCE_S)[:, :, :3]
    after = motion(t_s + 0.5 * _DIFFERENCE_S)[:, :, :3]
    return np.asarray(so3.log(np.swapaxes(before, 1, 2) @ after) / _DIFFERENCE_S)
