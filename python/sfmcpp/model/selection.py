"""Subsets and extensions of a problem: the implementations of its methods ``with_…``.

Each result is independent of the problem that it is made of, as a solve changes arrays in place; and has its
metadata, which go with the cameras, intrinsics, points and observations that they describe.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import (
    BoolArray,
    chosen_rows,
    each_once,
    for_each,
    index_array,
    new_numbers,
    number_array,
    numbers_below,
    typed_array,
)
from sfmcpp.model.metadata import Metadata
from sfmcpp.model.rigs import Rigs

if TYPE_CHECKING:
    from sfmcpp.model.problem import Problem


def remade(problem: Problem) -> Problem:
    """The problem made anew of its fields, which may have been assigned to since it was made.

    Returns
    -------
    Problem
        With the same arrays where these have the shapes and dtypes of those of a new problem.

    Raises
    ------
    InvalidArgument
        As by :class:`Problem`.
    """
    rigs = problem.rigs
    return replace(problem, rigs=replace(rigs) if isinstance(rigs, Rigs) else rigs)


def changed(problem: Problem, **values: Any) -> Problem:
    """A copy of a problem with other values of some of its fields; it shares no array with it."""
    kept = {f.name: getattr(problem, f.name) for f in fields(problem) if f.name not in values}
    copies: dict[str, Any] = {
        name: value.copy() for name, value in kept.items() if isinstance(value, np.ndarray | Rigs | Metadata)
    }
    return replace(problem, **copies | values)


def of_observations(problem: Problem, chosen: ArrayLike) -> Problem:
    """Some of its observations."""
    problem = remade(problem)
    rows = chosen_rows(chosen, problem.num_observations)
    uncertainty = problem.uncertainty.of_some(rows)
    return changed(
        problem,
        camera_index=problem.camera_index[rows],
        point_index=problem.point_index[rows],
        pixels=problem.pixels[rows],
        sigma_px=uncertainty.sigma_px,
        covariance_px2=uncertainty.covariance_px2,
        metadata=problem.metadata.copy().of_observations(rows, problem.camera_index, problem.pixels),
    )


def of_points(problem: Problem, chosen: ArrayLike) -> Problem:
    """Some of its points, with their observations."""
    problem = remade(problem)
    points = each_once(chosen, problem.num_points, "point")
    number = new_numbers(points, problem.num_points)
    seen = numbers_below("point_index", problem.point_index, problem.num_points)
    kept = of_observations(problem, number[seen] >= 0)
    return replace(
        kept,
        points=kept.points[points],
        fixed_points=kept.fixed_points[points],
        point_index=number[kept.point_index],
        metadata=kept.metadata.of_points(points, problem.num_points),
    )


def _numbers_of_names(problem: Problem, chosen: ArrayLike) -> ArrayLike:
    """Numbers of the cameras that are given by the names of their images; anything else as it is."""
    wanted = number_array("chosen", chosen)
    if wanted.dtype.kind != "U":
        return chosen
    names = problem.metadata.image_names
    number = {name: k for k, name in enumerate(names)}
    for name in wanted.ravel().tolist():
        if name not in number:
            raise InvalidArgument(f"chosen: no image is called {name!r}")
        if len(number) < len(names) and names.count(name) > 1:
            raise InvalidArgument(f"chosen: {names.count(name)} images are called {name!r}")
    return np.array([number[name] for name in wanted.ravel().tolist()], dtype=np.int64)


def of_cameras(problem: Problem, chosen: ArrayLike) -> Problem:
    """Some of its cameras, with their observations, and the intrinsics and sensors that these use."""
    problem = remade(problem)
    cameras = each_once(_numbers_of_names(problem, chosen), problem.num_cameras, "camera")
    number = new_numbers(cameras, problem.num_cameras)
    seen = numbers_below("camera_index", problem.camera_index, problem.num_cameras)
    kept = of_observations(problem, number[seen] >= 0)
    metadata, rigs = kept.metadata.of_cameras(cameras, problem.num_cameras), kept.rigs
    if rigs is not None:
        count = rigs.num_sensors
        rigs, frames, sensors = rigs.of_cameras(cameras)
        metadata = metadata.of_rigs(frames, sensors, count)
    rows, index = np.unique(problem.intrinsics_index[cameras].astype(np.int64), return_inverse=True)
    return replace(
        kept,
        cameras=kept.cameras[cameras],
        fixed_cameras=kept.fixed_cameras[cameras],
        camera_index=number[kept.camera_index],
        rigs=rigs,
        intrinsics=kept.intrinsics[rows],
        fixed_intrinsics=kept.fixed_intrinsics[rows],
        intrinsics_index=index.astype(np.int32),
        metadata=metadata.of_intrinsics(rows, new_numbers(rows, len(problem.intrinsics))),
    )


def with_shared_intrinsics(problem: Problem, groups: ArrayLike | None) -> Problem:
    """One row of intrinsics for the cameras of each group."""
    problem = remade(problem)
    count = problem.num_cameras
    labels = np.zeros(count, np.int32) if groups is None else index_array("groups", groups)
    if len(labels) != count:
        raise InvalidArgument(f"groups: {len(labels)} numbers, must be one for each of {count} cameras")
    _, first, index = np.unique(labels, return_index=True, return_inverse=True)
    _require_one_size(problem, first[index])
    rows = problem.intrinsics_index[first].astype(np.int64)
    number = np.full(len(problem.intrinsics), -1, dtype=np.int32)
    number[problem.intrinsics_index] = index
    return changed(
        problem,
        intrinsics=problem.intrinsics[rows],
        fixed_intrinsics=problem.fixed_intrinsics[rows],
        intrinsics_index=index.astype(np.int32),
        metadata=problem.metadata.copy().of_intrinsics(rows, number),
    )


def _require_one_size(problem: Problem, first: NDArray[Any]) -> None:
    """Raise InvalidArgument where the image of a camera is known to be of another size than `first` (C,)."""
    sizes = problem.metadata.image_sizes
    if sizes is None:
        sizes = np.asarray(problem.metadata.extra.get("colmap_camera_sizes", ()))
        sizes = sizes[problem.intrinsics_index] if len(sizes) == len(problem.intrinsics) else None
    if sizes is None or len(sizes) != problem.num_cameras:
        return
    for camera in np.flatnonzero((sizes != sizes[first]).any(axis=1)):
        one, other = ("{}×{}".format(*sizes[k]) for k in (first[camera], camera))
        raise InvalidArgument(
            f"groups: cameras {first[camera]} and {camera} have images of {one} and {other} px: "
            "intrinsics in pixels are of one size of image"
        )


def with_added_points(
    problem: Problem,
    points: ArrayLike,
    camera_index: ArrayLike,
    point_index: ArrayLike,
    pixels: ArrayLike,
    sigma_px: ArrayLike | None,
) -> Problem:
    """More points, behind its own, with their observations."""
    problem = remade(problem)
    more = typed_array("points", points, np.float64, (-1, problem.points.shape[1]))
    cameras = numbers_below("camera_index", camera_index, problem.num_cameras).astype(np.int32)
    count = len(cameras)
    places = numbers_below("point_index", point_index, len(more)).astype(np.int32)
    if len(places) != count:
        raise InvalidArgument(f"point_index: shape {places.shape}, must be ({count},)")
    seen = typed_array("pixels", pixels, np.float64, (count, 2))
    uncertainty = problem.uncertainty
    if sigma_px is not None or problem.sigma_px is not None or problem.covariance_px2 is not None:
        sigmas = for_each("sigma_px", 1.0 if sigma_px is None else sigma_px, count)
        uncertainty = uncertainty.followed_by(sigmas, problem.num_observations)
    return changed(
        problem,
        points=np.concatenate([problem.points, more]),
        fixed_points=np.concatenate([problem.fixed_points, np.zeros(len(more), np.bool_)]),
        camera_index=np.concatenate([problem.camera_index, cameras]),
        point_index=np.concatenate([problem.point_index, problem.num_points + places]),
        pixels=np.concatenate([problem.pixels, seen]),
        sigma_px=uncertainty.sigma_px,
        covariance_px2=uncertainty.covariance_px2,
        metadata=problem.metadata.copy().with_added_points(len(more), problem.camera_index, cameras),
    )


def observing_cameras(problem: Problem) -> BoolArray:
    """(C,) which cameras observe a point."""
    return np.asarray(np.bincount(problem.camera_index, minlength=problem.num_cameras) > 0)
