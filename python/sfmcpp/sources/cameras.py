"""Intrinsics of a camera, as given by the user or found beside its images.

``calib.txt`` is KITTI's: rows of twelve numbers, the 3×4 projection matrices of rectified cameras that share
one calibration matrix, each after a name such as ``P0:`` or ``P_rect_00:``, or without; other lines are left
alone.
``K.txt``, or a file of any other name that has nine numbers alone, holds a 3×3 calibration matrix. YAML and
XML are of OpenCV, Kalibr or EuRoC, and may have distortion; EuRoC's ``sensor.yaml`` lies one folder above the
images.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry.pinhole import pinhole_rows
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.calibration import Calibration, read_calibration
from sfmcpp.sources.io.documents import DOCUMENTS
from sfmcpp.sources.io.files import failures_named, is_folder, is_regular_file, read_text_bytes
from sfmcpp.sources.io.intrinsics import matrix_fault, pinhole_of_matrix
from sfmcpp.sources.io.number_text import NumberText
from sfmcpp.sources.vision import Frames

CALIBRATION_FILES = ("calib.txt", "K.txt", "sensor.yaml")
_PROJECTION = re.compile(r"(?:(P\w*):)?((?:\s*[-+.\deE]+(?=\s|$)){12})\s*")

# A principal point that is off the middle by such a factor, the same along both axes but for another, is that
# of images of another size; cropping or a lens shifts it by pixels, and seldom along the diagonal.
_OTHER_SIZE, _SAME_FACTOR = 1.3, 1.1


def places_beside(source: Path) -> tuple[Path, ...]:
    """Folders in which files about a folder of images or a video are looked for, the nearest first."""
    folder = source.resolve()
    return (folder, folder.parent) if is_folder(folder) else (folder.parent,)


def file_beside(source: Path, name: str) -> Path | None:
    """The file of that name nearest to a folder of images or a video; None if there is none."""
    return next((place / name for place in places_beside(source) if is_regular_file(place / name)), None)


def intrinsics_of(numbers: Sequence[float]) -> FloatArray:
    """``(f, aspect, cx, cy, skew)`` (5,) of ``(f, cx, cy)`` or of all five [px].

    Raises
    ------
    InvalidArgument
        If there are not as many, one is not finite, or f or aspect is not positive.
    """
    given = tuple(float(number) for number in numbers)
    values = np.array((given[0], 1.0, *given[1:], 0.0) if len(given) == 3 else given)
    if len(values) != 5 or not np.isfinite(values).all() or values[:2].min() <= 0:
        rule = "must be f, cx, cy or f, aspect, cx, cy, skew in pixels, f and aspect positive"
        raise InvalidArgument(f"camera = {given}: {rule}")
    return values


def find_camera(source: Path) -> Path:
    """Find the camera file nearest to a folder of images or a video.

    Raises
    ------
    DatasetError
        If there is no such file.
    """
    for place in places_beside(source):
        for name in CALIBRATION_FILES:
            if is_regular_file(place / name):
                return place / name
    where = f"{', '.join(CALIBRATION_FILES[:-1])} or {CALIBRATION_FILES[-1]}"
    reason = f"its camera is not known: there is no {where} beside it; give --camera FILE or F,CX,CY [px]"
    raise DatasetError(source, reason)


def read_intrinsics(path: Path) -> FloatArray:
    """Read a camera from ``calib.txt``, ``K.txt``, or a file of OpenCV, Kalibr or EuRoC (YAML or XML).

    Parameters
    ----------
    path : Path
        The file; with ``:cam1`` behind it the camera of that name, of a file that holds several.

    Returns
    -------
    (5,) or (12,) float64
        ``(f, aspect, cx, cy, skew)`` in pixels, and with distortion all of the model ``"perspective"``.

    Raises
    ------
    DatasetError
        If the file cannot be read, holds no camera, or one with a lens that the model does not hold.
    """
    return pinhole_rows(read_camera(path).intrinsics)


def read_camera(path: Path) -> Calibration:
    """As :func:`read_intrinsics`, with the other contents of the file."""
    file, camera = camera_file(path)
    if file.suffix.lower() in DOCUMENTS:
        return read_calibration(file, camera)
    projections = projection_matrices(path)
    matrices = np.stack([p[:, :3] for _, p in projections]) if projections else _matrix_of_numbers(path)
    if not np.allclose(matrices, matrices[0], rtol=1e-9):
        raise DatasetError(path, "its cameras differ: give --camera F,CX,CY of the one that took the images")
    if (fault := matrix_fault(matrices[0])) is not None:
        raise DatasetError(path, fault)
    return Calibration(pinhole_of_matrix(matrices[0]), first_pixel_px=0.0 if projections else None)


def camera_file(path: str | Path) -> tuple[Path, str]:
    """Split what follows the last colon from a path: the name of a camera, if the rest is YAML or XML."""
    file, colon, name = str(path).rpartition(":")
    named = colon and Path(file).suffix.lower() in DOCUMENTS
    return (Path(file), name) if named else (Path(path), "")


def projection_matrices(path: Path) -> list[tuple[str, FloatArray]]:
    """Projection matrices (3, 4) of KITTI's ``calib.txt`` with their names, empty where a row has none.

    None of another file.

    Raises
    ------
    DatasetError
        If the file cannot be read.
    """
    lines = [] if path.name == "K.txt" else _text_of(path).decode("utf-8", "replace").splitlines()
    rows = [found for line in lines if (found := _PROJECTION.fullmatch(line.strip()))]
    if not rows:
        return []
    numbers = NumberText(path, b"\n".join(row[2].encode() for row in rows)).values
    return [(row[1] or "", matrix) for row, matrix in zip(rows, numbers.reshape(-1, 3, 4), strict=True)]


def _text_of(path: Path) -> bytes:
    with failures_named(path):
        return read_text_bytes(path)


def _matrix_of_numbers(path: Path) -> FloatArray:
    named = path.name == "K.txt"
    data = _text_of(path)
    try:
        values = NumberText(path, data.replace(b",", b" "), comments=True).values
    except DatasetError:
        if named:
            raise
        values = np.empty(0)
    if len(values) == 9:
        return values.reshape(1, 3, 3)
    if named:
        raise DatasetError(path, f"holds {len(values)} numbers: must be 9, a calibration matrix")
    neither = "holds no row of 12 numbers, the projection matrix of a camera, nor 9, a calibration matrix"
    raise DatasetError(path, neither)


def size_that_fits(
    images: Frames, intrinsics: FloatArray, calibrated: tuple[int, int] | None
) -> tuple[int, int]:
    """Width and height of the images; a DatasetError if the camera is not for these."""
    cx, cy = intrinsics[2:4]
    height, width = next(image for _, image in images.numbered()).shape
    size = f"{width}×{height}"
    if not (0 < cx < width and 0 < cy < height):
        reason = f"the camera's principal point ({cx:g}, {cy:g}) lies outside of the images of {size} pixels"
        raise DatasetError(images.path, reason)
    if calibrated not in (None, (width, height)):
        wanted = f"{calibrated[0]}×{calibrated[1]}"
        reason = f"its images have {size} pixels, the camera is for {wanted}: scale one of them to the other"
        raise DatasetError(images.path, reason)
    return width, height


def doubt_of_size(intrinsics: FloatArray, width: int, height: int) -> str | None:
    """Tell if the principal point is off the middle by the same factor along both axes."""
    factors = 2 * intrinsics[2:4] / (width, height)
    if factors.max() > _SAME_FACTOR * factors.min() or max(*factors, *(1 / factors)) < _OTHER_SIZE:
        return None
    cx, cy = intrinsics[2:4]
    whole = (
        f"the camera's principal point ({cx:g}, {cy:g}) is the middle of images of {2 * cx:.0f}×{2 * cy:.0f}"
    )
    return f"{whole} pixels, these have {width}×{height}: if they were scaled, scale f, cx and cy, too"
