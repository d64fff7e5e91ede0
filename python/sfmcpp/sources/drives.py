"""Drives: frames of a camera, sensor streams, and ground truth where it is known."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import NamedTuple

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import looked_up
from sfmcpp.model.sensor_stream import SENSORS
from sfmcpp.sensors import Mounting, require_agreement, require_overlap
from sfmcpp.sources.cameras import find_camera
from sfmcpp.sources.frames import FrameSource, TrackSequence
from sfmcpp.sources.image_stream import CameraArgument, camera_path, open_images
from sfmcpp.sources.io.files import failures_named, is_folder, is_regular_file
from sfmcpp.sources.io.kitti_mat import KittiDrive, read_kitti_mat
from sfmcpp.sources.io.sensor_columns import columns_of
from sfmcpp.sources.io.sensor_csv import left_out_columns, read_sensor_csv
from sfmcpp.sources.io.track_files import read_tracks
from sfmcpp.sources.io.trajectories import read_trajectory
from sfmcpp.sources.mounting_files import clock_offset_of, mounting_beside_camera, mounting_of
from sfmcpp.sources.stereo_pair import StereoArgument
from sfmcpp.sources.vision import CORNERS, PICTURES, VIDEOS

_ACCEPTED = "a folder of images, EuRoC's mav0, a video, a KITTI drive (.mat) or a text file of tracks"
_ROOT, _IMAGES, _RATES = "mav0", "cam0/data", "imu0/data.csv"
_TRUTH = "state_groundtruth_estimate0/data.csv"


@dataclass(frozen=True, eq=False, repr=False)
class Drive:
    """Input of a SLAM run: frames, sensors, truth.

    Attributes
    ----------
    path : Path
        The input.
    frames : FrameSource
        What the frames see; images are read while a run goes on.
    truth : Trajectory or None
        True poses, where the input knows them.
    streams : mapping of str to SensorStream
        What sensors measured, by kind.
    mounting : Mounting or None
        How the camera sits on the body of the sensors, where the user or a file tells.
    sensor_files : tuple of Path
        Where the streams come from that are not the input's own.
    file_of : mapping of str to Path
        Which of these each stream comes from, by kind; without those of the input.
    clock_offset_s : float
        Camera time − sensor time, which the stamps of the streams have had added [s].
    seconds_read : float
        Spent on opening it [s].
    """

    path: Path
    frames: FrameSource
    truth: Trajectory | None = None
    streams: Mapping[str, SensorStream] = field(default_factory=dict)
    mounting: Mounting | None = None
    sensor_files: tuple[Path, ...] = ()
    file_of: Mapping[str, Path] = field(default_factory=dict)
    clock_offset_s: float = 0.0
    seconds_read: float = 0.0

    def __repr__(self) -> str:
        known = [*self.streams, *(["truth"] if self.truth is not None else [])]
        beside = f", {', '.join(known)}" if known else ""
        return f"Drive({str(self.path)!r}: {len(self.frames)} frames{beside})"

    def streams_of(self, sensors: Sequence[str]) -> list[SensorStream]:
        """Find the best stream for each of the `sensors`, by their names.

        Raises
        ------
        DatasetError
            If the file of sensors lacks what a sensor needs; its streams contradict each other; or a sensor
            was not on while the images were taken.
        InvalidArgument
            If the input lacks what a sensor needs, or a sensor is unknown or named twice.
        """
        found = [self._stream_of(name) for name in sensors]
        if len(set(sensors)) < len(sensors):
            raise InvalidArgument(f"sensors = {list(sensors)}: one is named twice")
        try:
            require_agreement(list(self.streams.values()) if sensors else ())
        except InvalidArgument as error:
            raise self._contradiction(str(error)) from error
        for stream in found:
            try:
                require_overlap(stream, *self.frames.span_s)
            except InvalidArgument as error:
                assumed = self.frames.assumption
                reason = f"{error}" if assumed is None else f"{error}; but {assumed}"
                raise DatasetError(self.file_of.get(stream.kind, self.path), reason) from error
        return found

    def _contradiction(self, reason: str) -> DatasetError:
        """Error in streams, which names the files that hold them."""
        files = {self.file_of.get(kind, self.path) for kind in self.streams}
        if len(files) == 1:
            return DatasetError(files.pop(), reason)
        held = ", ".join(f"{kind!r} of {self.file_of.get(kind, self.path).name}" for kind in self.streams)
        return DatasetError(self.path, f"{reason} The streams are {held}")

    def _stream_of(self, name: str) -> SensorStream:
        kinds = looked_up("sensor", name, SENSORS)
        for kind in kinds:
            if kind in self.streams:
                return self.streams[kind]
        wanted = " or ".join(map(_with_columns, kinds))
        if self.sensor_files:
            last = self.sensor_files[-1]
            others = "" if len(self.sensor_files) == 1 else ", nor do the other sensor files"
            reason = f"holds no {wanted}{others}, which the sensor {name!r} needs"
            raise DatasetError(last, reason + _ignored_columns_text(last))
        raise InvalidArgument(f"sensor = {name!r}: the input holds no {wanted}; give --sensor-file")


def _ignored_columns_text(path: Path) -> str:
    """Note on the columns of a sensor file with unknown names."""
    if path.suffix.lower() not in (".csv", ".txt"):
        return ""
    names = ", ".join(repr(name) for name in left_out_columns(path))
    return f"; left out, as their names are unknown: {names}" if names else ""


def _with_columns(kind: str) -> str:
    columns = columns_of(kind)
    return kind if columns == kind else f"{kind} (columns {columns})"


def open_drive(
    path: str | PathLike[str],
    *,
    sensor_file: str | PathLike[str] | Sequence[str | PathLike[str]] | None = None,
    sensor_columns: Mapping[str, str | float] | None = None,
    mounting: str | Path | Mounting | None = None,
    camera: CameraArgument = None,
    fps: float | None = None,
    corners: str = CORNERS[0],
    stereo: bool = False,
    right: str | PathLike[str] | None = None,
    baseline_m: float | None = None,
    clock_offset_s: float | None = None,
    mask: str | PathLike[str] | None = None,
) -> Drive:
    """Open images or read tracks, with the sensors and the truth that come with them.

    Parameters
    ----------
    path : path-like
        A folder of images or a video; ``mav0`` of EuRoC, or the folder that holds it, with the images of
        ``cam0``, rates of ``imu0`` and the truth; or tracks: a KITTI drive (.mat), or a text file.
    sensor_file : path-like or sequence of them, optional
        Sensors' measurements: CSV, or a KITTI drive (.mat), which also knows when the images were taken.
        Those of the input serve the other sensors.
    sensor_columns : mapping of str to str or float, optional
        Columns of the one file, where it is a CSV with names of its own:
        ``{"t [ms]": "Time", "speed [km/h]": "Wheel"}``; see
        :func:`sfmcpp.sources.io.sensor_csv.read_sensor_csv`.
    mounting : str, Path or Mounting, optional
        How the camera sits on the body of the sensors; see :func:`sfmcpp.sources.mounting_files.mounting_of`.
        Default: what a drive tells, or ``T_BS`` or ``T_cam_imu`` of a camera in the form of EuRoC or Kalibr.
    camera : path-like or sequence of float, optional
        Of images; see :func:`sfmcpp.sources.image_stream.open_images`.
    fps : float, optional
        Of images; see :func:`sfmcpp.sources.image_stream.open_images`.
    corners : str
        Of images; see :func:`sfmcpp.sources.image_stream.open_images`.
    stereo : bool
        Whether to take what the right camera sees, too: of a KITTI drive, or of images with a folder of right
        ones beside them (``cam1``, ``image_1``, ``image_r``, ``right``).
    right : path-like, optional
        Right images where they are elsewhere, a folder or a video; with `stereo` or without.
    baseline_m : float, optional
        How far the right camera of a rectified pair is beside the left one [m]; with `stereo` or without.
        Default: what files tell; see :mod:`sfmcpp.sources.stereo_pair`.
    clock_offset_s : float, optional
        Camera time − sensor time, added to every stamp of the sensors [s]. Default: −``timeshift_cam_imu`` if
        `mounting`, or else `camera`, is a file of Kalibr with one, else 0.
    mask : path-like, optional
        Of images; see :func:`sfmcpp.sources.image_stream.open_images`.

    Returns
    -------
    Drive

    Raises
    ------
    DatasetError
        If a file cannot be read, is of a kind that is not taken, or measures what another one does; if there
        are options of images for tracks.
    InvalidArgument
        If `clock_offset_s` is not finite, or `sensor_columns` are none, or not of one CSV.
    """
    started = time.perf_counter()
    source = Path(path)
    files = _paths(sensor_file)
    apart = _read_all_sensors(files, sensor_columns)
    try:
        with failures_named(source):
            of_images = _OfImages(camera, fps, corners, mask, right, baseline_m)
            frames, truth, own = _read_input(source, of_images, stereo, apart)
    except InvalidArgument as error:
        raise DatasetError(source, str(error)) from error
    how = mounting_of(mounting) or apart.mounting or own.mounting
    seconds = time.perf_counter() - started
    told = mounting if mounting is not None else camera_path(camera)
    offset_s = clock_offset_of(told) if clock_offset_s is None else clock_offset_s
    streams = {kind: stream.shifted(offset_s) for kind, stream in apart.beside(own).items()}
    return Drive(source, frames, truth, streams, how, files, apart.file_of, offset_s, seconds)


@dataclass(frozen=True, eq=False)
class _Sensors:
    """Streams by kind, and their files; mounting and times of images, where a file tells them."""

    streams: Mapping[str, SensorStream] = field(default_factory=dict)
    mounting: Mounting | None = None
    image_t_s: FloatArray | None = None
    file_of: Mapping[str, Path] = field(default_factory=dict)

    def beside(self, own: _Sensors) -> dict[str, SensorStream]:
        """Its streams, and of the input's `own` those of sensors that it has nothing for."""
        served = {kind for kinds in SENSORS.values() if self.streams.keys() & {*kinds} for kind in kinds}
        return {**{k: s for k, s in own.streams.items() if k not in served}, **self.streams}


def _paths(sensor_file: str | PathLike[str] | Sequence[str | PathLike[str]] | None) -> tuple[Path, ...]:
    if sensor_file is None:
        return ()
    one = isinstance(sensor_file, (str, PathLike))
    return tuple(map(Path, [sensor_file] if one else sensor_file))  # type: ignore[arg-type]


def _read_all_sensors(files: Sequence[Path], columns: Mapping[str, str | float] | None) -> _Sensors:
    if columns and len(files) != 1:
        told = f"there are {len(files)} sensor files" if files else "there is no sensor file"
        raise InvalidArgument(f"sensor_columns: {told}: must be one, which holds them")
    found = [_read_sensors(file, columns) for file in files]
    streams: dict[str, SensorStream] = {}
    file_of: dict[str, Path] = {}
    for file, sensors in zip(files, found, strict=True):
        twice = streams.keys() & sensors.streams.keys()
        if twice:
            raise DatasetError(file, f"holds {min(twice)}, as another sensor file does: must be in one")
        streams |= sensors.streams
        file_of |= dict.fromkeys(sensors.streams, file)
    mounting = next((some.mounting for some in found if some.mounting is not None), None)
    image_t_s = next((some.image_t_s for some in found if some.image_t_s is not None), None)
    return _Sensors(streams, mounting, image_t_s, file_of)


def _read_sensors(file: Path, columns: Mapping[str, str | float] | None) -> _Sensors:
    if file.suffix.lower() == ".mat":
        if columns:
            raise InvalidArgument("sensor_columns: a KITTI drive (.mat) has no columns")
        return _sensors_of(read_kitti_mat(file))
    return _Sensors(read_sensor_csv(file, columns=columns))


def _sensors_of(drive: KittiDrive) -> _Sensors:
    streams: dict[str, SensorStream] = {s.kind: s for s in (drive.velocity, drive.angular_rate)}
    return _Sensors(streams, Mounting(drive.camera_from_body, drive.lever_arm_m), drive.t_s)


def tracks_of_kitti(drive: KittiDrive, *, stereo: bool = False) -> TrackSequence:
    """Tracks of the left camera of a KITTI drive; with `stereo` also what the right one sees of them."""
    seen = (drive.frame_index, drive.track_index, drive.left_px)
    right = (drive.right_px, drive.baseline_m) if stereo else ()
    return TrackSequence(drive.t_s, *seen, drive.intrinsics, *right)


class _OfImages(NamedTuple):
    """What is told of images; tracks hold their own."""

    camera: CameraArgument = None
    fps: float | None = None
    corners: str = CORNERS[0]
    mask: str | PathLike[str] | None = None
    right: str | PathLike[str] | None = None
    baseline_m: float | None = None

    def stereo(self, wanted: bool) -> StereoArgument | None:
        """What is told of right images, if they are wanted."""
        told = StereoArgument(self.right, self.baseline_m)
        return told if wanted or told != StereoArgument() else None


def _read_input(
    source: Path, of_images: _OfImages, stereo: bool, apart: _Sensors
) -> tuple[FrameSource, Trajectory | None, _Sensors]:
    suffix = source.suffix.lower()
    if suffix in PICTURES and not is_folder(source):
        raise DatasetError(source, f"is a single picture: give {_ACCEPTED}")
    if is_folder(source) or suffix in VIDEOS:
        return _read_images(source, of_images, stereo, apart.image_t_s)
    if stereo and suffix != ".mat":
        raise InvalidArgument("stereo: only KITTI drives (.mat) and images have what a right camera sees")
    if of_images != _OfImages():
        told = "camera, fps, corners: are" if of_images.mask is None else "mask: is"
        told = told if of_images.stereo(False) is None else "right, baseline_m: are"
        raise InvalidArgument(f"{told} for images, the input is tracks and holds its own")
    if suffix == ".mat":
        drive = read_kitti_mat(source)
        return tracks_of_kitti(drive, stereo=stereo), drive.truth, _sensors_of(drive)
    return TrackSequence(**vars(read_tracks(source))), None, _Sensors()


def _read_images(
    source: Path, told: _OfImages, stereo: bool, stamps: FloatArray | None
) -> tuple[FrameSource, Trajectory | None, _Sensors]:
    euroc = euroc_folder(source)
    images = source if euroc is None else euroc.images
    pair = told.stereo(stereo)
    frames, truth = open_images(images, told.camera, told.fps, told.corners, stamps, told.mask, pair)
    mounting = _mounting_beside(images, told.camera)
    return (
        (frames, truth, _Sensors({}, mounting)) if euroc is None else (frames, *_euroc_drive(euroc, mounting))
    )


def _mounting_beside(images: Path, camera: CameraArgument) -> Mounting | None:
    """Mounting in the camera's file."""
    file = find_camera(images) if camera is None else camera_path(camera)
    return None if file is None else mounting_beside_camera(file)


def _euroc_drive(folder: EurocFolder, mounting: Mounting | None) -> tuple[Trajectory | None, _Sensors]:
    streams = {} if folder.rates is None else read_sensor_csv(folder.rates)
    truth = None if mounting is None else folder.camera_truth(mounting)
    return truth, _Sensors(streams, mounting)


@dataclass(frozen=True)
class EurocFolder:
    """Contents of a folder of EuRoC.

    Attributes
    ----------
    images : Path
        Those of the first camera.
    rates : Path or None
        What the IMU measured.
    truth : Path or None
        Poses of the body.
    """

    images: Path
    rates: Path | None
    truth: Path | None

    def camera_truth(self, mounting: Mounting) -> Trajectory | None:
        """True poses of a camera that sits so on the body; None where the folder knows none."""
        if self.truth is None:
            return None
        body = read_trajectory(self.truth)
        return Trajectory(body.t_s, mounting.camera_poses(body.poses))


def euroc_folder(path: Path) -> EurocFolder | None:
    """Find what ``mav0``, or the folder that holds it, has; None if `path` is no such folder."""
    root = path / _ROOT if is_folder(path / _ROOT) else path
    if not is_folder(root / _IMAGES):
        return None
    rates, truth = (file if is_regular_file(file) else None for file in (root / _RATES, root / _TRUTH))
    return EurocFolder(root / _IMAGES, rates, truth)
