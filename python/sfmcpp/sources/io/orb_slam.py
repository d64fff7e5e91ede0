"""Settings files of ORB-SLAM: ``Camera.fx`` and so on, in version 3 ``Camera1.fx`` and ``Camera2.fx``."""

from __future__ import annotations

import numpy as np

from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.documents import Node
from sfmcpp.sources.io.opencv_cameras import exact_rotation, matrix_of

_CAMERAS = ("Camera", "Camera1", "Camera2")
_TYPE, _WITHOUT_FISHEYE = "Camera.type", ("PinHole", "Pinhole", "Rectified")
_DISTORTION = ("k1", "k2", "p1", "p2", "k3")


def orb_slam_cameras(root: Node) -> list[str]:
    """Names of the cameras of a settings file, the left one first; nothing of another file."""
    return [name for name in _CAMERAS if root.part(f"{name}.fx") is not None]


def orb_slam_camera(root: Node, name: str) -> tuple[FloatArray, list[float]]:
    """K (3, 3) and the distortion k1, k2, p1, p2, k3 of a camera of that name.

    Raises
    ------
    DatasetError
        If it is a fisheye, or a number is missing.
    """
    kind = root.part(_TYPE)
    if kind is not None and kind.value not in _WITHOUT_FISHEYE:
        raise kind.error(f"camera type {kind.value!r}: must be PinHole; undistort the images first")
    fx, fy, cx, cy = (_number(root, f"{name}.{part}") for part in ("fx", "fy", "cx", "cy"))
    lens = [
        0.0 if root.part(f"{name}.{part}") is None else _number(root, f"{name}.{part}")
        for part in _DISTORTION
    ]
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), lens


def orb_slam_pose(root: Node) -> FloatArray | None:
    """left_from_right (3, 4) [m]; None if the file does not tell.

    A baseline alone is that of rectified images: with distortion they are none, and it is that of a depth
    camera.

    Raises
    ------
    DatasetError
        If what it tells is no pose, or no number.
    """
    node = root.part("Stereo.T_c1_c2")
    if node is not None:
        pose = matrix_of(node, 4, 4)[:3]
        return np.column_stack([exact_rotation(node, pose[:, :3], "Stereo.T_c1_c2"), pose[:, 3]])
    names = orb_slam_cameras(root)
    if any(orb_slam_camera(root, names[0])[1]):
        return None
    if root.part("Stereo.b") is not None:
        baseline_m = _number(root, "Stereo.b")
    elif root.part("Camera.bf") is not None:
        baseline_m = _number(root, "Camera.bf") / _number(root, f"{names[0]}.fx")
    else:
        return None
    return np.column_stack([np.eye(3), [baseline_m, 0.0, 0.0]])


def _number(root: Node, name: str) -> float:
    node = root.part(name)
    if node is None:
        raise root.error(f"lacks {name}")
    numbers = node.numbers()
    if len(numbers) != 1:
        raise node.error(f"{name} holds {len(numbers)} numbers: must be one")
    return numbers[0]
