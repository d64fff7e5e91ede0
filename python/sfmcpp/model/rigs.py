"""Rigs: cameras that move together, each a sensor of a rigid frame."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import ANY, BoolArray, FloatArray, IndexArray, finite_array, index_array
from sfmcpp.model.checks import ROTATION_TOLERANCE, is_rotation
from sfmcpp.model.named_fields import NamedFields


@dataclass(eq=False)
class Rigs(NamedFields):
    """Cameras mounted rigidly together: each camera of a problem is one sensor of one frame.

    The pose of camera i follows from both: ``R_i = R_f R_s`` and ``c_i = c_f + R_f t_s``, with the pose of
    its frame in the world ``[R_f | c_f]``. A solve estimates six parameters per frame, and six per free
    sensor, shared by all frames. An independent camera is the only one of its frame, with its own sensor at
    ``[I | 0]``.

    Parameters
    ----------
    sensors : (S, 3, 4) float64
        ``[R_s | t_s]`` of each sensor: rotation rig_from_sensor, and the centre of the camera in the rig, in
        units of the world. COLMAP's ``sensor_from_rig`` is the inverse.
    frame_of_camera : (C,) int32
        Frame of each camera, below C.
    sensor_of_camera : (C,) int32
        Sensor of each camera, a row of `sensors`. A frame has each sensor at most once.
    free_sensors : (S,) bool, optional
        Sensors whose poses are estimated; :meth:`freed` makes the usual choice. One sensor of each connected
        group must be fixed as long as a frame moves: if all are free, a solve holds the first fixed, with a
        warning. Default: none.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is out of range or not finite, a sensor's matrix is no rotation, or a
        frame has a sensor twice.
    """

    sensors: FloatArray
    frame_of_camera: IndexArray
    sensor_of_camera: IndexArray
    free_sensors: BoolArray = None  # type: ignore[assignment]

    if TYPE_CHECKING:  # what is given need not be what is held

        def __init__(
            self,
            sensors: ArrayLike,
            frame_of_camera: ArrayLike,
            sensor_of_camera: ArrayLike,
            free_sensors: ArrayLike | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        self.sensors = finite_array("rigs.sensors", self.sensors, (ANY, 3, 4))
        self.frame_of_camera = _numbers("frame_of_camera", self.frame_of_camera)
        self.sensor_of_camera = _numbers("sensor_of_camera", self.sensor_of_camera, self.num_sensors)
        self.free_sensors = _flags("free_sensors", self.free_sensors, self.num_sensors)
        _require_rotations(self.sensors[:, :, :3])
        if len(self.sensor_of_camera) != self.num_cameras:
            raise InvalidArgument(
                f"rigs.sensor_of_camera: {len(self.sensor_of_camera)} values for {self.num_cameras} cameras, "
                "must be one for each"
            )
        self._require_sensors_once()

    def _require_sensors_once(self) -> None:
        pairs = self.frame_of_camera.astype(np.int64) * self.num_sensors + self.sensor_of_camera
        _, first, counts = np.unique(pairs, return_index=True, return_counts=True)
        if (counts > 1).any():
            camera = first[np.argmax(counts > 1)]
            raise InvalidArgument(
                f"rigs: frame {self.frame_of_camera[camera]} has sensor {self.sensor_of_camera[camera]} twice"
            )

    @property
    def num_cameras(self) -> int:
        """Number of cameras, C."""
        return len(self.frame_of_camera)

    @property
    def num_sensors(self) -> int:
        """Number of sensors, S."""
        return len(self.sensors)

    @property
    def num_frames(self) -> int:
        """Number of frames that have a camera."""
        return len(np.unique(self.frame_of_camera))

    def frames(self, cameras: ArrayLike) -> FloatArray:
        """Poses of the frames of cameras.

        Parameters
        ----------
        cameras : (C, 3, 4) array
            Poses of all cameras, rotation world_from_camera and centre. Where those of a frame are not rigid
            to each other, its pose is the mean of what they say: of rotations by their sum, of centres.

        Returns
        -------
        (F, 3, 4) float64
            Rotation world_from_rig and origin of each frame in the world; of a number that no camera
            has, NaN.

        Raises
        ------
        InvalidArgument
            If the shape is wrong or a number is not finite.
        """
        poses = finite_array("cameras", cameras, (self.num_cameras, 3, 4))
        sensors = self.sensors[self.sensor_of_camera]
        turns = np.zeros((int(self.frame_of_camera.max(initial=-1)) + 1, 3, 3))
        np.add.at(turns, self.frame_of_camera, poses[:, :, :3] @ sensors[:, :, :3].transpose(0, 2, 1))
        counts = np.bincount(self.frame_of_camera)
        left, _, right = np.linalg.svd(turns)
        left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
        rotations = left @ right
        origins = np.zeros((len(counts), 3, 1))
        np.add.at(
            origins,
            self.frame_of_camera,
            poses[:, :, 3:] - rotations[self.frame_of_camera] @ sensors[:, :, 3:],
        )
        with np.errstate(invalid="ignore"):
            result = np.concatenate([rotations, origins / counts[:, None, None]], axis=2)
        result[counts == 0] = np.nan
        return result

    def cameras(self, frames: ArrayLike) -> FloatArray:
        """Poses of all cameras where their frames are.

        Parameters
        ----------
        frames : (F, 3, 4) array
            Rotation world_from_rig and origin of each frame.

        Returns
        -------
        (C, 3, 4) float64
            Rotation world_from_camera and centre of each camera.

        Raises
        ------
        InvalidArgument
            If there are fewer frames than the numbers of `frame_of_camera` need, or the shape is wrong.
        """
        poses = np.asarray(frames, np.float64)
        if poses.ndim != 3 or poses.shape[1:] != (3, 4) or len(poses) <= self.frame_of_camera.max(initial=-1):
            raise InvalidArgument(f"frames: shape {poses.shape}, must be a pose for each frame")
        return composed(poses[self.frame_of_camera], self.sensors[self.sensor_of_camera])

    def rigid(self, cameras: ArrayLike) -> FloatArray:
        """Poses of cameras made rigid: each where its frame, as :meth:`frames` has it, puts it.

        Parameters
        ----------
        cameras : (C, 3, 4) array
            Poses of all cameras.

        Returns
        -------
        (C, 3, 4) float64
            Poses that a solve accepts.

        Raises
        ------
        InvalidArgument
            As of :meth:`frames`.
        """
        return self.cameras(self.frames(cameras))

    def motions(self, cameras: ArrayLike) -> FloatArray:
        """How cameras answer to small motions of their frames.

        Parameters
        ----------
        cameras : (C, 3, 4) array
            Poses of all cameras.

        Returns
        -------
        (C, 6, 6) float64
            Derivatives of turn and centre of each camera by those of its frame, poses moving as in a solve
            (``R exp([δ]×)``, ``c + δ``): ``δR_i = R_sᵀ δR`` and ``δc_i = δc − R_f [t_s]× δR``.

        Raises
        ------
        InvalidArgument
            As of :meth:`frames`.
        """
        sensors = self.sensors[self.sensor_of_camera]
        rotations = self.frames(cameras)[self.frame_of_camera, :, :3]
        result = np.zeros((self.num_cameras, 6, 6))
        result[:, :3, :3] = sensors[:, :, :3].transpose(0, 2, 1)
        result[:, 3:, :3] = rotations @ np.cross(sensors[:, None, :, 3], np.eye(3))
        result[:, 3:, 3:] = np.eye(3)
        return result

    def sensor_motions(self, cameras: ArrayLike) -> FloatArray:
        """How cameras answer to small motions of their sensors.

        Parameters
        ----------
        cameras : (C, 3, 4) array
            Poses of all cameras.

        Returns
        -------
        (C, 6, 6) float64
            As :meth:`motions`, by turn and place of each camera's sensor: ``δR_i = δR_s`` and
            ``δc_i = R_f δt_s``.

        Raises
        ------
        InvalidArgument
            As of :meth:`frames`.
        """
        result = np.zeros((self.num_cameras, 6, 6))
        result[:, :3, :3] = np.eye(3)
        result[:, 3:, 3:] = self.frames(cameras)[self.frame_of_camera, :, :3]
        return result

    def rig_of_sensor(self) -> NDArray[np.int64]:
        """(S,) number of the rig of each sensor: what frames hold together, numbered by its first sensor."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import connected_components

        seen = coo_matrix(
            (np.ones(self.num_cameras), (self.frame_of_camera, self.sensor_of_camera)),
            shape=(self.num_cameras, self.num_sensors),
        ).tocsr()
        return np.asarray(connected_components(seen.T @ seen, directed=False)[1], np.int64)

    def origin_of_sensor(self) -> NDArray[np.int64]:
        """(S,) the sensor that is the origin of each one's rig: its first that stays, or else its first."""
        rigs = self.rig_of_sensor()
        staying_first = np.argsort(self.free_sensors, kind="stable")
        origins = staying_first[np.unique(rigs[staying_first], return_index=True)[1]]
        return np.asarray(origins[rigs])

    def freed(self) -> Rigs:
        """The same rigs with all sensors free but the first of each: where it is, is the rig's origin."""
        first = np.unique(self.rig_of_sensor(), return_index=True)[1]
        free = np.ones(self.num_sensors, bool)
        free[first] = False
        return replace(self, free_sensors=free)

    def of_cameras(self, chosen: NDArray[Any]) -> tuple[Rigs, NDArray[np.int64], NDArray[np.int64]]:
        """Rigs of some cameras, with the frames and the sensors that these have; both are numbered anew.

        Parameters
        ----------
        chosen : (c,) int
            Numbers of cameras, all different.

        Returns
        -------
        Rigs, (f,) int64, (s,) int64
            And the former numbers of its frames and sensors.
        """
        frames, frame_of_camera = np.unique(self.frame_of_camera[chosen], return_inverse=True)
        sensors, sensor_of_camera = np.unique(self.sensor_of_camera[chosen], return_inverse=True)
        part = Rigs(
            self.sensors[sensors],
            frame_of_camera.astype(np.int32),
            sensor_of_camera.astype(np.int32),
            self.free_sensors[sensors],
        )
        return part, frames.astype(np.int64), sensors.astype(np.int64)

    def scaled(self, scale: float) -> Rigs:
        """The same rigs in a world whose lengths are `scale` times as large.

        Parameters
        ----------
        scale : float
            Factor of all lengths.
        """
        sensors = self.sensors.copy()
        sensors[:, :, 3] *= scale
        return replace(self, sensors=sensors)

    def copy(self) -> Rigs:
        """An independent copy."""
        return Rigs(**{f.name: getattr(self, f.name).copy() for f in fields(self)})

    def __repr__(self) -> str:
        free = f", {self.free_sensors.sum()} free" if self.free_sensors.any() else ""
        return f"Rigs({self.num_frames} frames of {self.num_sensors} sensors{free})"


def composed(outer: FloatArray, inner: FloatArray) -> FloatArray:
    """Poses ``[R | c]`` (n, 3, 4) in the world of what has poses `inner` in the axes of `outer`."""
    result: FloatArray = outer[:, :, :3] @ inner
    result[:, :, 3] += outer[:, :, 3]
    return result


def relative(outer: FloatArray, poses: FloatArray) -> FloatArray:
    """The `inner` of :func:`composed`: `poses` in the axes of `outer`."""
    axes = outer[:, :, :3].transpose(0, 2, 1)
    result: FloatArray = axes @ poses
    result[:, :, 3:] -= axes @ outer[:, :, 3:]
    return result


def _numbers(name: str, value: ArrayLike, end: int | None = None) -> IndexArray:
    """`value` as numbers from 0 to `end` − 1, or below their count."""
    numbers = index_array(f"rigs.{name}", value)
    end = len(numbers) if end is None else end
    outside = np.flatnonzero((numbers < 0) | (numbers >= end))
    if len(outside):
        raise InvalidArgument(f"rigs.{name}[{outside[0]}] = {numbers[outside[0]]}: must be in [0, {end})")
    return numbers


def _flags(name: str, value: ArrayLike | None, count: int) -> BoolArray:
    """`value` as so many bools; none is no True."""
    flags = np.zeros(count, bool) if value is None else np.ascontiguousarray(value)
    if flags.dtype != bool or flags.shape != (count,):
        raise InvalidArgument(
            f"rigs.{name}: {flags.dtype} of shape {flags.shape}, must be bool of shape ({count},)"
        )
    return flags


def _require_rotations(matrices: FloatArray) -> None:
    bad = np.flatnonzero(~is_rotation(matrices))
    if len(bad):
        rule = f"must be orthonormal to {ROTATION_TOLERANCE:g} with determinant 1"
        raise InvalidArgument(f"rigs.sensors[{bad[0]}]: not a rotation: {rule}")
