"""A recorded motion whose truth is known: tracks of one camera, and what sensors on its body measured."""

from __future__ import annotations

from dataclasses import dataclass

from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray, IndexArray


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
