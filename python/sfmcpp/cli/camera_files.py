"""The camera of images, from the files that data sets put beside them.

``calib.txt`` is KITTI's: rows of twelve numbers, the 3×4 projection matrices of rectified cameras that share
one calibration matrix, each after a name such as ``P0:`` or ``P_rect_00:``, or without; other lines are left
alone.
``K.txt`` holds a 3×3 calibration matrix.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.compression import read_bytes
from sfmcpp.sources.io.failures import failures_named
from sfmcpp.sources.io.number_text import NumberText

CALIBRATION_FILES = ("calib.txt", "K.txt")
_PROJECTION = re.compile(r"(?:P\w*:)?((?:\s*[-+.\deE]+(?=\s|$)){12})\s*")


def places_beside(source: Path) -> tuple[Path, ...]:
    """Folders in which files about a folder of images or a video are looked for, the nearest first."""
    folder = source.resolve()
    return (folder, folder.parent) if folder.is_dir() else (folder.parent,)


def find_intrinsics(source: Path) -> FloatArray:
    """Read the camera of a folder of images or a video from the file nearest to it.

    Returns
    -------
    (5,) float64
        ``(f, aspect, cx, cy, skew)`` in pixels.

    Raises
    ------
    DatasetError
        If there is no such file, or it holds no camera.
    """
    for place in places_beside(source):
        for name in CALIBRATION_FILES:
            if (place / name).is_file():
                return read_intrinsics(place / name)
    where = " or ".join(CALIBRATION_FILES)
    reason = f"its camera is not known: there is no {where} beside it; give --camera F,CX,CY in pixels"
    raise DatasetError(source, reason)


def read_intrinsics(path: Path) -> FloatArray:
    """Read ``(f, aspect, cx, cy, skew)`` (5,) from a file named ``calib.txt`` or ``K.txt``."""
    with failures_named(path):
        data = read_bytes(path)
    matrices = _square(path, data) if path.name == "K.txt" else _projections(path, data)
    if not np.allclose(matrices, matrices[0], rtol=1e-9):
        raise DatasetError(path, "its cameras differ: give --camera F,CX,CY of the one that took the images")
    return _intrinsics(path, matrices[0])


def _square(path: Path, data: bytes) -> FloatArray:
    values = NumberText(path, data.replace(b",", b" "), comments=True).values
    if len(values) != 9:
        raise DatasetError(path, f"holds {len(values)} numbers: must be 9, a calibration matrix")
    return values.reshape(1, 3, 3)


def _projections(path: Path, data: bytes) -> FloatArray:
    lines = data.decode("utf-8", "replace").splitlines()
    rows = [found[1].encode() for line in lines if (found := _PROJECTION.fullmatch(line.strip()))]
    if not rows:
        raise DatasetError(path, "holds no row of 12 numbers, the projection matrix of a camera")
    return NumberText(path, b"\n".join(rows)).values.reshape(-1, 3, 4)[:, :, :3]


def _intrinsics(path: Path, matrix: FloatArray) -> FloatArray:
    (f, skew, cx), (zero, fv, cy), last = matrix
    if not (f > 0 and fv > 0 and zero == 0 and np.array_equal(last, [0, 0, 1])):
        rule = "must be [[fu, skew, cu], [0, fv, cv], [0, 0, 1]], fu and fv positive"
        raise DatasetError(path, f"the calibration matrix is {matrix.tolist()}: {rule}")
    return np.array([f, fv / f, cx, cy, skew])
