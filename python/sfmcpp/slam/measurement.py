"""What a sensor is, and what it tells of a keyframe: one constraint on its pose (thesis table 5.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from sfmcpp.model import CONSTRAINT_KINDS, SensorStream
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_positive
from sfmcpp.model.weight_selection import ConflictReport
from sfmcpp.weighting import CONFLICT_SIGMAS

# Kinds that need a map in metres, in the sensor's world.
METRIC_KINDS = tuple(name for name, kind in CONSTRAINT_KINDS.items() if kind.unit == "m")
# Kinds that constrain one keyframe, not the motion from the one before.
PLACE_KINDS = tuple(name for name, kind in CONSTRAINT_KINDS.items() if kind.on_poses and kind.cameras == (1,))


@dataclass(frozen=True, eq=False)
class Measurement:
    """One constraint on a keyframe, or between the one before and it.

    Attributes
    ----------
    sensor : str
        Name of the sensor.
    kind : str
        Row of thesis table 5.1: ``"scale"`` (the distance of the centres), ``"displacement-pose"`` (the pose
        previous_from_this of the camera), ``"displacement-rotation-log"`` (its rotation), ``"position"`` (its
        centre) or ``"pose"``.
    value : float, or (3, 3), (3,) or (3, 4) float64
        Distance [m], rotation, centre [m] or pose world_from_camera.
    sigma : float or None
        Standard deviation of the sensor [m or rad]: bounds its weight, and judges conflicts. None: not known
        (yet).
    doubtful : bool
        Whether the sensor's own stream shows that it cannot be right here; it then has no weight.
    yields : bool
        Whether a conflict with the images lowers its weight (:class:`sfmcpp.weighting.PoseConstraint`).
    slack : float
        A further standard deviation, by the stream [m or rad]: conflicts are judged by both.
    reach : float
        By how much the sensor can be off, beside its noise [m or rad]: images that differ by more are wrong.
    """

    sensor: str
    kind: str
    value: float | FloatArray
    sigma: float | None
    doubtful: bool = False
    yields: bool = True
    slack: float = 0.0
    reach: float = math.inf

    def is_beyond_reach(self, conflict: ConflictReport) -> bool:
        """Whether a conflict with the images is larger than the sensor can be off: these are wrong."""
        noise = math.hypot(conflict.images_sigma, self.sigma or 0.0, self.slack)
        beyond = conflict.discrepancy > self.reach + CONFLICT_SIGMAS * noise
        return conflict.conflicting and beyond and not self.doubtful


def require_sigma(name: str, sigma: float | None) -> None:
    """Raise InvalidArgument unless a standard deviation is positive, or None: estimated during the run."""
    if sigma is not None:
        require_positive(name, sigma)


@runtime_checkable
class MotionSensor(Protocol):
    """A sensor: anything with a name and a stream that can measure keyframes.

    Parameters
    ----------
    *args, **kwargs
        Those of the class that follows this protocol.
    """

    @property
    def name(self) -> str:
        """Name in reports."""

    @property
    def stream(self) -> SensorStream:
        """What it has measured."""

    def measure(self, start_s: float, end_s: float, rotation: FloatArray) -> Measurement | None:
        """Measure a keyframe, or the motion to it from the one before.

        Parameters
        ----------
        start_s, end_s : float
            Times of the keyframe before and of this one [s].
        rotation : (3, 3) float64
            Rotation world_from_camera of this one, as far as it is known: a lever arm needs it.

        Returns
        -------
        Measurement or None
            None where the stream does not cover the time.
        """
