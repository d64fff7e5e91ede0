"""Conversion of camera poses between this package's convention and those of files.

Inside, ``cameras[i] = [R | c]``: rotation world_from_camera and centre in the world, z forward, y down.
Files hold camera_from_world: ``x_cam = R X + t``. The cameras of BAL and of Bundler also look along -z
with y up: that frame, and the image's y axis, are turned by diag(1, -1, -1).
"""

from __future__ import annotations

import numpy as np

from sfmcpp.model.arrays import FloatArray

_TURN = np.array([1.0, -1.0, -1.0])


def cameras_from_pose(rotations: FloatArray, translations: FloatArray) -> FloatArray:
    """``[R | c]`` (C, 3, 4) of camera_from_world rotations (C, 3, 3) and translations (C, 3)."""
    world_from_camera = np.swapaxes(rotations, 1, 2)
    centres = -(world_from_camera @ translations[:, :, None])
    return np.concatenate([world_from_camera, centres], axis=2)


def pose_from_cameras(cameras: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotations (C, 3, 3) and translations (C, 3) camera_from_world of ``[R | c]``."""
    rotations = np.swapaxes(cameras[:, :, :3], 1, 2)
    return rotations, -(rotations @ cameras[:, :, 3:])[:, :, 0]


def cameras_from_y_up_pose(rotations: FloatArray, translations: FloatArray) -> FloatArray:
    """:func:`cameras_from_pose` for cameras that look along -z with y up."""
    return cameras_from_pose(_TURN[:, None] * rotations, _TURN * translations)


def y_up_pose_from_cameras(cameras: FloatArray) -> tuple[FloatArray, FloatArray]:
    """:func:`pose_from_cameras` for cameras that look along -z with y up."""
    rotations, translations = pose_from_cameras(cameras)
    return _TURN[:, None] * rotations, _TURN * translations


def turned_pixels(pixels: FloatArray) -> FloatArray:
    """Pixels (M, 2) with the y axis turned round: y up becomes y down, and back."""
    return np.asarray(pixels * _TURN[:2])


def centre_of_projection(projection: FloatArray) -> FloatArray:
    """Centre c (3,) of a camera whose projection matrix (3, 4) is ``P = K [I | −c]``, with a regular K."""
    return np.asarray(-np.linalg.solve(projection[:, :3], projection[:, 3]))
