"""Calibration files of OpenCV (and ROS), Kalibr, EuRoC and ORB-SLAM.

All mean ``u = fu x + cu``, ``v = fv y + cv`` after the distortion ``k1, k2, p1, p2[, k3]`` of OpenCV ("plumb
bob", "radtan", "radial-tangential"), which the camera model ``"perspective"`` holds without loss. Other
lenses are refused by name: images of them are to be undistorted first. OpenCV's own files do not say that a
lens is a fisheye: four numbers are always k1, k2, p1, p2.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.documents import Node, read_document
from sfmcpp.sources.io.intrinsics import (
    matrix_fault,
    perspective_columns,
    perspective_rows,
    pinhole_of_matrix,
)
from sfmcpp.sources.io.opencv_cameras import OpencvCamera, opencv_cameras
from sfmcpp.sources.io.orb_slam import orb_slam_camera, orb_slam_cameras

_COEFFICIENTS = ("distortion_coeffs", "distortion_coefficients")
# Names that the programs have for one and the same lens, and for none. ROS's rational polynomial is the same
# where its denominator is 1: coefficients beyond k3 are refused below.
_RADIAL_TANGENTIAL = ("radtan", "radial-tangential", "plumb_bob", "rational_polynomial")
_NONE = ("none", "")
# ROS's names, and ORB-SLAM's.
_SIZE = (("image_width", "Camera.width"), ("image_height", "Camera.height"))
# OpenCV's order; what follows belongs to lenses that the camera model does not hold.
_ORDER = ("k1", "k2", "p1", "p2", "k3")


@dataclass(frozen=True, eq=False)
class Calibration:
    """A camera of a file.

    Attributes
    ----------
    intrinsics : (5,) or (12,) float64
        Of the camera model ``"perspective"``; without distortion its first five will do.
    part : Node or None
        Where the file has it, of a file that may tell more.
    first_pixel_px : float or None
        Where its pixels have the centre of the top left one, in u and v [px]: 0 in files of OpenCV, Kalibr,
        EuRoC and KITTI; None where nothing tells.
    """

    intrinsics: FloatArray
    part: Node | None = None
    first_pixel_px: float | None = None

    def from_corner(self) -> FloatArray:
        """The intrinsics for pixels that count from the corner of the image, as photos have them here.

        As they are where nothing tells where they count from.
        """
        moved = np.array(self.intrinsics)
        if self.first_pixel_px is not None:
            moved[perspective_columns("cx", "cy")] += 0.5 - self.first_pixel_px
        return moved

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height [px] of its images, if the file has them.

        Raises
        ------
        DatasetError
            If what it tells are no numbers.
        """
        if self.part is None:
            return None
        node = self.part.part("resolution")
        parts = [self.part.part(*names) for names in _SIZE] if node is None else [node]
        numbers = [number for part in parts if part is not None for number in part.numbers()]
        return (int(numbers[0]), int(numbers[1])) if len(numbers) == 2 else None


def read_calibration(path: Path, camera: str = "") -> Calibration:
    """Read a camera.

    Parameters
    ----------
    path : Path
        A YAML or XML file of OpenCV or ROS with ``camera_matrix`` and ``distortion_coefficients`` (or ``K``
        and ``D``), or those of a stereo pair; a camera chain of Kalibr, a ``sensor.yaml`` of EuRoC, or
        settings of ORB-SLAM.
    camera : str
        Which one of a file that holds several: ``"cam1"``; of OpenCV and ROS the name of its matrix, as
        ``"M1"``. That of a projection matrix, as ``"P1"``, is the camera of rectified images.

    Returns
    -------
    Calibration

    Raises
    ------
    DatasetError
        If the file cannot be read, holds no such camera, or one with another lens.
    """
    root = read_document(path)
    if opencv_cameras(root):
        return _opencv(opencv_camera(root, camera))
    if cameras := orb_slam_cameras(root):
        return _orb_slam(root, camera or cameras[0], cameras)
    chosen = chosen_camera(root, camera)
    return Calibration(_intrinsics(*_euroc_or_kalibr(chosen)), chosen, first_pixel_px=0.0)


def camera_names(path: Path) -> list[str]:
    """Names of the cameras of a file, as :func:`read_calibration` takes them; one empty name of an only one.

    Raises
    ------
    DatasetError
        If the file cannot be read, or holds no camera.
    """
    root = read_document(path)
    found = [*opencv_cameras(root)] or orb_slam_cameras(root) or [*kalibr_cameras(root)]
    if not found:
        chosen_camera(root, "")
    return found or [""]


@dataclass(frozen=True, eq=False)
class _Values:
    """Numbers, and the part of the file that they come from."""

    node: Node
    numbers: list[float]


def chosen_camera(root: Node, camera: str) -> Node:
    """The camera of that name, or the only one.

    Raises
    ------
    DatasetError
        If there is none, or several and no name.
    """
    several = kalibr_cameras(root)
    _require_choice(root, camera, several, len(several))
    if not several and not root.part("intrinsics"):
        rule = "must be of OpenCV (camera_matrix, or K), Kalibr (cam0: intrinsics) or EuRoC (intrinsics)"
        raise root.error(f"holds no camera: {rule}")
    return several[camera] if camera else next(iter(several.values()), root)


def kalibr_cameras(root: Node) -> dict[str, Node]:
    """The cameras of a chain by their names; nothing of another file."""
    parts = root.value if isinstance(root.value, dict) else {}
    return {name: part for name, part in parts.items() if part.part("intrinsics")}


def opencv_camera(root: Node, name: str) -> OpencvCamera:
    """The camera of that name in a file of OpenCV or ROS, or the only one of images as taken.

    Raises
    ------
    DatasetError
        If there is none, or several and no name.
    """
    cameras = opencv_cameras(root)
    as_taken = [camera for camera in cameras.values() if not camera.rectified]
    _require_choice(root, name, cameras, len(as_taken or cameras))
    return cameras[name] if name else next(iter(cameras.values()))


def _require_choice(root: Node, name: str, known: Collection[str], count: int) -> None:
    """Raise a DatasetError for a name that is not known, and without one if it may be of `count` cameras."""
    if name and name not in known:
        raise root.error(f"holds no camera {name!r}{': it holds ' * bool(known)}{', '.join(known)}")
    if count > 1 and not name:
        raise root.error(f"holds {', '.join(known)}: say which, as in {root.path.name}:{next(iter(known))}")


def _opencv(camera: OpencvCamera) -> Calibration:
    matrix = _Values(camera.matrix, camera.calibration_matrix().ravel().tolist())
    node = camera.distortion()
    distortion = _Values(camera.root, []) if node is None else _Values(node, node.numbers())
    lens = "" if camera.rectified else _text_of(camera.root.part("distortion_model"), "plumb_bob")
    return Calibration(_intrinsics(matrix, distortion, lens), camera.root, first_pixel_px=0.0)


def _orb_slam(root: Node, name: str, known: Collection[str]) -> Calibration:
    _require_choice(root, name, known, 1)
    matrix, distortion = orb_slam_camera(root, name)
    values = _Values(root, matrix.ravel().tolist()), _Values(root, distortion)
    return Calibration(_intrinsics(*values, "plumb_bob"), root, first_pixel_px=0.0)


def _euroc_or_kalibr(camera: Node) -> tuple[_Values, _Values, str]:
    model = camera.part("camera_model")
    if model is not None and model.value != "pinhole":
        raise model.error(f"camera model {model.value!r}: must be pinhole; undistort the images first")
    node = camera.part("intrinsics")
    assert node is not None
    numbers = node.numbers()
    if len(numbers) != 4:
        raise node.error(f"holds {len(numbers)} numbers: must be 4, fu, fv, cu, cv")
    fu, fv, cu, cv = numbers
    matrix = [fu, 0.0, cu, 0.0, fv, cv, 0.0, 0.0, 1.0]
    distortion = camera.part(*_COEFFICIENTS)
    return (
        _Values(node, matrix),
        _Values(camera, []) if distortion is None else _Values(distortion, distortion.numbers()),
        _text_of(camera.part("distortion_model"), ""),
    )


def _text_of(node: Node | None, default: str) -> str:
    return node.value if node is not None and isinstance(node.value, str) else default


def _intrinsics(matrix: _Values, distortion: _Values, lens: str) -> FloatArray:
    square = np.reshape(matrix.numbers, (3, 3))
    if (fault := matrix_fault(square)) is not None:
        raise matrix.node.error(fault)
    found = distortion.numbers
    if lens.lower() not in (*_RADIAL_TANGENTIAL, *([] if any(found) else _NONE)):
        rule = f"must be one of {', '.join(_RADIAL_TANGENTIAL)}; undistort the images first"
        raise distortion.node.error(f"distortion model {lens!r}: {rule}")
    if any(found[len(_ORDER) :]) or len(found) not in (0, 4, 5, 8, 12, 14):
        rule = f"must be 4 or 5, {', '.join(_ORDER)}, or zero beyond; undistort the images first"
        raise distortion.node.error(f"distortion of {len(found)} coefficients: {rule}")
    rows = perspective_rows(1)
    rows[:, perspective_columns("f", "aspect", "cx", "cy", "skew")] = pinhole_of_matrix(square)
    rows[:, perspective_columns(*_ORDER[: len(found)])] = found[: len(_ORDER)]
    return np.asarray(rows[0])
