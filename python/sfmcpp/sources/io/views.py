"""Views, poses, intrinsics and points of photo models: the structure that several JSON formats share.

Each has identifiers of its own; a view says which pose and intrinsics are its. Here they become a problem,
and a problem what writers need.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.model.checks import PRINTED_ROTATION_TOLERANCE, is_rotation
from sfmcpp.sources.io.checks import LARGEST_COUNT, first_duplicate, image_names, point_colors
from sfmcpp.sources.io.intrinsics import (
    fixed_but,
    lenses_from_corner,
    model_of_row,
    perspective_columns,
    perspective_rows,
)
from sfmcpp.sources.io.json_text import Part
from sfmcpp.sources.io.rows import by_point, keypoint_ranks

LARGEST_ID = 2**32 - 1
UNREGISTERED = "unregistered_images"


@dataclass(frozen=True, eq=False)
class Lens:
    """Intrinsics: values and names of the free ones, by the names of the perspective model."""

    values: dict[str, float]
    free: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class View:
    """A photo: where the file has it, its name, size [px], and the identifiers of its pose and intrinsics."""

    part: Part
    name: str
    size: tuple[int, int]
    pose: int
    lens: int


@dataclass
class Tracks:
    """Points, their colours where the file has any, and the observations of all of them."""

    points: list[list[float]] = field(default_factory=list)
    colors: list[list[int]] = field(default_factory=list)
    view_ids: list[int] = field(default_factory=list)
    point_index: list[int] = field(default_factory=list)
    pixels: list[list[float]] = field(default_factory=list)
    places: list[Part] = field(default_factory=list)

    def add(self, view_id: int, pixel: list[float], place: Part) -> None:
        """One more observation of the last point."""
        self.view_ids.append(view_id)
        self.point_index.append(len(self.points) - 1)
        self.pixels.append(pixel)
        self.places.append(place)


def identifier(part: Part) -> int:
    """A number that names something."""
    return part.integer(0, LARGEST_ID)


def image_size(part: Part, width: str = "width", height: str = "height") -> tuple[int, int]:
    """Width and height [px] of a part that has both, under these names."""
    return part.part(width).integer(1, LARGEST_COUNT), part.part(height).integer(1, LARGEST_COUNT)


def pose_of(place: Part, world_from_camera: Sequence[float], centre: Sequence[float]) -> FloatArray:
    """``[R | c]`` (3, 4) of nine numbers by rows and a centre; rotations are made orthonormal again."""
    rotation = np.array(world_from_camera).reshape(3, 3)
    if not is_rotation(rotation, PRINTED_ROTATION_TOLERANCE):
        raise place.error("its nine numbers are no rotation matrix")
    return np.concatenate([nearest_rotation(rotation[None])[0], np.array(centre)[:, None]], axis=1)


def add_once(known: dict[int, Any], key: int, value: Any, place: Part) -> None:
    """Remember a value under an identifier that must be new."""
    if key in known:
        raise place.error(f"id {key} is used twice")
    known[key] = value


def problem_of_views(
    views: dict[int, View], poses: dict[int, FloatArray], lenses: dict[int, Lens], tracks: Tracks, source: str
) -> Problem:
    """Make a problem of the views that have a pose and intrinsics; the others are named in the metadata.

    Raises
    ------
    DatasetError
        If views share a pose, which is a rig, or an observation is of a view without a pose, or is there
        twice.
    """
    registered = {key: view for key, view in views.items() if view.pose in poses and view.lens in lenses}
    _require_own_poses(registered)
    rows = {key: row for row, key in enumerate(registered)}
    lens_rows = {key: row for row, key in enumerate(lenses)}
    camera_index = _cameras_of(tracks, rows)
    point_index = np.array(tracks.point_index, dtype=np.int32)
    duplicate = first_duplicate(camera_index, point_index, len(rows))
    if duplicate is not None:
        raise tracks.places[duplicate[1]].error("the view observes this point twice")
    missing = [view.name for key, view in views.items() if key not in registered]
    intrinsics, fixed = _intrinsics(lenses.values())
    return Problem(
        "perspective",
        np.array([poses[view.pose] for view in registered.values()]).reshape(-1, 3, 4),
        intrinsics,
        np.array(tracks.points).reshape(-1, 3),
        camera_index,
        point_index,
        np.array(tracks.pixels).reshape(-1, 2),
        intrinsics_index=np.array([lens_rows[view.lens] for view in registered.values()], dtype=np.int32),
        fixed_intrinsics=fixed,
        metadata=_metadata(registered.values(), tracks, missing, source),
    )


def _intrinsics(lenses: Collection[Lens]) -> tuple[FloatArray, BoolArray]:
    """Perspective intrinsics (G, K), and which of them are fixed."""
    values, fixed = perspective_rows(len(lenses)), fixed_but(len(lenses))
    for row, lens in enumerate(lenses):
        values[row, perspective_columns(*lens.values)] = list(lens.values.values())
        fixed[row, perspective_columns(*lens.free)] = False
    return values, fixed


def _metadata(views: Collection[View], tracks: Tracks, unregistered: list[str], source: str) -> Metadata:
    return Metadata(
        source,
        image_names=[view.name for view in views],
        image_sizes=np.array([view.size for view in views], dtype=np.int64) if views else None,
        point_colors=np.array(tracks.colors, dtype=np.uint8) if tracks.colors else None,
        extra={UNREGISTERED: unregistered} if unregistered else {},
    )


def _require_own_poses(views: dict[int, View]) -> None:
    used: dict[int, int] = {}
    for key, view in views.items():
        other = used.setdefault(view.pose, key)
        if other != key:
            raise view.part.error(
                f"views {other} and {key} share pose {view.pose}: rigs are not supported yet"
            )


def _cameras_of(tracks: Tracks, rows: dict[int, int]) -> IndexArray:
    try:
        return np.array([rows[key] for key in tracks.view_ids], dtype=np.int32)
    except KeyError:
        bad = next(i for i, key in enumerate(tracks.view_ids) if key not in rows)
        reason = f"is of view {tracks.view_ids[bad]}, which has no pose and intrinsics"
        raise tracks.places[bad].error(reason) from None


@dataclass(frozen=True, eq=False)
class WrittenLens:
    """A row of intrinsics for a file.

    Attributes
    ----------
    model : str
        Name of the camera model.
    size : tuple of int
        Width and height of its images [px].
    values : dict of str to float
        All perspective intrinsics by name, for pixels that count from the corner of the image.
    is_fixed : bool
        Whether none of them is free.
    """

    model: str
    size: tuple[int, int]
    values: dict[str, float]
    is_fixed: bool

    @property
    def named_size(self) -> dict[str, float]:
        """Width and height by name."""
        return dict(zip(("width", "height"), self.size, strict=True))


@dataclass(frozen=True, eq=False)
class WrittenPoint:
    """A point for a file: position, colour, and the image, number in it and pixel of each observation."""

    position: list[float]
    color: list[int]
    observations: list[tuple[int, int, list[float]]]


class WrittenViews:
    """Contents of files of views for a problem, each numbered by its row.

    Parameters
    ----------
    problem : Problem
        A valid one.
    models : mapping
        Names of camera models, the smallest first, and the perspective parameters that each can hold.
    path : Path
        What is written.

    Raises
    ------
    DatasetError
        If metadata do not fit, or no camera model holds a row of intrinsics.
    """

    def __init__(self, problem: Problem, models: Mapping[str, Collection[str]], path: Path) -> None:
        self._problem, corner = problem, lenses_from_corner(problem, path)
        rows = zip(corner.values, corner.fixed, corner.sizes.tolist(), strict=True)
        self.lenses = [
            WrittenLens(
                model_of_row(row, models, values, fixed, path),
                tuple(size),
                dict(zip(PERSPECTIVE, values.tolist(), strict=True)),
                bool(fixed.all()),
            )
            for row, (values, fixed, size) in enumerate(rows)
        ]
        self.names = image_names(problem, path)
        self.lens_rows: list[int] = problem.intrinsics_index.tolist()
        self._colors = point_colors(problem, (0, 0, 0), path)
        self._origin = corner.origin[problem.intrinsics_index]

    def points(self) -> Iterator[WrittenPoint]:
        """All points, with their observations in the order of the problem."""
        problem, (order, counts) = self._problem, by_point(self._problem)
        cameras = problem.camera_index[order]
        numbers = keypoint_ranks(problem)[order]
        pixels = problem.pixels[order] + self._origin[cameras]
        ends = np.concatenate([[0], np.cumsum(counts)]).tolist()
        for position, color, (begin, end) in zip(problem.points, self._colors, pairwise(ends), strict=True):
            seen = slice(begin, end)
            rows = (cameras[seen].tolist(), numbers[seen].tolist(), pixels[seen].tolist())
            yield WrittenPoint(position.tolist(), color.tolist(), list(zip(*rows, strict=True)))
