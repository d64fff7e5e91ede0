"""How the cameras of a stereo pair sit beside each other, in files of OpenCV and ROS.

That tell R and T, as ``cv2.stereoCalibrate`` has them, else the rectification: both cameras are turned to
common axes by R1 and R2 (ROS: ``rectification_matrix``), in which P1 and P2 have their centres. OpenCV's
sample has R and T in ``extrinsics.yml`` beside the matrices; ROS has each camera in a file of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.cameras import camera_file
from sfmcpp.sources.io.calibration import opencv_camera
from sfmcpp.sources.io.documents import Node, read_document
from sfmcpp.sources.io.files import is_regular_file
from sfmcpp.sources.io.opencv_cameras import OpencvCamera, matrix_of, opencv_cameras, rotation_of

_EXTRINSICS = "extrinsics"  # with the suffix of the file of the matrices
_ROTATION, _TRANSLATION = ("R", "Rot"), ("T", "t", "Trns")


class RightCamera(NamedTuple):
    """Where a right camera is: its file, with a name behind it; and its pose (3, 4), left_from_right."""

    path: Path
    pose: FloatArray


def opencv_pair(camera: Path, right_file: Path | None) -> RightCamera | None:
    """The right camera beside a left one.

    Parameters
    ----------
    camera : Path
        File of the left camera, with its name behind it if the file has several.
    right_file : Path or None
        Where the right camera is, if it is not in the same file.

    Returns
    -------
    RightCamera or None
        None if the files do not tell.

    Raises
    ------
    DatasetError
        If what they tell is none.
    """
    file, name = camera_file(camera)
    left = opencv_camera(read_document(file), name)
    right = left.other() or _camera_in(right_file, left)
    if right is None:
        return None
    pose = None if left.rectified else _pose_by_displacement(left, right)
    if pose is None:
        pose = _pose_by_rectification(left, right)
    there = right.root.path
    return None if pose is None else RightCamera(there.with_name(f"{there.name}:{right.name}"), pose)


def _camera_in(file: Path | None, left: OpencvCamera) -> OpencvCamera | None:
    """The camera of another file, for such images as the left one is for."""
    cameras = {} if file is None else opencv_cameras(read_document(file))
    return next((camera for camera in cameras.values() if camera.rectified == left.rectified), None)


def _pose_by_displacement(left: OpencvCamera, right: OpencvCamera) -> FloatArray | None:
    """left_from_right by R and T: a point x of the first camera is R x + T in the second."""
    for root in _files_of_pair(left.root):
        turn, step = root.part(*_ROTATION), root.part(*_TRANSLATION)
        if turn is not None and step is not None:
            rotation, translation = rotation_of(turn), matrix_of(step, 3, 1)
            if left.side > right.side:  # the user has the second one as the left one
                return np.column_stack([rotation, translation])
            return np.column_stack([rotation.T, -rotation.T @ translation])
    return None


def _files_of_pair(root: Node) -> Iterator[Node]:
    yield root
    other = root.path.with_stem(_EXTRINSICS)
    if is_regular_file(other) and other != root.path:
        yield read_document(other)


def _pose_by_rectification(left: OpencvCamera, right: OpencvCamera) -> FloatArray | None:
    """left_from_right by the axes that both are turned to, and their centres there; None if these are one."""
    poses = [_rectified(camera) for camera in (left, right)]
    if None in poses:
        return None
    (turn, centre), (other_turn, other_centre) = (pose for pose in poses if pose is not None)
    beside = other_centre - centre
    pose = np.column_stack([turn.T @ other_turn, turn.T @ beside])
    pose[:, :3] = nearest_rotation(pose[:, :3])
    return pose if beside.any() else None


def _rectified(camera: OpencvCamera) -> tuple[FloatArray, FloatArray] | None:
    for root in _files_of_pair(camera.root):
        there = OpencvCamera(root, camera.name, camera.side, camera.rectified)
        turn, centre = there.rectified_from_camera(), there.rectified_centre()
        if turn is not None and centre is not None:
            return turn, centre
    return None
