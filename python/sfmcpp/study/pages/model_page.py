"""A page of a model in three dimensions: points, cameras, and photos on a click."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba import residuals_px
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arrays import ANY, FloatArray, finite_array
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sources.io.checks import image_names, point_colors, require_valid
from sfmcpp.sources.io.intrinsics import lenses_from_corner, perspective_columns
from sfmcpp.study.pages.parts import data_uri, filled_page, packed, save_page
from sfmcpp.study.pages.viewpoint import bounding_sphere, camera_size, turn_upright

_TEMPLATE = "model_page.html"
# A page with more would take long to open.
MOST_POINTS = 1_000_000
# Where nothing is known of the colour.
_PALE = (190, 205, 215)
_BLACK = (0, 0, 0)  # the page shows points without any colour in a pale one


@dataclass(frozen=True, eq=False)
class ModelScene:
    """Contents of the page.

    Attributes
    ----------
    title : str
        Heading of the page.
    points : (N, 3) float64
        Points of the model.
    colors : (N, 3) uint8
        Red, green, blue of each point.
    cameras : (K, 3, 4) float64
        ``[R | c]``, world_from_camera.
    corners : (K, 4) float64
        Left, top, right and bottom of each image at distance 1 from the centre of its camera.
    names : sequence of str
        Name of each camera.
    notes : sequence of str
        What else is said of each camera.
    thumbnails : sequence of bytes or None
        Small picture of each camera as JPEG.
    facts : mapping of str to str
        Names and values for the panel.
    unit : str
        Of lengths; empty for a model of unknown scale.
    east_north_up : bool
        Whether the axes of the world are these; otherwise up is told by the cameras.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or the cameras differ in number.
    """

    title: str
    points: FloatArray
    colors: NDArray[np.uint8]
    cameras: FloatArray
    corners: FloatArray
    names: Sequence[str]
    notes: Sequence[str]
    thumbnails: Sequence[bytes | None]
    facts: Mapping[str, str] = field(default_factory=dict)
    unit: str = ""
    east_north_up: bool = False

    def __post_init__(self) -> None:
        shapes = {"points": (ANY, 3), "cameras": (ANY, 3, 4), "corners": (ANY, 4)}
        for name, shape in shapes.items():
            object.__setattr__(self, name, finite_array(name, getattr(self, name), shape))
        count = len(self.cameras)
        for name in ("corners", "names", "notes", "thumbnails"):
            if len(getattr(self, name)) != count:
                given = len(getattr(self, name))
                raise InvalidArgument(f"{name}: {given} entries, must be {count}, one for each camera")
        if np.shape(self.colors) != self.points.shape:
            raise InvalidArgument(f"colors: shape {np.shape(self.colors)}, must be {self.points.shape}")


def model_page(scene: ModelScene) -> str:
    """Make the page: one HTML text with everything in it; the same scene gives the same text.

    Parameters
    ----------
    scene : ModelScene
        What to show; of more than a million points, some.

    Returns
    -------
    str
        HTML with its style, script, pictures and data.
    """
    return filled_page(_TEMPLATE, scene.title, _data(scene))


def save_model_page(scene: ModelScene, path: str | PathLike[str]) -> None:
    """Write the page; the file appears complete or not at all.

    Parameters
    ----------
    scene : ModelScene
        What to show.
    path : path-like
        Where to.

    Raises
    ------
    DatasetError
        If the file cannot be written.
    """
    save_page(model_page(scene), path)


def corners_at_distance_one(
    f: FloatArray, aspect: FloatArray, cx: FloatArray, cy: FloatArray, width: FloatArray, height: FloatArray
) -> FloatArray:
    """(n, 4) left, top, right and bottom of n images, at distance 1 from cameras without distortion."""
    sides = np.stack([-cx, -cy / aspect, width - cx, (height - cy) / aspect], axis=1)
    return np.asarray(sides / f[:, None])


def _data(scene: ModelScene) -> dict[str, Any]:
    turn = np.eye(3) if scene.east_north_up else turn_upright(scene.cameras)
    points, centres = scene.points @ turn.T, scene.cameras[:, :, 3] @ turn.T
    origin, radius = bounding_sphere(points, centres)
    stride = max(1, -(-len(points) // MOST_POINTS))
    axes = turn @ scene.cameras[:, :, :3]
    poses = np.concatenate([axes, (centres - origin)[:, :, None]], axis=2)
    colors = scene.colors if scene.colors.any() else np.full_like(scene.colors, _PALE)
    return {
        "points": packed(points[::stride] - origin),
        "colors": packed(colors[::stride], "u1"),
        "cameras": packed(poses),
        "corners": packed(scene.corners),
        "names": list(scene.names),
        "notes": list(scene.notes),
        "thumbnails": [data_uri("image/jpeg", jpeg) if jpeg else "" for jpeg in scene.thumbnails],
        "radius": radius,
        "cameraSize": camera_size(centres, radius),
        "unit": scene.unit,
        "north": [0.0, 1.0, 0.0] if scene.east_north_up else None,
        "facts": list(scene.facts.items()),
        "omitted": stride,
    }


def write_problem_page(problem: Problem, path: Path, title: str) -> None:
    """Write a page of a problem in three dimensions: points that are seen, cameras and their mean errors.

    Parameters
    ----------
    problem : Problem
        Its images are as large as its metadata say, or else as its observations ask for. Metres and north
        are shown where positions have told its world.
    path : Path
        Where to.
    title : str
        Heading of the page.

    Raises
    ------
    DatasetError
        If the cameras are projective, metadata do not fit the problem, or the file cannot be written.
    """
    save_model_page(_scene(problem, path, title), path)


def require_world(problem: Problem, path: Path) -> None:
    """Raise a DatasetError if a problem has projective cameras, whose world is no place to show."""
    if not problem.is_metric:
        raise DatasetError(path, f"{problem.camera_model} cameras have no world to show")


def _scene(problem: Problem, path: Path, title: str) -> ModelScene:
    require_world(problem, path)
    require_valid(problem, path)
    errors = np.linalg.norm(residuals_px(problem), axis=1)
    seen = np.bincount(problem.point_index, minlength=problem.num_points) > 0
    origin = WorldOrigin.of(problem.metadata)
    facts = {
        "cameras": f"{problem.num_cameras:,}",
        "points": f"{np.count_nonzero(seen):,}",
        "mean error": f"{errors.mean():.3g} px" if len(errors) else "no observations",
    }
    return ModelScene(
        title,
        problem.points[seen],
        point_colors(problem, _BLACK, path)[seen],
        problem.cameras,
        _corners(problem, path),
        image_names(problem, path),
        _notes(problem, errors),
        [None] * problem.num_cameras,
        facts,
        "" if origin is None else "m",
        origin is not None and origin.geodetic,
    )


def _corners(problem: Problem, path: Path) -> FloatArray:
    """(C, 4) left, top, right and bottom of images at distance 1 from their cameras, without distortion."""
    lenses = lenses_from_corner(problem, path)
    f, aspect, cx, cy = lenses.values[:, perspective_columns("f", "aspect", "cx", "cy")].T
    width, height = np.asarray(lenses.sizes, dtype=np.float64).T
    return corners_at_distance_one(f, aspect, cx, cy, width, height)[problem.intrinsics_index]


def _notes(problem: Problem, errors: FloatArray) -> list[str]:
    counts = np.bincount(problem.camera_index, minlength=problem.num_cameras)
    sums = np.bincount(problem.camera_index, errors, minlength=problem.num_cameras)
    return [
        f"{count:,} observations" + (f", mean error {total / count:.3g} px" if count else "")
        for count, total in zip(counts.tolist(), sums.tolist(), strict=True)
    ]
