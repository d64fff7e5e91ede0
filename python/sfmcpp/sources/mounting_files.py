"""Mounting of a camera on the body of the sensors, as given by the user or found in files.

A text file holds the pose body_from_camera, three rows ``[R | t]`` or four, the last 0 0 0 1. Of EuRoC's
``sensor.yaml`` it is ``T_BS``. Kalibr's ``camchain-imucam.yaml`` holds the inverse, ``T_cam_imu``, and how
far the clock of the sensors is off.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import Mounting
from sfmcpp.sources.cameras import camera_file
from sfmcpp.sources.io.calibration import chosen_camera
from sfmcpp.sources.io.documents import DOCUMENTS, Node, read_document
from sfmcpp.sources.io.files import failures_named, is_present, read_text_bytes
from sfmcpp.sources.io.number_text import NumberText
from sfmcpp.sources.io.opencv_cameras import exact_rotation

_NAMES: dict[str, Callable[[], Mounting]] = {
    "camera": lambda: Mounting(np.eye(3), np.zeros(3)),
    "forward": Mounting.forward_looking,
}
_POSE = "T_BS"  # body_from_camera
_KALIBR_POSE, _KALIBR_SHIFT = "T_cam_imu", "timeshift_cam_imu"  # camera_from_body; sensor − camera time [s]


def mounting_of(given: str | Path | Mounting | None) -> Mounting | None:
    """How the camera sits on the body of the sensors.

    Parameters
    ----------
    given : str, Path, Mounting or None
        ``"camera"``: the sensors have the axes of the camera (x right, y down, z ahead). ``"forward"``: those
        of a vehicle (ISO 8855: x ahead, y left, z up), whose camera looks ahead. Else a file with the pose
        body_from_camera: three rows ``[R | t]``, or four, the last 0 0 0 1; EuRoC's ``sensor.yaml`` of the
        camera, whose ``T_BS`` it is; or Kalibr's ``camchain-imucam.yaml``, whose ``T_cam_imu`` is the
        inverse, with ``:cam1`` behind it for one of several cameras.

    Raises
    ------
    DatasetError
        If the file cannot be read, or holds no pose.
    """
    if given is None or isinstance(given, Mounting):
        return given
    if given in _NAMES:
        return _NAMES[str(given)]()
    path = Path(given)
    with failures_named(path):
        is_there = is_present(path)
    if not is_there and path.suffix == "":
        rule = f"must be {', '.join(_NAMES)}, or a file with the rows of body_from_camera, [R | t]"
        raise DatasetError(path, f"is no mounting and no file: {rule}")
    if _is_document(path):
        return _require_found(path, mounting_beside_camera(path))
    return _read_mounting(path)


def clock_offset_of(given: str | Path | Mounting | None) -> float:
    """Camera time − sensor time [s] as the same file has it, −``timeshift_cam_imu`` of Kalibr; else 0.

    Parameters
    ----------
    given : str, Path, Mounting or None
        As for :func:`mounting_of`.

    Raises
    ------
    DatasetError
        If the file cannot be read, or holds something else there.
    """
    if given is None or isinstance(given, Mounting) or not _is_document(Path(given)):
        return 0.0
    file, name = camera_file(Path(given))
    chain = _kalibr_camera(read_document(file), name)
    node = None if chain is None else chain.part(_KALIBR_SHIFT)
    if node is None:
        return 0.0
    numbers = node.numbers()
    if len(numbers) != 1:
        raise node.error(f"{_KALIBR_SHIFT} holds {len(numbers)} numbers: must be 1, in seconds")
    return -numbers[0] if numbers[0] else 0.0


def mounting_beside_camera(path: Path) -> Mounting | None:
    """The mounting that the file of a camera has beside it, of EuRoC or Kalibr; None if it has none.

    Raises
    ------
    DatasetError
        If the file cannot be read, or T_BS or T_cam_imu is no pose.
    """
    if not _is_document(path):
        return None
    file, name = camera_file(path)
    root = read_document(file)
    node = root.part(_POSE)
    if node is not None:
        body_from_camera = pose_of(node, _POSE)
        return _named(node, lambda: _mounting_of_pose(body_from_camera))
    chain = _kalibr_camera(root, name)
    node = None if chain is None else chain.part(_KALIBR_POSE)
    if node is None:
        return None
    camera_from_body = pose_of(node, _KALIBR_POSE)
    rotation = camera_from_body[:, :3]
    return _named(node, lambda: Mounting(rotation, -rotation.T @ camera_from_body[:, 3]))


def _named(node: Node, make: Callable[[], Mounting]) -> Mounting:
    """A mounting, or the DatasetError of the place where what cannot be one is."""
    try:
        return make()
    except InvalidArgument as error:
        raise node.error(str(error)) from error


def _is_document(path: Path) -> bool:
    return camera_file(path)[0].suffix.lower() in DOCUMENTS


def _kalibr_camera(root: Node, name: str) -> Node | None:
    """The camera of that name in a chain of Kalibr; None if the chain was calibrated without an IMU."""
    cameras = root.value.values() if isinstance(root.value, dict) else ()
    return chosen_camera(root, name) if any(camera.part(_KALIBR_POSE) for camera in cameras) else None


def _require_found(path: Path, found: Mounting | None) -> Mounting:
    if found is None:
        rule = f"{_POSE} of EuRoC's sensor.yaml or {_KALIBR_POSE} of Kalibr's camchain-imucam.yaml"
        raise DatasetError(path, f"holds no mounting: must have {rule}")
    return found


def pose_of(node: Node, name: str) -> FloatArray:
    """A 4×4 matrix as ``[R | t]`` (3, 4), its rotation made exact.

    Raises
    ------
    DatasetError
        If it is none.
    """
    numbers = node.numbers()
    if len(numbers) != 16:
        raise node.error(f"{name} holds {len(numbers)} numbers: must be 16, a 4×4 matrix")
    pose = np.reshape(numbers, (4, 4))
    if not np.array_equal(pose[3], [0, 0, 0, 1]):
        raise node.error(f"the last row of {name} is {pose[3].tolist()}: must be 0 0 0 1")
    return np.column_stack([exact_rotation(node, pose[:3, :3], name), pose[:3, 3]])


def _read_mounting(path: Path) -> Mounting:
    with failures_named(path):
        numbers = NumberText(path, read_text_bytes(path).replace(b",", b" "), comments=True).values
    if len(numbers) not in (12, 16):
        raise DatasetError(path, f"holds {len(numbers)} numbers: must be 12 or 16, the rows of [R | t]")
    pose = numbers.reshape(-1, 4)
    if len(pose) == 4 and not np.array_equal(pose[3], [0, 0, 0, 1]):
        raise DatasetError(path, f"its last row is {pose[3].tolist()}: must be 0 0 0 1")
    try:
        return _mounting_of_pose(pose)
    except InvalidArgument as error:
        about_rotation = str(error).startswith("camera_from_body")
        what = "holds no rotation" if about_rotation else "is no mounting"
        raise DatasetError(path, f"body_from_camera {what}: {error}") from error


def _mounting_of_pose(pose: FloatArray) -> Mounting:
    """Mounting of body_from_camera (≥ 3, 4)."""
    return Mounting(pose[:3, :3].T, pose[:3, 3])
