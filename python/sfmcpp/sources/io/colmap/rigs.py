"""COLMAP's rigs and frames as rigs of a problem, and back; and those of one camera each.

Inside, sensors have the pose of a camera in its rig, as cameras have in the world; files have the inverse,
and the first sensor of a rig at its origin. COLMAP writes rigs of one camera each with every model: they are
kept where a model is replaced.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.so3 import quaternion_from_rotation, rotation_from_quaternion
from sfmcpp.model import Problem, Rigs
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.metadata import FRAME_IDS, RIG_IDS, SENSOR_ROWS
from sfmcpp.model.rigs import composed, relative
from sfmcpp.sources.io.colmap.rig_files import CAMERA, Frame, Pose, Rig, RigModel, Sensor
from sfmcpp.sources.io.colmap.tables import ImageTable, Int64Array, Tables
from sfmcpp.sources.io.files import is_present
from sfmcpp.sources.io.poses import cameras_from_pose, pose_from_cameras

_LOOSE = 1e-6  # of the pose of an image against that of its frame, relative to its translation


def add_rigs(problem: Problem, tables: Tables, model: RigModel) -> None:
    """Give a problem of these tables its rigs; its cameras are then where frames and sensors put them.

    Raises
    ------
    DatasetError
        Naming file, rig, frame or image, if they contradict each other, a sensor is no camera or its pose
        is not known.
    """
    mounted = _MountedSensors.of(model)
    frames = _poses([frame.pose for frame in model.frames], model.frames_path, "frame")
    frame_of_image, sensor_of_image = mounted.images(model, tables.images)
    rigs = Rigs(mounted.sensors, frame_of_image.astype(np.int32), sensor_of_image.astype(np.int32))
    cameras = rigs.cameras(frames)
    _require_agreement(tables.images, cameras, problem.cameras)
    problem.cameras, problem.rigs = cameras, rigs
    problem.metadata.extra |= {
        RIG_IDS: mounted.rig_ids,
        SENSOR_ROWS: tables.cameras.rows_of(mounted.camera_ids),
        FRAME_IDS: np.array([frame.id for frame in model.frames], np.int64),
    }


@dataclass(frozen=True)
class _MountedSensors:
    """All sensors of all rigs: rig and camera of each, and its pose in the rig."""

    rig_ids: Int64Array
    camera_ids: Int64Array
    sensors: FloatArray

    @classmethod
    def of(cls, model: RigModel) -> _MountedSensors:
        pairs = [(rig.id, sensor) for rig in model.rigs for sensor in rig.sensors]
        for rig_id, sensor in pairs:
            if sensor.kind != CAMERA:
                reason = f"rig {rig_id} has a sensor of kind {sensor.kind}: only cameras are supported"
                raise DatasetError(model.rigs_path, reason)
            if sensor.pose is None:
                reason = f"rig {rig_id}: the pose of camera {sensor.id} in the rig is not known"
                raise DatasetError(model.rigs_path, reason)
        ids = np.array([sensor.id for _, sensor in pairs], np.int64)
        values, counts = np.unique(ids, return_counts=True)
        if (counts > 1).any():
            raise DatasetError(model.rigs_path, f"camera {values[np.argmax(counts > 1)]} is in rigs twice")
        poses = [sensor.pose or () for _, sensor in pairs]
        rig_ids = np.array([rig_id for rig_id, _ in pairs], np.int64)
        return cls(rig_ids, ids, _poses(poses, model.rigs_path, "sensor"))

    def images(self, model: RigModel, images: ImageTable) -> tuple[Int64Array, Int64Array]:
        """Frame and sensor of each image."""
        rows = {int(number): row for row, number in enumerate(images.ids)}
        sensors = {int(number): row for row, number in enumerate(self.camera_ids)}
        result = np.full((2, len(images.ids)), -1)
        for number, frame in enumerate(model.frames):
            for _, camera, image in frame.data:
                row, sensor = rows.get(image, -1), sensors.get(camera, -1)
                if reason := self._contradiction(frame, camera, image, row, sensor, images, result[0]):
                    raise DatasetError(model.frames_path, f"frame {frame.id}: {reason}")
                result[:, row] = number, sensor
        images.require(result[0] >= 0, f"no frame of {model.frames_path.name} has this image")
        return result[0], result[1]

    def _contradiction(
        self,
        frame: Frame,
        camera: int,
        image: int,
        row: int,
        sensor: int,
        images: ImageTable,
        frame_of_image: Int64Array,
    ) -> str:
        if row < 0:
            return f"image {image} is not in the list of images"
        if sensor < 0 or self.rig_ids[sensor] != frame.rig_id:
            return f"camera {camera} is none of rig {frame.rig_id}"
        if images.camera_ids[row] != camera:
            return f"image {image} is of camera {images.camera_ids[row]}, not of {camera}"
        return f"image {image} is in another frame too" if frame_of_image[row] >= 0 else ""


def _poses(poses: Sequence[Pose], path: Path, what: str) -> FloatArray:
    """``[R | c]`` of poses that files have."""
    values = np.array(poses, np.float64).reshape(-1, 7)
    bad = np.flatnonzero(~(np.isfinite(values).all(axis=1) & (values[:, :4] != 0).any(axis=1)))
    if len(bad):
        raise DatasetError(path, f"{what} {bad[0] + 1} of {len(values)}: its pose is impossible")
    return cameras_from_pose(rotation_from_quaternion(values[:, :4]), values[:, 4:])


def _require_agreement(images: ImageTable, cameras: FloatArray, alone: FloatArray) -> None:
    images.require(_agree(cameras, alone), "its pose is not that of its frame and sensor")


def _agree(cameras: FloatArray, alone: FloatArray) -> BoolArray:
    with np.errstate(all="ignore"):
        turn = np.abs(cameras - alone)[:, :, :3].max(axis=(1, 2), initial=0.0)
        off = np.linalg.norm((cameras - alone)[:, :, 3], axis=1)
        good: BoolArray = (turn <= _LOOSE) & (off <= _LOOSE * (1 + np.linalg.norm(alone[:, :, 3], axis=1)))
    return good


def require_poses_of_frames(problem: Problem, tables: Tables, model: RigModel) -> None:
    """Refuse poses of images that are not those of their frames, in a model of rigs of one camera each.

    Scripts from before COLMAP had frames change those of images alone, COLMAP of today takes those of frames.

    Raises
    ------
    DatasetError
        Naming the first image whose pose is another.
    """
    poses = _poses([frame.pose for frame in model.frames], model.frames_path, "frame")
    pairs = [
        (image, k) for k, frame in enumerate(model.frames) for kind, _, image in frame.data if kind == CAMERA
    ]
    ids, frames = np.array(pairs, np.int64).reshape(-1, 2).T
    rows = tables.images.rows_of(ids)
    there = rows >= 0
    good = np.ones(problem.num_cameras, np.bool_)
    good[rows[there]] = _agree(poses[frames[there]], problem.cameras[rows[there]])
    files = f"{model.rigs_path.name} and {model.frames_path.name}"
    reason = f"its pose is not that in {model.frames_path.name}, which COLMAP takes"
    tables.images.require(good, f"{reason}: where this one is right, remove {files}")


def rig_model_of(problem: Problem, rigs: Rigs, tables: Tables, paths: Sequence[Path]) -> RigModel:
    """Rigs and frames of a problem whose tables are made; the first sensor of each rig becomes its origin.

    Raises
    ------
    DatasetError
        If cameras are not rigid, or a sensor has no image, several rows of intrinsics, or one with another
        sensor: COLMAP's sensor is a camera of one row.
    """
    _require_agreement(tables.images, rigs.rigid(problem.cameras), problem.cameras)
    rig_of_sensor, rig_ids = _rig_of_sensors(problem, rigs)
    origins = rigs.sensors[np.unique(rig_of_sensor, return_index=True)[1][rig_of_sensor]]
    camera_ids = tables.cameras.ids[_rows_of_sensors(problem, rigs, paths[0])]
    sensors = [
        Sensor(CAMERA, camera, pose)
        for camera, pose in zip(
            camera_ids.tolist(), _file_poses(relative(origins, rigs.sensors)), strict=True
        )
    ]
    mounted = [
        Rig(number, tuple(sensors[s] for s in np.flatnonzero(rig_of_sensor == rig)))
        for rig, number in enumerate(rig_ids)
    ]
    frames = []
    for number, cameras, pose in _frames(problem, rigs, origins):
        sensors_of_frame = rigs.sensor_of_camera[cameras]
        data = zip(camera_ids[sensors_of_frame].tolist(), tables.images.ids[cameras].tolist(), strict=True)
        rig_id = rig_ids[rig_of_sensor[sensors_of_frame[0]]]
        frames.append(Frame(number, rig_id, pose, tuple((CAMERA, *of_image) for of_image in data)))
    return RigModel(tuple(mounted), tuple(frames), *paths)


def _frames(problem: Problem, rigs: Rigs, origins: FloatArray) -> Iterator[tuple[int, Int64Array, Pose]]:
    """Number, cameras and pose in files of each frame that has any."""
    numbers, some = np.unique(rigs.frame_of_camera, return_index=True)
    in_world = composed(rigs.frames(problem.cameras)[numbers], origins[rigs.sensor_of_camera[some]])
    known = np.asarray(problem.metadata.extra.get(FRAME_IDS, ()))
    ids = numbers + 1 if len(known) <= numbers.max(initial=-1) else known[numbers]
    order = np.argsort(rigs.frame_of_camera, kind="stable")
    cameras = np.split(order, np.searchsorted(rigs.frame_of_camera[order], numbers[1:]))
    yield from zip(ids.tolist(), cameras, _file_poses(in_world), strict=True)


def _rig_of_sensors(problem: Problem, rigs: Rigs) -> tuple[Int64Array, list[int]]:
    """Rig of each sensor, and the identifiers of rigs: as they were read, or by what frames hold together."""
    known = problem.metadata.extra.get(RIG_IDS)
    if known is not None and len(known) == rigs.num_sensors:
        ids, of_sensor = np.unique(known, return_inverse=True)
        return of_sensor, ids.tolist()
    of_sensor = rigs.rig_of_sensor()
    return of_sensor, list(range(1, int(of_sensor.max(initial=-1)) + 2))


def _rows_of_sensors(problem: Problem, rigs: Rigs, path: Path) -> Int64Array:
    """Row of intrinsics of each sensor."""
    rows = np.full(rigs.num_sensors, -1)
    known = problem.metadata.extra.get(SENSOR_ROWS)
    if known is not None and len(known) == rigs.num_sensors:
        rows[:] = known
    rows[rigs.sensor_of_camera] = problem.intrinsics_index
    mixed = np.flatnonzero(rows[rigs.sensor_of_camera] != problem.intrinsics_index)
    if len(mixed):
        sensor = rigs.sensor_of_camera[mixed[0]]
        raise DatasetError(path, f"sensor {sensor} has several rows of intrinsics: COLMAP's sensors have one")
    if (rows < 0).any():
        raise DatasetError(path, f"sensor {np.argmin(rows)} has no camera: COLMAP's sensors are cameras")
    values, counts = np.unique(rows, return_counts=True)
    if (counts > 1).any():
        shared = values[np.argmax(counts > 1)]
        raise DatasetError(path, f"sensors share intrinsics {shared}: COLMAP's sensors have a camera each")
    return rows


def _file_poses(poses: FloatArray) -> list[Pose]:
    """The inverse of ``[R | c]``, as files have it."""
    rotations, translations = pose_from_cameras(poses)
    values = np.concatenate([quaternion_from_rotation(rotations), translations], axis=1)
    return [tuple(row) for row in values.tolist()]


def trivial_rigs_in(
    folder: Path, names: Sequence[str], read: Callable[..., RigModel | None], *, has_model: bool
) -> RigModel | None:
    """Rigs and frames in the files of these names; None if there are none.

    Parameters
    ----------
    folder : Path
        Of the model that is to be replaced.
    names : sequence of str
        Of the files of rigs and frames.
    read : callable
        Reads them.
    has_model : bool
        Whether the folder has the model that they belong to.

    Raises
    ------
    DatasetError
        If they are anything but rigs of one camera each: a new model would contradict them.
    """
    there = [folder / name for name in names if is_present(folder / name)]
    if not there:
        return None
    found = None
    if has_model and len(there) == len(names):
        try:
            found = read(folder, alone=True)
        except DatasetError:  # what cannot be read is not replaced
            found = None
    kinds = {sensor.kind for rig in found.rigs for sensor in rig.sensors} if found else set()
    if found is None or kinds != {CAMERA} or any(len(frame.data) != 1 for frame in found.frames):
        reason = "the model that is there would be replaced, and this file would contradict the new poses"
        raise DatasetError(there[-1], f"{reason}; write to another folder")
    return found


def with_poses_of(tables: Tables, known: RigModel) -> RigModel:
    """A rig for each camera and a frame for each image, with the identifiers of `known` if it fits.

    Without, rigs have those of their cameras and frames those of their images, as COLMAP numbers them.
    """
    rig_of_camera = {sensor.id: rig.id for rig in known.rigs for sensor in rig.sensors}
    frame_of_image = {image: frame.id for frame in known.frames for _, _, image in frame.data}
    cameras, images = tables.cameras.ids.tolist(), tables.images.ids.tolist()
    if not (rig_of_camera.keys() >= set(cameras) and frame_of_image.keys() >= set(images)):
        rig_of_camera, frame_of_image = ({number: number for number in ids} for ids in (cameras, images))
    rigs = [Rig(rig_of_camera[camera], (Sensor(CAMERA, camera),)) for camera in cameras]
    frames = [
        Frame(frame_of_image[image], rig_of_camera[camera], tuple(pose), ((CAMERA, camera, image),))
        for image, camera, pose in _image_poses(tables.images)
    ]
    return RigModel(tuple(rigs), tuple(frames), known.rigs_path, known.frames_path)


def _image_poses(images: ImageTable) -> zip[tuple[int, int, list[float]]]:
    poses = np.concatenate([images.quaternions, images.translations], axis=1)
    return zip(images.ids.tolist(), images.camera_ids.tolist(), poses.tolist(), strict=True)
