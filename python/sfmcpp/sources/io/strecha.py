"""The truth of Strecha's multi-view benchmark: a folder with one ``IMAGE.camera`` for each image (CVPR 2008).

A file holds 26 numbers: the calibration matrix K by rows, three coefficients of radial distortion (0 in the
published sets, whose images are undistorted; read as k1, k2, k3), the rotation world_from_camera by rows, the
centre in the world, and width and height of the image: ``x ~ K Rᵀ (X − c)``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import PRINTED_ROTATION_TOLERANCE, is_rotation
from sfmcpp.sources.io.checks import LARGEST_COUNT
from sfmcpp.sources.io.files import failures_named, is_folder, read_text_bytes
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.intrinsics import fixed_but, matrix_fault, perspective_columns, perspective_rows
from sfmcpp.sources.io.number_text import NumberText

SUFFIX = ".camera"
_NUMBERS = 26
_MATRIX, _RADIAL, _ROTATION, _CENTRE = slice(0, 9), slice(9, 12), slice(12, 21), slice(21, 24)
_SIZE = slice(24, 26)


def read_strecha(folder: Path) -> Problem:
    """Read all cameras of a folder; camera model ``"perspective"``, all intrinsics fixed, no points.

    Cameras come in the order of their names, which are those of the images: ``0000.jpg.camera`` is the camera
    of ``0000.jpg``. Those of equal calibration and size share intrinsics. Pixels count as the file has them.

    Raises
    ------
    DatasetError
        If there is no such file, or one of them holds no camera; it names file and line.
    """
    files = camera_files(folder)
    if not files:
        raise DatasetError(folder, f"is a folder without files named IMAGE{SUFFIX}")
    rows = np.stack([_numbers(path) for path in files])
    calibrations, index = np.unique(rows[:, [*range(12), 24, 25]], axis=0, return_inverse=True)
    intrinsics = _intrinsics(calibrations)
    rotations = nearest_rotation(rows[:, _ROTATION].reshape(-1, 3, 3))
    return Problem(
        "perspective",
        np.concatenate([rotations, rows[:, _CENTRE, None]], axis=2),
        intrinsics,
        np.empty((0, 3)),
        np.empty(0, dtype=np.int32),
        np.empty(0, dtype=np.int32),
        np.empty((0, 2)),
        intrinsics_index=index.reshape(-1).astype(np.int32),
        fixed_intrinsics=fixed_but(len(intrinsics)),
        metadata=Metadata(
            "strecha",
            image_names=[path.name.removesuffix(SUFFIX) for path in files],
            image_sizes=rows[:, _SIZE].astype(np.int64),
        ),
    )


def camera_files(folder: Path) -> list[Path]:
    """Files of `folder` named ``IMAGE.camera``, by name; none if it is no folder."""
    with failures_named(folder):
        return sorted(folder.glob(f"*{SUFFIX}")) if is_folder(folder) else []


def _numbers(path: Path) -> FloatArray:
    text = NumberText(path, read_text_bytes(path))
    if len(text.values) != _NUMBERS:
        raise DatasetError(
            path,
            f"holds {len(text.values)} numbers: must be {_NUMBERS} (K, three radial coefficients, rotation, "
            "centre, width and height)",
        )
    if (fault := matrix_fault(text.values[_MATRIX].reshape(3, 3))) is not None:
        raise text.error(fault, _MATRIX.start)
    if not is_rotation(text.values[_ROTATION].reshape(3, 3), PRINTED_ROTATION_TOLERANCE):
        raise text.error("the nine numbers from here are no rotation matrix", _ROTATION.start)
    text.integers(_SIZE, "image size", 1, LARGEST_COUNT)
    return text.values


def _intrinsics(calibrations: FloatArray) -> FloatArray:
    """Perspective intrinsics (G, K) of rows that begin with K and the radial coefficients."""
    f, skew, cx, _, fv, cy, *_ = calibrations.T
    values = perspective_rows(len(calibrations))
    columns = perspective_columns("f", "aspect", "cx", "cy", "skew", "k1", "k2", "k3")
    values[:, columns] = np.column_stack([f, fv / f, cx, cy, skew, calibrations[:, _RADIAL]])
    return values


FORMAT = Format(
    "strecha",
    "Strecha's benchmark: a folder with IMAGE.camera for each image",
    (),
    read_strecha,
    claim=lambda path: bool(camera_files(path)),
)
