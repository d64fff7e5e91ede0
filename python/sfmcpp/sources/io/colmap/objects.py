"""Conversion between problems and pycolmap's reconstructions, by way of binary files."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.camera_models import PINHOLE_MODELS
from sfmcpp.sources.io.colmap.fisheye import is_fisheye
from sfmcpp.sources.io.colmap.formats import read_colmap_binary, write_colmap_binary
from sfmcpp.sources.io.views import UNREGISTERED


def from_pycolmap(reconstruction: Any) -> Problem:
    """Convert a pycolmap reconstruction to a problem.

    Parameters
    ----------
    reconstruction : pycolmap.Reconstruction
        Not changed. Images without a pose are left out with their keypoints, as in COLMAP's own files;
        ``metadata.extra["unregistered_images"]`` lists them.

    Returns
    -------
    Problem
        Camera model ``"perspective"``, or a :class:`CameraFunction` of fisheye lenses; contents and order as
        for ``sfmcpp.read`` of a binary COLMAP model. Names and identifiers are metadata.

    Raises
    ------
    InvalidArgument
        If it is no reconstruction, or not a complete one, a sensor of a rig is no camera or has no pose, or
        a camera model is none of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV without
        a divisor, or, alone, of SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, OPENCV_FISHEYE, SIMPLE_FISHEYE,
        FISHEYE.
    """
    if not callable(getattr(reconstruction, "write_binary", None)):
        kind = type(reconstruction).__name__
        raise InvalidArgument(f"reconstruction is a {kind}, must be a pycolmap.Reconstruction")
    with _temporary_folder("reconstruction") as folder:
        try:
            reconstruction.write_binary(str(folder))
        except (TypeError, ValueError, RuntimeError) as error:  # half-built, or the class itself
            reason = _sensor_without_pose(reconstruction) or (
                f"pycolmap cannot write it: {str(error).partition(chr(10))[0]}"
            )
            raise InvalidArgument(f"reconstruction: {reason}") from error
        problem = read_colmap_binary(folder)
    images = reconstruction.images
    if names := [images[key].name for key in sorted(images) if not _has_pose(images[key])]:
        problem.metadata.extra[UNREGISTERED] = names
    return problem


def _has_pose(image: Any) -> bool:
    """Whether an image has a pose, which pycolmap before 3.11 calls registered."""
    return bool(image.has_pose if hasattr(image, "has_pose") else image.registered)


def _sensor_without_pose(reconstruction: Any) -> str:
    """Say which camera has no pose in its rig, of which pycolmap does not tell; empty if all have."""
    for number, rig in getattr(getattr(reconstruction, "rigs", None), "items", dict)():
        for sensor, pose in getattr(rig, "non_ref_sensors", {}).items():
            if pose is None:
                return f"rig {number}: the pose of camera {sensor.id} in the rig is not known"
    return ""


@checked()
def to_pycolmap(problem: Problem) -> Any:
    """Convert a problem to a pycolmap reconstruction, with its rigs or a trivial rig per camera.

    Parameters
    ----------
    problem : Problem
        Not changed. Names and identifiers are those of its metadata, if any.

    Returns
    -------
    pycolmap.Reconstruction
        Errors of points are computed from this state [px]. Masks, standard deviations and covariances are not
        kept, nor is a camera's `has_prior_focal_length`, which COLMAP's files do not have.

    Raises
    ------
    ImportError
        If pycolmap is not installed.
    InvalidArgument
        If no supported camera model of COLMAP holds the cameras, or no rig of COLMAP the sensors.
    """
    import pycolmap

    if not (is_fisheye(problem) or problem.camera_model in PINHOLE_MODELS):
        name = getattr(problem.camera_model, "name", problem.camera_model)
        raise InvalidArgument(f"problem: no camera of COLMAP is one of camera model {name!r}")
    with _temporary_folder("problem") as folder:
        write_colmap_binary(problem, folder)
        return pycolmap.Reconstruction(str(folder))


@contextmanager
def _temporary_folder(argument: str) -> Iterator[Path]:
    """A folder for a while; what is wrong with its files is wrong with the argument."""
    with tempfile.TemporaryDirectory(prefix="sfmcpp-") as name:
        folder = Path(name)
        try:
            yield folder
        except DatasetError as error:
            where = "" if Path(error.path) == folder else f"{Path(error.path).stem}: "
            raise InvalidArgument(f"{argument}: {where}{error.reason}") from error
