"""What a SLAM run reads: tracks, and sensors beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.io.kitti_mat import KittiDrive, read_kitti_mat
from sfmcpp.io.track_files import read_tracks
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.sensors import Mounting
from sfmcpp.slam import Gyroscope, MotionSensor, Odometer, TrackSequence

ACCEPTED = "a KITTI drive (.mat) or a text file of tracks ('# sfmcpp tracks')"
_PICTURES = (".png", ".jpg", ".jpeg", ".ppm", ".pgm", ".tif", ".tiff", ".bmp")
_VIDEOS = (".mp4", ".avi", ".mkv", ".mov", ".webm", ".m4v")
# Kinds of stream that each sensor can use, the best first.
_KINDS: dict[str, tuple[str, ...]] = {
    "odometer": ("distance", "speed", "velocity"),
    "imu": ("angular_rate", "orientation"),
}


@dataclass(frozen=True, eq=False)
class SlamInput:
    """An input as read.

    Attributes
    ----------
    sequence : TrackSequence
        What the frames see.
    truth : Trajectory or None
        True poses, where the input knows them.
    streams : dict of str to SensorStream
        Measurements that came with the tracks, by kind.
    mounting : Mounting
        How the camera sits on the body of the sensors; the camera itself where the input does not tell.
    """

    sequence: TrackSequence
    truth: Trajectory | None
    streams: dict[str, SensorStream]
    mounting: Mounting


def read_input(source: Path) -> SlamInput:
    """Read a drive or a file of tracks.

    Raises
    ------
    DatasetError
        If the file cannot be read, or is of a kind that SLAM does not take.
    """
    if source.is_dir() or source.suffix.lower() in _PICTURES + _VIDEOS:
        kind = "a folder" if source.is_dir() else "a video or a picture"
        raise DatasetError(source, f"is {kind}: images are not tracked yet, give {ACCEPTED}")
    try:
        return _from_drive(source) if source.suffix.lower() == ".mat" else _from_tracks(source)
    except InvalidArgument as error:
        raise DatasetError(source, str(error)) from error


def sensors_of(names: Sequence[str], file: Path | None, given: SlamInput) -> list[MotionSensor]:
    """Make the sensors asked for, from the streams of `file`, or else of the input.

    Raises
    ------
    DatasetError
        If `file` cannot be read, or lacks what a sensor needs.
    InvalidArgument
        If a sensor is not supported, or a file is given and no sensor.
    """
    if file is not None and not names:
        raise InvalidArgument("sensor_file: no --sensor is named that could use it")
    for name in names:
        if name not in _KINDS:
            raise InvalidArgument(f"sensor = {name!r}: is not supported yet; choose {', '.join(_KINDS)}")
    streams = given.streams if file is None else _read_streams(file)
    return [_sensor(name, streams, file, given.mounting) for name in names]


def _from_drive(source: Path) -> SlamInput:
    drive = read_kitti_mat(source)
    sequence = TrackSequence(
        drive.t_s, drive.frame_index, drive.track_index, drive.left_px, _intrinsics(drive)
    )
    streams = {stream.kind: stream for stream in (drive.velocity, drive.angular_rate)}
    mounting = Mounting(drive.camera_from_body, drive.lever_arm_m)
    return SlamInput(sequence, drive.truth, dict(streams), mounting)


def _intrinsics(drive: KittiDrive) -> np.ndarray:
    (fu, fv), (cu, cv) = drive.focal_px, drive.principal_point_px
    return np.array([fu, fv / fu, cu, cv, 0.0])


def _from_tracks(source: Path) -> SlamInput:
    tracks = read_tracks(source)
    sequence = TrackSequence(
        tracks.t_s, tracks.frame_index, tracks.track_index, tracks.pixels, tracks.intrinsics
    )
    return SlamInput(sequence, None, {}, Mounting(np.eye(3), np.zeros(3)))


def _read_streams(file: Path) -> dict[str, SensorStream]:
    from sfmcpp.io.sensor_csv import read_sensor_csv

    return read_sensor_csv(file)


def _sensor(
    name: str, streams: dict[str, SensorStream], file: Path | None, mounting: Mounting
) -> MotionSensor:
    stream = next((streams[kind] for kind in _KINDS[name] if kind in streams), None)
    if stream is None:
        wanted = " or ".join(_KINDS[name])
        if file is not None:
            raise DatasetError(file, f"holds no {wanted}, which the sensor {name!r} needs")
        raise InvalidArgument(f"sensor = {name!r}: the input holds no {wanted}; give --sensor-file")
    return Odometer(stream, name) if name == "odometer" else Gyroscope(stream, mounting, name)
