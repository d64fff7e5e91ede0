"""A SLAM run over a drive with its sensors."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import numpy as np

from sfmcpp.ba.checkpoints import CheckpointStore
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arguments import checked
from sfmcpp.model.checks import require_at_most, require_positive, require_share
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.model.named_fields import meant
from sfmcpp.sensors import Mounting, local_positions
from sfmcpp.sensors.geocentric import doubt_of_geocentric
from sfmcpp.sensors.gps import doubt_of_radians, middle_of, require_metres
from sfmcpp.slam.frame_run import Listener, ends_run, run_slam
from sfmcpp.slam.measurement import MotionSensor
from sfmcpp.slam.motion_sensors import Gyroscope, Odometer
from sfmcpp.slam.position_sensors import Gps, Ins
from sfmcpp.slam.result import SlamResult
from sfmcpp.slam.scale_drift import stretches
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import WorldMap
from sfmcpp.sources.drives import Drive, open_drive
from sfmcpp.sources.frames import FrameSource
from sfmcpp.wording import counted, first_few

# A standard deviation, that of an odometer with a share of the distance; None: estimated.
_Sigma = float | tuple[float, float] | None
# Its square is finite, and that of its inverse is not zero.
_LARGEST_SIGMA = 1e100
# Sensors that measure where the camera is in a world of their own.
_ABSOLUTE = {"gps", "ins"}
# Images that a warning names at most.
_NAMED = 3


@dataclass(frozen=True, eq=False, repr=False)
class SlamRun:
    """Result of a run over a drive.

    Attributes
    ----------
    drive : Drive
        What was read.
    settings : SlamSettings
        What decided about keyframes, poses and points.
    sensors : tuple of str
        Names of the sensors used beside the camera.
    result : SlamResult
        The map, the poses, and what happened at each keyframe.
    frames : int
        Frames looked at.
    seconds : float
        How long it took, without opening the drive [s].
    interrupted : bool
        Whether the callback ended it.
    origin : WorldOrigin or None
        Median latitude, longitude and height of the positions, if the map is in metres east, north and up of
        there.
    """

    drive: Drive
    settings: SlamSettings
    sensors: tuple[str, ...]
    result: SlamResult
    frames: int
    seconds: float
    interrupted: bool
    origin: WorldOrigin | None = None

    @property
    def world(self) -> WorldMap | None:
        """The map; None if none could be started, with the reason in `result.message`."""
        return self.result.world

    @property
    def fps(self) -> float:
        """Frames looked at per second."""
        return self.frames / self.seconds if self.seconds > 0 else math.inf

    @property
    def driven_s(self) -> float | None:
        """Time from the first frame looked at to the last [s]; None where their rate is assumed."""
        times = self.result.path.times.values()
        return None if self.drive.frames.assumed_fps is not None or not times else max(times) - min(times)

    @property
    def real_time_factor(self) -> float | None:
        """That time over what the run took: above 1, it keeps up with the camera; None without that time."""
        return None if self.driven_s is None or self.seconds <= 0 else self.driven_s / self.seconds

    @property
    def georeferenced(self) -> bool:
        """Whether the map is in the world of a sensor of positions or poses."""
        return self.result.metric and not _ABSOLUTE.isdisjoint(self.sensors)

    @property
    def totals(self) -> dict[str, int]:
        """Count frames, poses, bridged and lost frames, keyframes and points."""
        result, world = self.result, self.world
        return {
            "frames": self.frames,
            "poses": len(result.poses),
            "bridged": len(result.bridged),
            "lost": len(result.lost),
            "keyframes": 0 if world is None else len(world.keyframes),
            "points": 0 if world is None else int(np.count_nonzero(world.known)),
        }

    def __repr__(self) -> str:
        count = self.totals
        found = f"{count['poses']} poses, {count['keyframes']} keyframes, {count['points']} points"
        used = f" with {', '.join(self.sensors)}" if self.sensors else ""
        return f"SlamRun({str(self.drive.path)!r}{used}: {count['frames']} frames, {found})"

    def trajectory(self) -> Trajectory:
        """All frames with a pose, in order; InvalidArgument, with the reason, if there is none."""
        return self.result.trajectory()


def run(
    source: str | PathLike[str] | Drive,
    sensors: Sequence[str] = (),
    *,
    sigmas: Mapping[str, _Sigma] | None = None,
    weights: str = "loo",
    weight_bounds: str = "declared",
    window: int = 8,
    final_adjustment: str = "auto",
    seed: int = 0,
    callback: Callable[[int, SlamResult], object] | None = None,
    checkpoint: CheckpointStore | None = None,
    resume: CheckpointStore | None = None,
    **opening: Any,
) -> SlamRun:
    """Run SLAM on a camera and other sensors: ``sfmcpp slam`` from Python.

    Parameters
    ----------
    source : path-like or Drive
        A folder of images, a video, a KITTI drive (.mat) or a file of tracks; or what
        :func:`sfmcpp.sources.drives.open_drive` made of one.
    sensors : sequence of str
        Sensors to use beside the camera: ``"odometer"``, ``"imu"``, ``"ins"``, ``"gps"``.
    sigmas : mapping of str to float, tuple or None, optional
        Standard deviation by sensor name: the `sigma_m` [m] or `sigma_rad` [rad] of its class; of the
        odometer also a tuple of its `sigma_m` and its `relative_sigma`, a share of the distance; None:
        estimated during the run. Default: those of the classes.
    weights : str
        How sensor weights are chosen; see :class:`SlamSettings`.
    weight_bounds : str
        Bounds of the weights: ``"declared"``, from the standard deviation of the sensor, or ``"none"``.
    window : int
        Number of keyframes that the local adjustment moves.
    final_adjustment : str
        Whether all keyframes are adjusted together at the end: ``"auto"``, ``"on"`` or ``"off"``; see
        :class:`SlamSettings`.
    seed : int
        Random seed.
    callback : callable, optional
        Called as ``callback(frame, result)`` after each frame, with its number; returning False stops the
        run.
    checkpoint, resume : CheckpointFolder, optional
        Where to save checkpoints, and where to resume from; see :func:`run_slam`.
    **opening
        For a path: the keyword arguments of :func:`sfmcpp.sources.drives.open_drive`, such as `sensor_file`,
        `mounting` and `camera`.

    Returns
    -------
    SlamRun
        Pass it to :class:`sfmcpp.study.SlamReport` to evaluate it against ground truth and write its files.

    Raises
    ------
    DatasetError
        If a file cannot be read, or lacks what is needed.
    InvalidArgument
        If an option is invalid, the input lacks what a sensor needs, or positions look like degrees.
    """
    if isinstance(sensors, str):
        raise InvalidArgument(f"sensors = {sensors!r}: must be a sequence of names, such as [{sensors!r}]")
    _require_known(opening)
    settings = SlamSettings(
        window=window,
        weights=weights,
        weight_bounds=weight_bounds,
        final_adjustment=final_adjustment,
        seed=seed,
    )
    drive = source if isinstance(source, Drive) else open_drive(source, **opening)
    used = motion_sensors(drive, sensors, sigmas)
    listener = _Listener(callback)
    result = run_slam(drive.frames, settings, used, listener, checkpoint, resume)
    result.warnings.extend(_doubts_of_frames(drive.frames, used))
    result.warnings.extend(_doubt_of_right_images(drive.frames, result))
    result.warnings.extend(doubts_of_units(used))
    result.warnings.extend(_losses(drive.frames))
    result.warnings.extend(_repeats(drive.frames))
    frames = len(result.path.times)
    ran = (drive, settings, tuple(sensors), result, frames, result.seconds, listener.ended)
    return SlamRun(*ran, _origin_of(used) if result.metric else None)


def _origin_of(sensors: Sequence[MotionSensor]) -> WorldOrigin | None:
    """Origin of the world of the sensors; None where it is not known, or the world is that of an INS."""
    if any(isinstance(sensor, Ins) for sensor in sensors):
        return None
    return next((sensor.origin for sensor in sensors if isinstance(sensor, Gps)), None)


def _doubts_of_frames(frames: FrameSource, sensors: Sequence[MotionSensor]) -> Iterator[str]:
    """Warn of an assumed rate beside sensors, whose seconds are true ones, and of what frames doubt."""
    if frames.assumption is not None and sensors:
        # Metres a second at the wrong seconds are as many wrong metres.
        yield f"{frames.assumption}; where that is wrong, so are the scale and the clocks of the sensors"
    doubts = (frames.doubt, frames.camera_doubt, frames.mask_doubt)
    yield from (doubt for doubt in doubts if doubt is not None)
    yield from frames.right_doubts


def _doubt_of_right_images(frames: FrameSource, result: SlamResult) -> Iterator[str]:
    """Warn where right images are used, but show nothing nearer than infinity."""
    if frames.right_use is not None and frames.right_use.frames and not result.metric:
        yield (
            "right images give no metric scale: nothing in them is shifted against the left ones; all is too "
            "far away for the baseline, or they are of the same camera"
        )


def doubts_of_units(sensors: Sequence[MotionSensor]) -> Iterator[str]:
    """Warn of sensors whose numbers seem to be in another unit."""
    for sensor in sensors:
        if not isinstance(sensor, Gps):
            continue
        if sensor.origin is not None and sensor.origin.geodetic:
            yield from doubt_of_radians(sensor.origin.place, sensor.stream.values)
        else:
            origin_m = 0.0 if sensor.origin is None else sensor.origin.place
            yield from doubt_of_geocentric(sensor.stream.values + origin_m)


def _losses(frames: FrameSource) -> Iterator[str]:
    """Name images that could not be read, and tell of a video that is damaged."""
    if frames.shortfall is not None:
        yield f"the video is cut short or damaged: {frames.shortfall}"
    if lost := frames.unreadable:
        named = first_few((f"{name}: {reason}" for name, reason in lost.items()), _NAMED)
        images = counted(len(lost), "image is", "images are")
        yield f"{images} left out, as if lost by the camera: {named}"


def _repeats(frames: FrameSource) -> Iterator[str]:
    """Name frames that show the image before once more: a recorder that hangs, or a doubled frame rate."""
    if named := stretches(frames.repeated, near=1):
        count = counted(len(frames.repeated), "frame repeats", "frames repeat")
        where = first_few(named, _NAMED)
        yield f"{count} the image before to the last bit, at {where}: poses are wrong if the camera moved"


def _require_known(opening: Mapping[str, Any]) -> None:
    """Raise TypeError, as Python does for an argument that there is not, by the name of the user's call."""
    known = [*inspect.signature(run).parameters][1:-1] + [*inspect.signature(open_drive).parameters][1:]
    for name in opening:
        if name not in known:
            raise TypeError(f"run() got an unexpected keyword argument {name!r}{meant(name, known)}")


@checked()
def motion_sensors(
    drive: Drive, names: Sequence[str], sigmas: Mapping[str, _Sigma] | None = None
) -> list[MotionSensor]:
    """Make sensors of the streams of a drive, on its mounting.

    Parameters
    ----------
    drive : Drive
        What was measured.
    names : sequence of str
        The sensors: ``"odometer"``, ``"imu"``, ``"ins"``, ``"gps"``.
    sigmas : mapping of str to float, tuple or None, optional
        See :func:`run`.

    Returns
    -------
    list of MotionSensor

    Raises
    ------
    DatasetError
        If the drive's file lacks what a sensor needs, or its streams cannot be right.
    InvalidArgument
        If a sensor is unknown or named twice, or the input lacks what it needs; if positions look like
        degrees, or are latitudes beside poses of an INS; if a σ is not positive, or of no such sensor.
    """
    streams = drive.streams_of(names)
    made = [_MAKERS[name](name, stream, drive.mounting) for name, stream in zip(names, streams, strict=True)]
    _require_one_world(made)
    return _with_sigmas(made, sigmas or {})


def _require_one_world(sensors: Sequence[MotionSensor]) -> None:
    """Refuse poses beside latitudes: nothing tells where the world of the poses is on the earth."""
    worlds = {sensor.name for sensor in sensors if isinstance(sensor, Ins)}
    geodetic = [s.name for s in sensors if isinstance(s, Gps) and s.origin is not None and s.origin.geodetic]
    if worlds and geodetic:
        raise InvalidArgument(
            f"sensor = {geodetic[0]!r}: its latitudes have a world of their own, the poses of "
            f"{worlds.pop()!r} another: positions must be in metres in the world of the poses, or one of the "
            "two sensors left out"
        )


def _with_sigmas(sensors: list[MotionSensor], sigmas: Mapping[str, _Sigma]) -> list[MotionSensor]:
    known = [sensor.name for sensor in sensors]
    for name in sigmas:
        if name not in known:
            raise InvalidArgument(
                f"sigmas: {name!r} is none of the sensors used: {', '.join(known) or 'none'}"
            )
    return [
        replace(sensor, **_declared(sensor, sigmas[sensor.name])) if sensor.name in sigmas else sensor  # type: ignore[type-var]
        for sensor in sensors
    ]


def _declared(sensor: MotionSensor, sigma: _Sigma) -> dict[str, float | None]:
    """What a sensor is told of its standard deviation, by the fields of its class."""
    name = f"sigmas[{sensor.name!r}]"
    share: dict[str, float] = {}
    if isinstance(sigma, tuple):
        if not isinstance(sensor, Odometer) or len(sigma) != 2:
            rule = "must be a number, or of the odometer metres and a share of the distance"
            raise InvalidArgument(f"{name} = {sigma}: {rule}")
        sigma, share["relative_sigma"] = sigma
        require_share(name, share["relative_sigma"])
    if sigma is not None:
        require_positive(name, sigma)
        require_at_most(name, sigma, _LARGEST_SIGMA)
        if sigma < 1 / _LARGEST_SIGMA:
            raise InvalidArgument(f"{name} = {sigma}: must be at least {1 / _LARGEST_SIGMA:g}")
    return {_SIGMAS[type(sensor)]: sigma, **share}


def _gps(name: str, stream: SensorStream, mounting: Mounting | None) -> Gps:
    if stream.kind == "position":
        require_metres(stream.values)
    if stream.kind != "geodetic":
        return Gps(stream, mounting, name)
    middle = middle_of(stream.values)  # the first may be an outlier
    return Gps(local_positions(stream, middle), mounting, name, origin=WorldOrigin(middle, geodetic=True))


def _mounting_at_camera(mounting: Mounting | None) -> Mounting:
    return mounting or Mounting(np.eye(3), np.zeros(3))


_MAKERS: dict[str, Callable[[str, SensorStream, Mounting | None], MotionSensor]] = {
    "odometer": lambda name, stream, mounting: Odometer(stream, name, mounting=mounting),
    "imu": lambda name, stream, mounting: Gyroscope(stream, _mounting_at_camera(mounting), name),
    "ins": lambda name, stream, mounting: Ins(stream, _mounting_at_camera(mounting), name),
    "gps": _gps,
}


# The field of each class that declares its standard deviation.
_SIGMAS: dict[type, str] = {Odometer: "sigma_m", Gyroscope: "sigma_rad", Ins: "sigma_m", Gps: "sigma_m"}


class _Listener:
    """Passes frames on, and remembers whether one ended the run."""

    def __init__(self, callback: Listener | None) -> None:
        self._callback, self.ended = callback, False

    def __call__(self, frame: int, result: SlamResult) -> bool:
        self.ended = ends_run(self._callback, frame, result)
        return not self.ended
