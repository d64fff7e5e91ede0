"""What a SLAM run reads: tracks or images, and sensors beside them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sfmcpp.cli.slam_images import ImageStream, open_images
from sfmcpp.cli.slam_job import ImageOptions
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import Mounting, local_positions, require_agreement, require_overlap
from sfmcpp.slam import Gps, Gyroscope, Ins, MotionSensor, Odometer, TrackSequence
from sfmcpp.sources.io.kitti_mat import KittiDrive, read_kitti_mat
from sfmcpp.sources.io.track_files import read_tracks
from sfmcpp.sources.vision import PICTURES, VIDEOS

_ACCEPTED = "a folder of images, a video, a KITTI drive (.mat) or a text file of tracks"
# Kinds of stream that each sensor can use, the best first.
_KINDS: dict[str, tuple[str, ...]] = {
    "odometer": ("distance", "speed", "velocity"),
    "imu": ("angular_rate", "orientation"),
    "gps": ("position", "geodetic"),
    "ins": ("pose",),
}


@dataclass(frozen=True, eq=False)
class Measurements:
    """What sensors measured.

    Attributes
    ----------
    file : Path
        Where it was read from.
    streams : dict of str to SensorStream
        By kind.
    mounting : Mounting or None
        How the camera sits on the body of the sensors, where the file tells.
    image_t_s : (n,) float64 or None
        Times of the images that were taken with it [s], where the file tells.
    """

    file: Path
    streams: dict[str, SensorStream]
    mounting: Mounting | None = None
    image_t_s: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class SlamInput:
    """An input as read.

    Attributes
    ----------
    frames : TrackSequence or ImageStream
        What the frames see.
    truth : Trajectory or None
        True poses, where the input knows them.
    measurements : Measurements
        What came with the tracks; no streams where nothing did.
    """

    frames: TrackSequence | ImageStream
    truth: Trajectory | None
    measurements: Measurements


def read_input(
    source: Path, options: ImageOptions | None = None, measured: Measurements | None = None
) -> SlamInput:
    """Read a drive or a file of tracks, or open images: they are read while the run goes on.

    Parameters
    ----------
    source : Path
        The input.
    options : ImageOptions, optional
        What the user says of images.
    measured : Measurements, optional
        What was measured beside the input; it may know when images were taken.

    Raises
    ------
    DatasetError
        If the file cannot be read, or is of a kind that SLAM does not take.
    InvalidArgument
        If there are options of images for an input that is none.
    """
    options = options or ImageOptions()
    suffix = source.suffix.lower()
    if suffix in PICTURES and not source.is_dir():
        raise DatasetError(source, f"is a single picture: give {_ACCEPTED}")
    try:
        if source.is_dir() or suffix in VIDEOS:
            return _from_images(source, options, measured)
        if options.given:
            raise InvalidArgument(
                "camera, fps, corners: are for images, the input is tracks and holds its own"
            )
        return _from_drive(source) if suffix == ".mat" else _from_tracks(source)
    except InvalidArgument as error:
        raise DatasetError(source, str(error)) from error


def read_measurements(file: Path) -> Measurements:
    """Read the measurements of sensors: a CSV file, or a KITTI drive with its mounting and its stamps.

    Raises
    ------
    DatasetError
        If the file cannot be read.
    """
    if file.suffix.lower() == ".mat":
        return _measurements(file, read_kitti_mat(file))
    from sfmcpp.sources.io.sensor_csv import read_sensor_csv

    return Measurements(file, read_sensor_csv(file))


def sensors_of(
    names: Sequence[str],
    given: SlamInput,
    measured: Measurements | None = None,
    mounting: Mounting | None = None,
) -> list[MotionSensor]:
    """Make the sensors asked for, from what was measured apart, or else from the input.

    Parameters
    ----------
    names : sequence of str
        The sensors.
    given : SlamInput
        The input.
    measured : Measurements, optional
        What was measured apart.
    mounting : Mounting, optional
        How the camera sits on their body, where the user says it.

    Raises
    ------
    DatasetError
        If the file of `measured` lacks what a sensor needs; its streams contradict each other; or a sensor
        was not on while the images were taken.
    InvalidArgument
        If the input lacks what a sensor needs.
    """
    told = mounting or (measured.mounting if measured else None) or given.measurements.mounting
    streams = [_stream_of(name, given, measured) for name in names]
    source = measured or given.measurements
    try:
        require_agreement(source.streams.values() if names else ())
        for stream in streams:
            require_overlap(stream, *_span_s(given.frames))
    except InvalidArgument as error:
        raise DatasetError(source.file, str(error)) from error
    return [_sensor(name, stream, told) for name, stream in zip(names, streams, strict=True)]


def _span_s(frames: TrackSequence | ImageStream) -> tuple[float, float]:
    """Times of the first and the last frame [s]."""
    if isinstance(frames, ImageStream):
        return frames.span_s
    return float(frames.t_s[0]), float(frames.t_s[-1])


def _from_images(source: Path, options: ImageOptions, measured: Measurements | None) -> SlamInput:
    stream, truth = open_images(source, options, None if measured is None else measured.image_t_s)
    return SlamInput(stream, truth, Measurements(source, {}))


def _from_drive(source: Path) -> SlamInput:
    drive = read_kitti_mat(source)
    sequence = TrackSequence(drive.t_s, drive.frame_index, drive.track_index, drive.left_px, drive.intrinsics)
    return SlamInput(sequence, drive.truth, _measurements(source, drive))


def _measurements(file: Path, drive: KittiDrive) -> Measurements:
    streams: dict[str, SensorStream] = {s.kind: s for s in (drive.velocity, drive.angular_rate)}
    return Measurements(file, streams, Mounting(drive.camera_from_body, drive.lever_arm_m), drive.t_s)


def _from_tracks(source: Path) -> SlamInput:
    tracks = read_tracks(source)
    sequence = TrackSequence(
        tracks.t_s, tracks.frame_index, tracks.track_index, tracks.pixels, tracks.intrinsics
    )
    return SlamInput(sequence, None, Measurements(source, {}))


def _stream_of(name: str, given: SlamInput, measured: Measurements | None) -> SensorStream:
    streams = (measured or given.measurements).streams
    stream = next((streams[kind] for kind in _KINDS[name] if kind in streams), None)
    if stream is not None:
        return stream
    wanted = " or ".join(_KINDS[name])
    if measured is not None:
        raise DatasetError(measured.file, f"holds no {wanted}, which the sensor {name!r} needs")
    raise InvalidArgument(f"sensor = {name!r}: the input holds no {wanted}; give --sensor-file")


def _sensor(name: str, stream: SensorStream, mounting: Mounting | None) -> MotionSensor:
    if name == "odometer":
        return Odometer(stream, name)
    if name == "gps":
        local = local_positions(stream) if stream.kind == "geodetic" else stream
        return Gps(local, mounting, name)
    at_camera = mounting or Mounting(np.eye(3), np.zeros(3))
    return Ins(stream, at_camera, name) if name == "ins" else Gyroscope(stream, at_camera, name)
