"""How the camera sits on the body of the sensors, as the user says it: by name, or in a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.sensors import Mounting
from sfmcpp.sources.io.compression import read_bytes
from sfmcpp.sources.io.failures import failures_named
from sfmcpp.sources.io.number_text import NumberText

# Sensors in the camera's axes, and in those of a vehicle (ISO 8855: x forward, y left, z up).
CAMERA, FORWARD = "camera", "forward"


def mounting_of(text: str | None) -> Mounting | None:
    """Understand ``--mounting``: ``camera``, ``forward``, or a file; None for None.

    Raises
    ------
    DatasetError
        If the file cannot be read, or holds no pose.
    """
    if text is None:
        return None
    if text == CAMERA:
        return Mounting(np.eye(3), np.zeros(3))
    if text == FORWARD:
        return Mounting.forward_looking()
    return read_mounting(Path(text))


def read_mounting(path: Path) -> Mounting:
    """Read the pose body_from_camera: three rows ``[R | t]``, or four, the last 0 0 0 1.

    Raises
    ------
    DatasetError
        If the file cannot be read, or holds no pose.
    """
    with failures_named(path):
        numbers = NumberText(path, read_bytes(path).replace(b",", b" "), comments=True).values
    if len(numbers) not in (12, 16):
        raise DatasetError(path, f"holds {len(numbers)} numbers: must be 12 or 16, the rows of [R | t]")
    pose = numbers.reshape(-1, 4)
    if len(pose) == 4 and not np.array_equal(pose[3], [0, 0, 0, 1]):
        raise DatasetError(path, f"its last row is {pose[3].tolist()}: must be 0 0 0 1")
    try:
        return Mounting(pose[:3, :3].T, pose[:3, 3])
    except InvalidArgument as error:
        raise DatasetError(path, f"body_from_camera holds no rotation: {error}") from error
