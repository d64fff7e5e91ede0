"""Faults that are put into the sensors of drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.sensors import Mounting


@dataclass(frozen=True, eq=False)
class SensorFaults:
    """Faults of sensors of a real drive: a slip or a bias for a while, a clock or mounting throughout.

    Attributes
    ----------
    start_s, seconds : float
        When slip and bias begin, after the first sample, and how long they last [s].
    factor : float
        What speeds are multiplied by meanwhile.
    smooth : bool
        Whether the factor grows to that in the middle and falls again, as a squared sine; else it jumps.
    bias_deg_s : float
        What is added to yaw rates meanwhile [deg/s].
    clock_s : float
        What is added to all stamps [s].
    mounting_deg : float
        Rotation of the declared mounting about the body's z axis [deg].
    """

    start_s: float
    seconds: float
    factor: float = 1.0
    smooth: bool = False
    bias_deg_s: float = 0.0
    clock_s: float = 0.0
    mounting_deg: float = 0.0

    def during(self, t_s: np.ndarray, first_s: float) -> np.ndarray:
        """Which of the stamps (n,) slip and bias cover, those of the run beginning at `first_s` [s]."""
        return np.asarray((t_s - first_s >= self.start_s) & (t_s - first_s < self.start_s + self.seconds))

    def strength(self, t_s: np.ndarray) -> np.ndarray:
        """Strength (n,) of slip and bias at the stamps of a stream, from 0 to 1."""
        during = self.during(t_s, t_s[0])
        if not self.smooth:
            return during.astype(float)
        return during * np.sin(np.pi * (t_s - t_s[0] - self.start_s) / self.seconds) ** 2

    def spoil(self, stream: SensorStream) -> SensorStream:
        """The stream of speeds or rates with its faults."""
        values, strength = stream.values.copy(), self.strength(stream.t_s)
        if stream.kind == "angular_rate":
            values[:, 2] += np.radians(self.bias_deg_s) * strength
        else:
            values *= 1 + (self.factor - 1) * strength[:, None]
        return SensorStream(stream.t_s + self.clock_s, values, stream.kind, stream.name)

    def misplace(self, mounting: Mounting) -> Mounting:
        """The mounting as it is then declared."""
        turned = so3.exp(np.radians(self.mounting_deg) * np.array([0.0, 0.0, 1.0]))
        return Mounting(mounting.camera_from_body @ turned, mounting.lever_arm_m)


@dataclass(frozen=True)
class Flaws:
    """Faults of the orientations of a synthetic drive, beside their own noise.

    Attributes
    ----------
    sigma_deg : sequence of float
        Standard deviation of white noise about each axis, one for each of as many equal stretches [deg].
    clock_s : float
        What is added to all stamps [s].
    mounting_deg : float
        Rotation of the sensor's axes, about a random direction [deg].
    """

    sigma_deg: Sequence[float] = (0.0,)
    clock_s: float = 0.0
    mounting_deg: float = 0.0

    def spoil(self, stream: SensorStream, seed: int) -> SensorStream:
        """The stream of orientations with these faults."""
        rng = np.random.default_rng([seed, 1])
        axis = rng.standard_normal(3)
        turned = so3.exp(np.radians(self.mounting_deg) * axis / np.linalg.norm(axis))
        stretch = np.arange(len(stream)) * len(self.sigma_deg) // len(stream)
        sigmas = np.radians(np.asarray(self.sigma_deg)[stretch])[:, None]
        noise = so3.exp(sigmas * rng.standard_normal((len(stream), 3)))
        spoilt = so3.log(so3.exp(stream.values) @ turned @ noise)
        return SensorStream(stream.t_s + self.clock_s, spoilt, stream.kind, stream.name)
