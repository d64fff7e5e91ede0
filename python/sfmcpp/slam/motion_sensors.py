"""Sensors as sources of motions from keyframe to keyframe: odometer, gyroscope."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sfmcpp.model import Gap, SensorStream
from sfmcpp.model.arguments import check_fields
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_not_negative
from sfmcpp.sensors import (
    Mounting,
    carried_over,
    doubtful_stretches,
    rotation_increment,
    sampling_variance,
    travelled_distance,
    without_counter_leaps,
)
from sfmcpp.sensors.bridged_gaps import bridgeable_gaps, with_gaps_bridged
from sfmcpp.sensors.frozen_speed import frozen_stretches
from sfmcpp.sensors.odometer import displacement_along
from sfmcpp.sensors.stream import is_coarse, prediction_sigma
from sfmcpp.slam.measurement import Measurement, require_sigma
from sfmcpp.slam.position_sensors import Gps, Ins

# Where rates are sampled seven times in a sway, rotations are off by 0.1 to 0.3 of what the samples show
# beside their neighbours (simulated walkers); where the errors of rates are independent, by all of it. Those
# of 0001, 0027, 0036 and 0039 with a sample each 0.2 s by 0.22 to 0.31, each 0.5 or 1 s by 0.33 to 0.78.
_LEAST_SHARE, _COARSE_SHARE = 0.25, 0.6
# Where a speed is interpolated over a stretch, its error grows so fast from either end. Over gaps, beside
# which the stream is sound, it does by 0.05 to 0.3 m/s² (root mean squares of 0001, 0027, 0036 and 0039), by
# 0.9 at most.
_CARRIED_M_S2, _BRIDGED_M_S2 = 1.0, 0.5


@dataclass(frozen=True, eq=False)
class Odometer:
    """Distances and directions of the motion from one keyframe to the next.

    A stream of velocities constrains the displacement of the camera: images leave its direction open by a
    degree or more, as they confuse a sideways motion with a rotation. A stream of speeds or distances
    constrains the scale ‖c_i − c_{i−1}‖ alone (thesis eq. 5.20), and so do velocities if σ or the mounting
    is not known.

    Where the speed leaps as no vehicle's can and leaps back, or its last value is repeated until it leaps, it
    is interpolated between, with a larger standard deviation; where it does not leap back, it has no weight.
    A way that leaps once and goes on as before was counted from another origin, and loses the leap. The speed
    is interpolated over gaps of at most five seconds, too.

    A scale does not yield to the images: an odometer that yields has no weight for twenty keyframes after one
    at which the map lost its scale; a sudden slip shows in the stream; a slow one is followed by the map
    before there is a conflict. A displacement does yield: its direction holds the map better, and of a slow
    slip it follows half.

    Attributes
    ----------
    stream : SensorStream
        Of kind ``"speed"``, ``"distance"`` or ``"velocity"``.
    name : str
        Name in reports.
    sigma_m : float, optional
        Standard deviation of a distance, or of each coordinate of a displacement [m]; None: estimated during
        the run.
    relative_sigma : float
        A further one, as a share of the distance. Steps of KITTI's navigation unit over a second are 0.7 to
        1.2 % off in each coordinate (root mean square; drives 0001, 0027, 0036, 0039). The default is larger:
        with 0.01 more fault-free runs warn of a sensor, and some maps follow a slow slip further.
    mounting : Mounting, optional
        How the camera sits on the body: distances are then those of the camera where a turn is given.
    directions : bool
        Whether velocities constrain displacements; else their distances, as in the thesis.

    Raises
    ------
    InvalidArgument
        If a value is of another type, `sigma_m` is not positive, or `relative_sigma` is negative.
    """

    stream: SensorStream
    name: str = "odometer"
    sigma_m: float | None = 0.02
    relative_sigma: float = 0.03
    mounting: Mounting | None = None
    directions: bool = True

    def __post_init__(self) -> None:
        check_fields(self, "stream", "name", "mounting", "directions")
        require_sigma("sigma_m", self.sigma_m)
        require_not_negative("relative_sigma", self.relative_sigma)

    @cached_property
    def frozen_stretches(self) -> tuple[Gap, ...]:
        """Where it repeats its last value, which the speed no longer has."""
        return () if self.stream.kind == "distance" else frozen_stretches(self.stream)

    @cached_property
    def jumping_stretches(self) -> tuple[Gap, ...]:
        """Where its speed is one that no vehicle can have driven; a frozen one leaps for another reason."""
        frozen = self._ended(self.frozen_stretches)
        return doubtful_stretches(carried_over(self.stream, frozen) if frozen else self._counted_on)

    @property
    def doubtful_stretches(self) -> tuple[Gap, ...]:
        """Where its speed cannot be right."""
        return self.frozen_stretches + self.jumping_stretches

    @cached_property
    def carried_stretches(self) -> tuple[Gap, ...]:
        """Doubtful stretches over which the speed is interpolated, as there is a sound one at their end."""
        return () if self.stream.kind == "distance" else self._ended(self.doubtful_stretches)

    def _ended(self, stretches: tuple[Gap, ...]) -> tuple[Gap, ...]:
        return tuple(gap for gap in stretches if gap.end_s <= self.stream.t_s[-1])

    @cached_property
    def bridged_gaps(self) -> tuple[Gap, ...]:
        """Gaps of the stream over which the speed is interpolated."""
        return bridgeable_gaps(self.stream)

    @cached_property
    def _stream_without_leaps(self) -> SensorStream:
        carried = self.carried_stretches
        even = carried_over(self.stream, carried) if carried else self._counted_on
        return with_gaps_bridged(even, self.bridged_gaps) if self.bridged_gaps else even

    @cached_property
    def _counted_on(self) -> SensorStream:
        """The stream, its way without leaps of a counter."""
        return without_counter_leaps(self.stream) if self.stream.kind == "distance" else self.stream

    def between(self, start_s: float, end_s: float, turn: FloatArray | None = None) -> float | None:
        """Distance travelled [m]; None where it is not measured, or doubtful."""
        return None if self._is_doubtful(start_s, end_s) else self._distance(start_s, end_s, turn)

    def measure(
        self, start_s: float, end_s: float, rotation: FloatArray, turn: FloatArray | None = None
    ) -> Measurement | None:
        """Motion from the keyframe before; of the camera, if its `turn` is given (see :meth:`step`)."""
        step = self.step(start_s, end_s, turn)
        distance = self._distance(start_s, end_s, turn)
        if distance is None:
            return None
        sigma_m = self._sigma_m(start_s, end_s, distance)
        doubtful = self._is_doubtful(start_s, end_s)
        directed = self.directions and self.stream.kind == "velocity" and sigma_m is not None
        if directed and turn is not None and step is not None:
            value = np.column_stack([turn.reshape(-1, 3, 3)[-1], step])
            return Measurement(self.name, "displacement-pose", value, sigma_m, doubtful)
        return Measurement(self.name, "scale", distance, sigma_m, doubtful, yields=False)

    def _sigma_m(self, start_s: float, end_s: float, distance: float) -> float | None:
        if self.sigma_m is None:
            return None
        middle_s, length_s = 0.5 * (start_s + end_s), end_s - start_s
        carried_m = _CARRIED_M_S2 * length_s * _seconds_within(self.carried_stretches, middle_s)
        bridged_m = _BRIDGED_M_S2 * length_s * _seconds_within(self.bridged_gaps, middle_s)
        within_m = np.linalg.norm([self.sigma_m, self.relative_sigma * distance, carried_m, bridged_m])
        return float(np.hypot(within_m, prediction_sigma(self.stream, start_s, end_s)))

    def step(self, start_s: float, end_s: float, turn: FloatArray | None) -> FloatArray | None:
        """Step (3,) of the camera in its axes at the start [m], by its `turn` (3, 3), or turns on the way."""
        if self.mounting is None or turn is None:
            return None
        return displacement_along(self._stream_without_leaps, start_s, end_s, self.mounting, turn)

    def _distance(self, start_s: float, end_s: float, turn: FloatArray | None) -> float | None:
        step = self.step(start_s, end_s, turn)
        if step is not None:
            return float(np.linalg.norm(step))
        distance = travelled_distance(self._stream_without_leaps, start_s, end_s)
        return None if distance is None else abs(distance)

    def _is_doubtful(self, start_s: float, end_s: float) -> bool:
        return any(
            gap.start_s < end_s and start_s < gap.end_s
            for gap in self.doubtful_stretches
            if gap not in self.carried_stretches
        )


def _seconds_within(gaps: Sequence[Gap], time_s: float) -> float:
    """Time from the nearer end of the gap that a time is in [s]; 0 outside."""
    return sum(max(0.0, min(time_s - gap.start_s, gap.end_s - time_s)) for gap in gaps)


@dataclass(frozen=True, eq=False)
class Gyroscope:
    """Rotations: constrains the rotation from one keyframe to the next (thesis eq. 5.21).

    Rates that are sampled too slowly for a shaking body have larger errors than declared. The stream shows
    where and by how much at most (:func:`sfmcpp.sensors.sampling_variance`). Conflicts are judged by that.
    Weights are chosen by a quarter of it, where that is more than declared (of samples more than 0.3 s apart
    by six tenths): all of it costs more than it gains on drives, as images with few tracks are worse still.

    Attributes
    ----------
    stream : SensorStream
        Of kind ``"angular_rate"``, ``"orientation"`` or ``"pose"``.
    mounting : Mounting
        How the camera sits on the body.
    name : str
        Name in reports.
    sigma_rad : float, optional
        Standard deviation of the rotation from one keyframe to the next, about each axis [rad]; None:
        estimated during the run. Of KITTI's navigation unit, against its own filtered poses: 0.6 to 2.3 mrad
        root mean square over 0.2 s, 0.8 to 3 over 0.5 s, 1.0 to 3.9 over 1 s (drives 0001, 0027, 0036, 0039).
    drift_rad_sqrt_s : float
        A further random walk [rad/√s]; in a run at least 0.004 once a bias was removed, as that will change.

    Raises
    ------
    InvalidArgument
        If a value is of another type, `sigma_rad` is not positive, or `drift_rad_sqrt_s` is negative.
    """

    stream: SensorStream
    mounting: Mounting
    name: str = "gyro"
    sigma_rad: float | None = 0.001
    drift_rad_sqrt_s: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self, "stream", "mounting", "name")
        require_sigma("sigma_rad", self.sigma_rad)
        require_not_negative("drift_rad_sqrt_s", self.drift_rad_sqrt_s)

    def between(self, start_s: float, end_s: float) -> FloatArray | None:
        """Rotation (3, 3) of the camera, start_from_end."""
        turn = rotation_increment(self.stream, start_s, end_s)
        return None if turn is None else self.mounting.camera_rotation(turn)

    def measure(self, start_s: float, end_s: float, rotation: FloatArray) -> Measurement | None:
        """Rotation from the keyframe before."""
        turn = self.between(start_s, end_s)
        if turn is None:
            return None
        slack_rad = self._sampling_rad(start_s, end_s)
        share = _COARSE_SHARE if is_coarse(self.stream) else _LEAST_SHARE
        sigma_rad = self._sigma_rad(start_s, end_s, share * slack_rad)
        return Measurement(self.name, "displacement-rotation-log", turn, sigma_rad, slack=slack_rad)

    def _sigma_rad(self, start_s: float, end_s: float, least_rad: float) -> float | None:
        if self.sigma_rad is None:
            return None
        drift_rad = self.drift_rad_sqrt_s * np.sqrt(end_s - start_s)
        more_rad = np.hypot(drift_rad, prediction_sigma(self.stream, start_s, end_s))
        return max(float(np.hypot(self.sigma_rad, more_rad)), least_rad)

    def _sampling_rad(self, start_s: float, end_s: float) -> float:
        start, end = np.interp([start_s, end_s], self.stream.t_s, self._gathered_variance)
        return float(np.sqrt(end - start))

    @cached_property
    def _gathered_variance(self) -> FloatArray:
        return sampling_variance(self.stream)


# Sensors whose stream can be extended, shifted and corrected.
STAMPED = (Odometer, Gyroscope, Gps, Ins)
