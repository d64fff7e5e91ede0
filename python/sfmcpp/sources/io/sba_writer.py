"""Writing sba's demonstration files; the format is described where it is read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.quaternions import quaternion_from_rotation
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import require_valid
from sfmcpp.sources.io.intrinsics import as_perspective, perspective_columns, require_defaults_except
from sfmcpp.sources.io.poses import pose_from_cameras
from sfmcpp.sources.io.rows import format_rows, format_strings, ragged_text
from sfmcpp.sources.io.sba_files import DISTORTION, INTRINSICS, calibration_path, points_path
from sfmcpp.sources.io.tracks import by_point


def write_sba(problem: Problem, path: Path) -> None:
    """Write ``…cams….txt``, ``…pts.txt`` beside it, and ``…calib.txt`` if all cameras share fixed intrinsics.

    Standard deviations are written as covariances σ² I; masks are not kept.

    Raises
    ------
    DatasetError
        If there are no cameras or no points, the camera model has k4 or k5, or a file cannot be written.
    """
    require_valid(problem, path)
    if not problem.num_cameras or not problem.num_points:
        raise DatasetError(path, "sba's files cannot hold a problem without cameras or without points")
    values, fixed = as_perspective(problem)
    require_defaults_except(values, INTRINSICS + DISTORTION, "sba's files", path)
    values, fixed = values[problem.intrinsics_index], fixed[problem.intrinsics_index]
    distortion = perspective_columns(*DISTORTION)
    if problem.camera_model == "calibrated" and (values == values[0]).all():
        texts = {path: _cameras_text(problem, values, ())}
        texts[calibration_path(path)] = _calibration_text(values[0])
    elif values[:, distortion].any() or not fixed[:, distortion].all():
        texts = {path: _cameras_text(problem, values, INTRINSICS + DISTORTION)}
    else:
        texts = {path: _cameras_text(problem, values, INTRINSICS)}
    texts[points_path(path)] = _points_text(problem)
    with atomic_files(*texts) as files:
        for file, text in zip(files, texts.values(), strict=True):
            file.write(text.encode("ascii"))


def _cameras_text(problem: Problem, values: FloatArray, names: tuple[str, ...]) -> str:
    rotations, translations = pose_from_cameras(problem.cameras)
    quaternions = quaternion_from_rotation(rotations)
    table = np.concatenate([values[:, perspective_columns(*names)], quaternions, translations], axis=1)
    head = " ".join((*names, "qw qx qy qz tx ty tz"))
    return f"# {head}\n" + "".join(format_rows(" ".join(["%r"] * table.shape[1]) + "\n", *table.T))


def _calibration_text(values: FloatArray) -> str:
    f, cx, cy, aspect, skew = values[perspective_columns(*INTRINSICS)].tolist()
    return f"{f!r} {skew!r} {cx!r}\n0.0 {f * aspect!r} {cy!r}\n0.0 0.0 1.0\n"


def _points_text(problem: Problem) -> str:
    order, counts = by_point(problem)
    template, columns = " %d %r %r", [problem.camera_index, *problem.pixels.T]
    if problem.sigma_px is not None:
        template, columns = template + " %r 0 %r", [*columns, *[problem.sigma_px**2] * 2]
    heads = format_strings("\n%r %r %r  %d ", *problem.points.T, counts)
    items = format_strings(template, *(column[order] for column in columns))
    return "# X Y Z  frames  frame x y ..." + ragged_text(heads, items, counts) + "\n"
