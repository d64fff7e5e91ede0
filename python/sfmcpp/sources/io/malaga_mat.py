"""Tracks as MATLAB files, one an image: ``Image1.mat``, ``Image2.mat`` … of Malaga PARKING-6L.

Each holds a matrix ``Image`` of six columns. Its first row is the motion since the last image; the others are
a point's number, counted from 1, u and v [px], and three zeros.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.image_tracks import LARGEST_INDEX, ImageTracks, image_tracks
from sfmcpp.sources.io.mat import mat_variables, number_array, require_finite

_VARIABLE, _COLUMNS = "Image", 6
_FILE = re.compile(r"Image(\d+)\.mat")


def claims(folder: Path) -> bool:
    """Whether a folder holds such files."""
    return any(_FILE.fullmatch(entry.name) for entry in folder.iterdir())


def read_malaga(folder: Path) -> ImageTracks:
    """Read all images of a folder in the order of their numbers.

    Raises
    ------
    DatasetError
        If a file is no MATLAB file, lacks the matrix, or a point's number is no positive integer or stands
        there twice.
    """
    matches = [match for match in map(_FILE.fullmatch, sorted(e.name for e in folder.iterdir())) if match]
    files = sorted(matches, key=lambda match: (int(match[1]), match[0]))
    rows = [_rows(folder / match[0]) for match in files]
    joined = np.concatenate(rows)
    image = np.repeat(np.arange(len(rows)), [len(row) for row in rows])
    track = np.unique(joined[:, 0], return_inverse=True)[1]
    try:
        return image_tracks(image, track, joined[:, 1:], names=[match[0] for match in files])
    except InvalidArgument as error:
        raise DatasetError(folder, str(error)) from error


def _rows(path: Path) -> FloatArray:
    """(m, 3) number of the point, u, v."""
    value = mat_variables(path, [_VARIABLE])[_VARIABLE]
    matrix = number_array(path, _VARIABLE, value, 2, f"(rows, {_COLUMNS})")
    require_finite(path, _VARIABLE, matrix)
    if matrix.shape[1] != _COLUMNS:
        raise DatasetError(path, f"{_VARIABLE} has shape {matrix.shape}: must be (rows, {_COLUMNS})")
    rows = matrix[1:, :3]
    good = (rows[:, 0] >= 1) & (rows[:, 0] <= LARGEST_INDEX) & (rows[:, 0] == np.floor(rows[:, 0]))
    if not good.all():
        worst = int(np.argmin(good))
        raise DatasetError(
            path, f"{_VARIABLE}[{worst + 1}, 0] is {rows[worst, 0]}: must be a point's number from 1"
        )
    return rows
