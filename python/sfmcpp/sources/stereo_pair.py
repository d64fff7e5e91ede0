"""The right camera of a stereo pair: where its images are, and how it sits beside the left one.

Its images are the sibling of the left ones by the usual names: ``cam1/data`` of EuRoC, ``image_1`` or
``image_03`` of KITTI, ``image_r``, ``right``. Where the camera is tells the first that there is: a baseline
of the user; the camera chain of Kalibr, KITTI's ``calib.txt``, or the file of OpenCV, ROS or ORB-SLAM
that the left camera is from; how both sit on the body, ``T_BS`` of EuRoC's ``sensor.yaml``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.epipolar import inverse_depths
from sfmcpp.geometry.pinhole import homogeneous, pinhole_rows, to_normalised, to_pixels
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_positive
from sfmcpp.sources.cameras import (
    CALIBRATION_FILES,
    camera_file,
    file_beside,
    places_beside,
    projection_matrices,
    read_camera,
)
from sfmcpp.sources.io.calibration import kalibr_cameras
from sfmcpp.sources.io.documents import DOCUMENTS, Node, read_document
from sfmcpp.sources.io.files import is_folder, is_present, is_regular_file
from sfmcpp.sources.io.intrinsics import matrix_fault
from sfmcpp.sources.io.opencv_cameras import opencv_cameras
from sfmcpp.sources.io.orb_slam import orb_slam_cameras, orb_slam_pose
from sfmcpp.sources.io.poses import centre_of_projection
from sfmcpp.sources.mounting_files import mounting_beside_camera, pose_of
from sfmcpp.sources.opencv_pairs import opencv_pair

_KALIBR_STEP = "T_cn_cnm1"  # of a camera of a chain from the one before
# The left camera has an even number: cam0, image_00, image_2.
_NUMBERED = re.compile(r"((?:cam|camera|image|img)s?[-_]?0*)([02])", re.IGNORECASE)
_SIDES = (("left", "right"), ("Left", "Right"), ("LEFT", "RIGHT"))
_LETTERS = (("_l", "_r"), ("_L", "_R"))


class StereoArgument(NamedTuple):
    """What the user tells of the right camera: its images, and how far it is beside the left one [m]."""

    images: str | PathLike[str] | None = None
    baseline_m: float | None = None


@dataclass(frozen=True, eq=False)
class StereoPair:
    """Two cameras that take images at the same time.

    Attributes
    ----------
    left, right : (5,) or (12,) float64
        Intrinsics: ``(f, aspect, cx, cy, skew)``; with distortion all of the model ``"perspective"``.
    pose : (3, 4) float64
        ``[R | c]`` left_from_right.
    """

    left: FloatArray
    right: FloatArray
    pose: FloatArray

    @property
    def centre_m(self) -> FloatArray:
        """(3,) centre of the right camera in the axes of the left one [m]."""
        return self.pose[:, 3]

    def in_right(self, rays: FloatArray, inverse_depth: FloatArray) -> FloatArray:
        """Pixels (n, 2) of points on rays (n, 2) of the left camera at inverse depths (n,) there.

        Not a number behind the right camera.
        """
        beside = (homogeneous(rays) - inverse_depth[:, None] * self.centre_m) @ self.pose[:, :3]
        return to_pixels(_at_depth_one(beside), self.right)

    def turned_rays(self, right_px: FloatArray) -> FloatArray:
        """Rays (n, 2) of right pixels (n, 2) in the axes of the left camera."""
        return _at_depth_one(homogeneous(to_normalised(right_px, self.right)) @ self.pose[:, :3].T)

    def inverse_depths(self, rays: FloatArray, turned_rays: FloatArray) -> FloatArray:
        """Inverse depths (n,) in the left camera where its rays (n, 2) meet those of the right one."""
        return inverse_depths(rays, turned_rays, self.centre_m)


def _at_depth_one(points: FloatArray) -> FloatArray:
    depth = np.where(points[:, 2:] > 0, points[:, 2:], np.nan)
    return np.asarray(points[:, :2] / depth)


def right_images(left: Path, told: StereoArgument) -> Path:
    """Images of the right camera, a folder or a video: as told, or the sibling of the left ones by its name.

    Raises
    ------
    DatasetError
        If there is no sibling; it says what was looked for.
    """
    if told.images is not None:
        return Path(told.images)
    names = list(dict.fromkeys(_siblings(left.absolute())))
    found = next((place for place in names if is_present(place)), None)
    if found is None:
        looked = f" (looked for {', '.join(map(str, names))})" if names else ""
        raise DatasetError(left, f"no images of a right camera are beside it{looked}; give --right FOLDER")
    return found


def _siblings(left: Path) -> Iterator[Path]:
    """Where right images may be: beside the left ones, or in a folder of theirs beside the left one."""
    for place, inside in ((left, ""), (left.parent, left.name)):
        stem, suffix = (place.name, "") if is_folder(place) else (place.stem, place.suffix)
        for name in _right_names(stem):
            yield place.with_name(name + suffix) / inside


def _right_names(left: str) -> Iterator[str]:
    if numbered := _NUMBERED.fullmatch(left):
        yield f"{numbered[1]}{int(numbered[2]) + 1}"
    yield from (left.replace(one, other) for one, other in _SIDES if one in left)
    yield from (left.removesuffix(one) + other for one, other in _LETTERS if left.endswith(one))


def stereo_pair(
    left_images: Path, right: Path, intrinsics: FloatArray, camera: Path | None, baseline_m: float | None
) -> StereoPair:
    """Find how the right camera sits beside the left one.

    Parameters
    ----------
    left_images, right : Path
        Images of both.
    intrinsics : (5,) or (12,) float64
        Of the left camera.
    camera : Path or None
        The file that they are of. None if the user told numbers: a ``calib.txt`` beside the images may tell
        the baseline then.
    baseline_m : float or None
        The user's: the pair is rectified then.

    Raises
    ------
    DatasetError
        If nothing tells, or what tells cannot be right.
    InvalidArgument
        If `baseline_m` is not positive.
    """
    own = _own_file(right, left_images)
    if baseline_m is not None:
        require_positive("baseline_m", baseline_m)
        beside = np.column_stack([np.eye(3), [baseline_m, 0.0, 0.0]])
        return StereoPair(intrinsics, intrinsics if own is None else _intrinsics(own), beside)
    file = file_beside(left_images, "calib.txt") if camera is None else camera
    if file is not None and (found := _pair_of_file(left_images, right, intrinsics, file)) is not None:
        return found
    poses = None if camera is None or own is None else _pose_on_body(camera, own)
    if own is None or poses is None:
        raise DatasetError(right, _unknown_pose_text(camera, own))
    return StereoPair(intrinsics, _intrinsics(own), poses)


def _intrinsics(file: Path) -> FloatArray:
    return pinhole_rows(read_camera(file).intrinsics)


def _own_file(right: Path, left: Path) -> Path | None:
    """Camera file beside the right images that is not also beside the left ones."""
    places = [place for place in places_beside(right) if place not in places_beside(left)]
    files = [place / name for place in places for name in CALIBRATION_FILES]
    return next(filter(is_regular_file, files), None)


def _unknown_pose_text(camera: Path | None, own: Path | None) -> str:
    files = " and ".join(str(file) for file in (camera, own) if file is not None)
    looked = f" in {files}" if files else ""
    return (
        f"where its camera is beside the left one is not known: looked{looked} for P0 and P1 of KITTI's "
        f"calib.txt, T_BS of EuRoC's sensor.yaml of both, {_KALIBR_STEP} of Kalibr, R and T of OpenCV, "
        "projection_matrix of ROS's files of both; give --baseline METRES of a rectified pair"
    )


def _pose_on_body(left: Path, right: Path) -> FloatArray | None:
    """left_from_right (3, 4) of two cameras by how they sit on one body; None if not both files tell."""
    one, other = mounting_beside_camera(left), mounting_beside_camera(right)
    if one is None or other is None:
        return None
    turn = one.camera_from_body @ other.camera_from_body.T
    return np.column_stack([turn, one.camera_from_body @ (other.lever_arm_m - one.lever_arm_m)])


def _pair_of_file(left: Path, right: Path, intrinsics: FloatArray, camera: Path) -> StereoPair | None:
    """The pair by the file of the left camera: KITTI's matrices, a chain of Kalibr, OpenCV or ROS."""
    file, name = camera_file(camera)
    if file.suffix.lower() in DOCUMENTS:
        root = read_document(file)
        if opencv_cameras(root):
            return _pair_of_opencv(intrinsics, camera)
        if orb_slam_cameras(root):
            return _pair_of_orb_slam(root, intrinsics, name)
        return _pair_of_chain(left, right, intrinsics, root, name)
    matrices = projection_matrices(file)
    rows = _rows_of(file, left, right, [name for name, _ in matrices])
    if rows is None:
        return None
    one, other = (_centre(file, matrices[row][1]) for row in rows)
    beside = other - one
    if not beside.any():
        return None
    return StereoPair(intrinsics, intrinsics, np.column_stack([np.eye(3), beside]))


def _pair_of_orb_slam(root: Node, intrinsics: FloatArray, name: str) -> StereoPair | None:
    """The pair of a settings file; without a second camera both are rectified, and alike."""
    first, *others = orb_slam_cameras(root)
    pose = orb_slam_pose(root) if name in ("", first) else None
    right = _intrinsics(_named(root.path, others[0])) if others else intrinsics
    return None if pose is None else StereoPair(intrinsics, right, pose)


def _centre(file: Path, projection: FloatArray) -> FloatArray:
    """Centre (3,) of a projection matrix, b = −P[0, 3] / f where only x differs."""
    if (fault := matrix_fault(projection[:, :3])) is not None:
        raise DatasetError(file, fault)
    return centre_of_projection(projection)


def _pair_of_opencv(intrinsics: FloatArray, camera: Path) -> StereoPair | None:
    """The pair of one file of OpenCV, or of two of ROS: left.yaml and right.yaml."""
    file, _ = camera_file(camera)
    places = [place for place in _siblings(file.absolute()) if is_regular_file(place)]
    found = opencv_pair(camera, next(iter(places), None))
    return None if found is None else StereoPair(intrinsics, _intrinsics(found.path), found.pose)


def _rows_of(file: Path, left: Path, right: Path, names: list[str]) -> tuple[int, int] | None:
    """Matrices of both cameras, by the numbers in the names of their folders; the two if there are two."""
    differing = _differing_parts(left, right)
    numbers = [_number(name, default=k) for k, name in enumerate(names)]
    wanted = [_number(name, default=-1) for name in differing]
    if len({*wanted}) == 2 and {*wanted} <= {*numbers}:
        return numbers.index(wanted[0]), numbers.index(wanted[1])
    if len(names) > 2:
        one, other = (path.name for path in (left, right))
        reason = (
            f"holds {len(names)} cameras: the names {one} and {other} do not tell which two took the images"
        )
        raise DatasetError(file, f"{reason}; give --baseline METRES")
    return (0, 1) if len(names) == 2 else None


def _differing_parts(left: Path, right: Path) -> tuple[str, str]:
    """Where two paths differ, from their ends: ``cam0`` and ``cam1`` of ``cam0/data`` and ``cam1/data``."""
    parts = (reversed(path.absolute().parts) for path in (left, right))
    return next(((a, b) for a, b in zip(*parts, strict=False) if a != b), ("", ""))


def _number(name: str, default: int) -> int:
    digits = re.findall(r"\d+", name)
    return int(digits[-1]) if digits else default


def _pair_of_chain(
    left: Path, right: Path, intrinsics: FloatArray, root: Node, name: str
) -> StereoPair | None:
    """The pair of a camera of Kalibr's chain and the one that took the right images."""
    chain = kalibr_cameras(root)
    names = list(chain)
    if len(names) < 2 or name not in names:
        return None
    other = _other_of_chain(root, left, right, names, name)
    pose = _pose_along_chain([*chain.values()], names.index(name), names.index(other))
    if pose is None:
        pose = _pose_on_body(_named(root.path, name), _named(root.path, other))
    return None if pose is None else StereoPair(intrinsics, _intrinsics(_named(root.path, other)), pose)


def _other_of_chain(root: Node, left: Path, right: Path, names: list[str], name: str) -> str:
    """Which camera took the right images: by the number of their folder, or the only other one."""
    folder = _differing_parts(left, right)[1]
    numbers = {_number(key, default=k): key for k, key in enumerate(names)}
    found = numbers.get(_number(folder, default=-1))
    if found not in (None, name):
        return str(found)
    others = [key for key in names if key != name]
    if len(others) > 1:
        which = f"which of {', '.join(others)} took the right images; name their folder as that camera"
        name = folder or right.name
        raise root.error(f"holds {len(names)} cameras: the name {name} does not tell {which}")
    return others[0]


def _pose_along_chain(chain: list[Node], left: int, right: int) -> FloatArray | None:
    """left_from_right (3, 4) by the steps between neighbours, each camera_from_the_one_before."""
    low, high = sorted((left, right))
    pose = np.eye(4)
    for part in chain[low + 1 : high + 1]:
        node = part.part(_KALIBR_STEP)
        if node is None:
            return None
        pose = np.vstack([pose_of(node, _KALIBR_STEP), [0, 0, 0, 1]]) @ pose
    high_from_low = pose[:3]
    return high_from_low if left == high else _inverse(high_from_low)


def _named(file: Path, name: str) -> Path:
    return file.with_name(f"{file.name}:{name}")


def _inverse(pose: FloatArray) -> FloatArray:
    turn = pose[:, :3].T
    return np.column_stack([turn, -turn @ pose[:, 3]])
