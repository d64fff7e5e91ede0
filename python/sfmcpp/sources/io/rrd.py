"""Recordings of rerun (rerun.io), ``.rrd``, for its viewer: points, and cameras with what they see.

Its library is an extra, ``pip install 'sfmcpp[rerun]'``. It numbers the parts of a file by the clock: two
files of one problem show the same and differ in bytes.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import image_names, point_colors, require_valid
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.intrinsics import CornerLenses, lenses_from_corner, perspective_columns

if TYPE_CHECKING:
    from rerun import RecordingStream

POINT_COLOR = (255, 255, 255)
# How far before its centre the image of a camera is shown, of the extent of all centres and points.
_IMAGE_DISTANCE = 0.03
# The relative error of a number in single precision, and the largest that a place may have, of that extent.
_ROUNDING, _LARGEST_ERROR = 2.0**-24, 1e-5


def write_rrd(problem: Problem, path: Path) -> None:
    """Write ``world/points`` and, for each camera, ``world/cameras/NAME`` with its pixels below.

    Cameras are pinholes as wide as their images, or, where the metadata do not tell, as their observations
    ask for; distortion is not shown. Without names in the metadata they are ``image_000001`` and so on.

    Recordings hold places in single precision, half a metre on the scale of the Earth. A world that is far
    from zero for its extent begins at :func:`recorded_origin`, which ``world`` has as ``origin``.

    Raises
    ------
    DatasetError
        If rerun is not installed, metadata do not fit the problem, or the file cannot be written.
    """
    require_valid(problem, path)
    lenses = lenses_from_corner(problem, path)
    recording = _recording(path)
    stream = recording.binary_stream()
    origin = recorded_origin(problem)
    _log_origin(origin, recording)
    _log_points(problem, origin, recording, path)
    _log_cameras(problem, origin, lenses, recording, path)
    with atomic_files(path) as (file,):
        file.write(stream.read() or b"")


def recorded_origin(problem: Problem) -> FloatArray:
    """What a recording takes off all points and centres (3,): zero, but in a world far from it."""
    places = np.concatenate([problem.points, problem.centres])
    extent = _extent(problem)
    if not len(places) or np.abs(np.median(places, axis=0)).max() * _ROUNDING <= _LARGEST_ERROR * extent:
        return np.zeros(3)
    unit = 10.0 ** np.floor(np.log10(extent))
    return np.asarray(np.round(np.median(places, axis=0) / unit) * unit)


def _recording(path: Path) -> RecordingStream:
    try:
        from rerun import RecordingStream
    except ImportError as error:
        raise DatasetError(path, f"recordings need {error.name}: pip install 'sfmcpp[rerun]'") from None
    return RecordingStream("sfmcpp", recording_id=path.stem, send_properties=False)


def _log_origin(origin: FloatArray, recording: RecordingStream) -> None:
    from rerun import AnyValues

    if origin.any():
        recording.log("world", AnyValues(origin=origin), static=True)


def _log_points(problem: Problem, origin: FloatArray, recording: RecordingStream, path: Path) -> None:
    from rerun import Points3D

    colors = point_colors(problem, POINT_COLOR, path)
    recording.log("world/points", Points3D(problem.points - origin, colors=colors), static=True)


def _log_cameras(
    problem: Problem, origin: FloatArray, lenses: CornerLenses, recording: RecordingStream, path: Path
) -> None:
    from rerun import Pinhole, Points2D, Transform3D, ViewCoordinates, new_entity_path

    names = image_names(problem, path)
    distance = _IMAGE_DISTANCE * _extent(problem)
    columns = perspective_columns("f", "aspect", "cx", "cy")
    pixels, centres = _pixels_of_cameras(problem), problem.centres - origin
    for i, (name, row) in enumerate(zip(names, problem.intrinsics_index.tolist(), strict=True)):
        f, aspect, cx, cy = lenses.values[row, columns]
        camera = new_entity_path(["world", "cameras", name])
        pose = Transform3D(translation=centres[i], mat3x3=problem.rotations[i])
        pinhole = Pinhole(
            focal_length=(f, aspect * f),
            principal_point=(cx, cy),
            resolution=lenses.sizes[row],
            camera_xyz=ViewCoordinates.RDF,
            image_plane_distance=distance,
        )
        recording.log(camera, pose, pinhole, static=True)
        recording.log(f"{camera}/pixels", Points2D(pixels[i] + lenses.origin[row]), static=True)


def _pixels_of_cameras(problem: Problem) -> list[FloatArray]:
    order = np.argsort(problem.camera_index, kind="stable")
    counts = np.bincount(problem.camera_index, minlength=problem.num_cameras)
    return np.split(problem.pixels[order], np.cumsum(counts)[:-1])


def _extent(problem: Problem) -> float:
    """Between the centres and the points that are not far from all others."""
    places = np.concatenate([problem.points, problem.centres])
    if not len(places):
        return 1.0
    low, high = np.percentile(places, [10, 90], axis=0)
    return float(np.linalg.norm(high - low)) or 1.0


FORMAT = Format(
    "rerun",
    "recording for rerun's viewer: points, cameras and pixels",
    (".rrd",),
    None,
    write_rrd,
    lacks=(
        "origin of the world",
        "keypoints without a point",
        "masks",
        "rigid frames",
        "uncertainties of observations",
    ),
)
