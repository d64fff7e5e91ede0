"""Mounting of a camera on the body of the sensors, as given by the user or found in files.

A text file holds the pose body_from_camera, three rows ``[R | t]`` or four, the last 0 0 0 1. Of EuRoC's
``sensor.yaml`` it is ``T_BS``.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import PRINTED_ROTATION_TOLERANCE, is_rotation
from sfmcpp.sensors import Mounting
from sfmcpp.sources.cameras import camera_file
from sfmcpp.sources.io.documents import DOCUMENTS, Node, read_document
from sfmcpp.sources.io.files import failures_named, read_text_bytes
from sfmcpp.sources.io.number_text import NumberText

_NAMES: dict[str, Callable[[], Mounting]] = {
    "camera": lambda: Mounting(np.eye(3), np.zeros(3)),
    "forward": Mounting.forward_looking,
}
_POSE = "T_BS"


def mounting_of(given: str | Path | Mounting | None) -> Mounting | None:
    """How the camera sits on the body of the sensors.

    Parameters
    ----------
    given : str, Path, Mounting or None
        ``"camera"``: the sensors have the axes of the camera (x right, y down, z ahead). ``"forward"``: those
        of a vehicle (ISO 8855: x ahead, y left, z up), whose camera looks ahead. Else a file with the pose
        body_from_camera: three rows ``[R | t]``, or four, the last 0 0 0 1; or EuRoC's ``sensor.yaml`` of the
        camera, whose ``T_BS`` it is.

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
    if not path.exists() and path.suffix == "":
        rule = f"must be {', '.join(_NAMES)}, or a file with the rows of body_from_camera, [R | t]"
        raise DatasetError(path, f"is no mounting and no file: {rule}")
    if path.suffix.lower() in DOCUMENTS:
        return _require_found(path, mounting_beside_camera(path))
    return _read_mounting(path)


def mounting_beside_camera(path: Path) -> Mounting | None:
    """The mounting that the file of a camera tells beside it: T_BS of EuRoC; None if it tells none.

    Raises
    ------
    DatasetError
        If the file cannot be read, or T_BS is no pose.
    """
    file, _ = camera_file(path)
    if file.suffix.lower() not in DOCUMENTS:
        return None
    node = read_document(file).part(_POSE)
    return None if node is None else _mounting_of_node(node)


def _require_found(path: Path, found: Mounting | None) -> Mounting:
    if found is None:
        raise DatasetError(path, f"holds no {_POSE}, the pose body_from_camera of EuRoC's sensor.yaml")
    return found


def _mounting_of_node(node: Node) -> Mounting:
    numbers = node.numbers()
    if len(numbers) != 16:
        raise node.error(f"{_POSE} holds {len(numbers)} numbers: must be 16, a 4×4 matrix")
    pose = np.reshape(numbers, (4, 4))
    if not np.array_equal(pose[3], [0, 0, 0, 1]):
        raise node.error(f"the last row of {_POSE} is {pose[3].tolist()}: must be 0 0 0 1")
    if not is_rotation(pose[:3, :3], PRINTED_ROTATION_TOLERANCE):
        raise node.error(f"{_POSE} holds no rotation")
    return _mounting_of_pose(np.column_stack([nearest_rotation(pose[:3, :3]), pose[:3, 3]]))


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
        raise DatasetError(path, f"body_from_camera holds no rotation: {error}") from error


def _mounting_of_pose(pose: FloatArray) -> Mounting:
    """Mounting of body_from_camera (≥ 3, 4)."""
    return Mounting(pose[:3, :3].T, pose[:3, 3])
