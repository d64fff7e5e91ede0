"""Poses of images by name: of a model that is to be measured, or of its truth, wherever they come from."""

from __future__ import annotations

import json
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.map import Map
from sfmcpp.model import Problem
from sfmcpp.model.arguments import check_fields, checked
from sfmcpp.model.arrays import FloatArray, shaped_array
from sfmcpp.model.checks import is_rotation
from sfmcpp.sources.io.api import format_of, read
from sfmcpp.sources.io.files import failures_named

# Formats without names of images; their .txt is a trajectory's too.
_NAMELESS = ("bal", "sba")
# What `sfmcpp reconstruct` writes into its folder.
_MODEL, _REPORT = "model", "report.json"


@dataclass(frozen=True, eq=False)
class ImagePoses:
    """Poses of images, world_from_camera.

    Parameters
    ----------
    names : tuple of str
        Name of each image, all different.
    poses : (n, 3, 4) float64
        ``[R | c]``: rotation world_from_camera and centre in the world.

    Raises
    ------
    InvalidArgument
        If there are not as many names as poses, a name occurs twice, a number is not finite, or the first
        three columns of a pose are no rotation.
    """

    names: tuple[str, ...]
    poses: FloatArray

    def __post_init__(self) -> None:
        check_fields(self, "names")
        object.__setattr__(self, "poses", shaped_array("poses", self.poses, (len(self.names), 3, 4)))
        if len(set(self.names)) != len(self.names):
            twice = next(name for name in self.names if self.names.count(name) > 1)
            raise InvalidArgument(f"names: {twice!r} occurs twice, must be different")
        good = np.isfinite(self.poses).all(axis=(1, 2)) & is_rotation(self.poses[:, :, :3])
        if not good.all():
            raise InvalidArgument(f"poses[{int(np.argmin(good))}]: no finite pose [R | c] with a rotation R")

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def of(cls, model: ImagePoses | Problem | Map) -> ImagePoses:
        """Poses of the images that a model has registered.

        Parameters
        ----------
        model : ImagePoses, Problem or Map
            A metric problem whose metadata names its images; a map, of which images with a pose count.

        Returns
        -------
        ImagePoses

        Raises
        ------
        InvalidArgument
            If it is projective, or has no names.
        """
        if isinstance(model, ImagePoses):
            return model
        if isinstance(model, Map):
            rows = np.flatnonzero(model.registered)
            return cls(tuple(model.image_names[row] for row in rows), model.poses[rows])
        if not model.is_metric:
            raise InvalidArgument("model: has projection matrices in place of poses, must be metric")
        names = model.metadata.image_names
        if len(names) != model.num_cameras or not names:
            raise InvalidArgument(
                f"model: names {len(names)} of {model.num_cameras} images, must name all and have one: by "
                "names it is matched with the truth"
            )
        return cls(tuple(names), model.cameras)


def is_problem_file(path: Path) -> bool:
    """Whether the name is that of a format whose images can have names, rather than a trajectory's."""
    try:
        return format_of(path).name not in _NAMELESS
    except DatasetError:
        return False


def model_path(path: Path) -> Path:
    """Where the model is: `path` itself, or the folder ``model`` in what ``sfmcpp reconstruct`` wrote."""
    inside = path / _MODEL
    return inside if not _has_model(path) and _has_model(inside) else path


@checked()
def read_image_poses(path: str | PathLike[str]) -> ImagePoses:
    """Read the poses of named images.

    Parameters
    ----------
    path : path-like
        A COLMAP model, a folder that ``sfmcpp reconstruct`` wrote, one of Strecha's ``IMAGE.camera``, or any
        problem file whose images have names.

    Returns
    -------
    ImagePoses

    Raises
    ------
    DatasetError
        If it cannot be read, is no such thing, or its images have no names.
    """
    source = Path(path)
    with failures_named(source):
        found = model_path(source)
        if found.is_dir() and not _has_model(found):
            raise DatasetError(source, _no_model(source))
    try:
        return ImagePoses.of(read(found))
    except InvalidArgument as error:
        raise DatasetError(found, str(error)) from error


def images_asked_for(path: Path) -> list[str] | None:
    """Names of all images that ``sfmcpp reconstruct`` was given, as its report in `path` tells; else None."""
    report = path / _REPORT
    if not report.is_file():
        return None
    with failures_named(report):
        try:
            images = json.loads(report.read_bytes()).get("images")
        except (ValueError, AttributeError):
            return None
    return list(images) if isinstance(images, dict) and images else None


def _has_model(path: Path) -> bool:
    wanted = (f"{stem}.{kind}" for stem in ("cameras", "images") for kind in ("bin", "txt"))
    return any((path / name).exists() for name in wanted) or any(path.glob("*.camera"))


def _no_model(path: Path) -> str:
    trajectory = path / "trajectory.txt"
    hint = f"; evaluate {trajectory} instead" if trajectory.is_file() else ""
    return (
        "is a folder without a model: must hold cameras, images and points3D (.bin or .txt), a folder "
        f"{_MODEL!r} with them, or Strecha's IMAGE.camera{hint}"
    )
