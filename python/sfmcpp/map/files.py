"""Conversion between maps and problems: maps are read from and written to every format."""

from __future__ import annotations

import os

import numpy as np

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.map.map import Map
from sfmcpp.map.tracks import NONE
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray, typed_array
from sfmcpp.model.camera_models import require_pinhole
from sfmcpp.model.metadata import WorldOrigin, keypoint_entries, require_entries
from sfmcpp.model.selection import remade
from sfmcpp.sources.io import read, write
from sfmcpp.sources.io.rows import all_keypoints, exclusive_sums

_NO_RIGS = "has rigs: the images of a map move by themselves"


@checked()
def map_of_problem(problem: Problem) -> Map:
    """Make the map of a problem: its cameras become images, its rows of intrinsics cameras.

    Masks of cameras and points have no place in a map.

    Parameters
    ----------
    problem : Problem
        Of a metric camera model; it is not changed. Names, sizes, colours, identifiers, keypoints without a
        point and the origin of the world are taken from its metadata.

    Returns
    -------
    Map

    Raises
    ------
    InvalidArgument
        If it is a projective problem or one with rigs, or metadata do not fit it.
    """
    problem = remade(problem)
    if problem.rigs is not None:
        raise InvalidArgument(f"problem: {_NO_RIGS}")
    metadata, extra = problem.metadata, problem.metadata.extra
    require_entries(extra)
    result = Map(require_pinhole(problem.camera_model))
    result.origin = WorldOrigin.of(metadata)
    sizes = np.zeros((len(problem.intrinsics), 2), dtype=np.int64)
    if metadata.image_sizes is not None:
        of_images = typed_array(
            "metadata image_sizes", metadata.image_sizes, np.int64, (problem.num_cameras, 2)
        )
        sizes[problem.intrinsics_index] = of_images
    result.add_cameras(
        problem.intrinsics,
        fixed=problem.fixed_intrinsics,
        sizes=extra.get("colmap_camera_sizes", sizes),
        ids=extra.get("colmap_camera_ids"),
        names=extra.get("colmap_camera_models"),
    )
    result.add_points(problem.points, colors=metadata.point_colors, ids=extra.get("colmap_point_ids"))
    counts, keypoints, rows = all_keypoints(problem)
    result.add_images(
        metadata.names(problem.num_cameras),
        problem.intrinsics_index,
        counts,
        keypoints,
        poses=problem.cameras,
        ids=extra.get("colmap_image_ids"),
    )
    # In the order of the problem: a track keeps its order.
    result.observe(rows, problem.point_index)
    result.keypoint_covariances[rows] = _covariances(problem)
    result.update_errors()
    return result


def _covariances(problem: Problem) -> FloatArray:
    """(M, 3) Σ_uu, Σ_uv, Σ_vv of the observations; not a number where unknown."""
    if problem.covariance_px2 is not None:
        return problem.covariance_px2.reshape(-1, 4)[:, [0, 1, 3]]
    sigma = np.full(problem.num_observations, np.nan) if problem.sigma_px is None else problem.sigma_px
    return np.asarray(sigma[:, None] ** 2 * [1.0, 0.0, 1.0])


@checked()
def problem_of_map(world: Map) -> Problem:
    """Make the problem of a map for a file: with all that its metadata can hold, and nothing fixed.

    Parameters
    ----------
    world : Map
        It is not changed.

    Returns
    -------
    Problem
        Its cameras are the images with a pose, its points those with a position, also those that nothing
        sees; its intrinsics are all cameras.
    """
    local = world.whole_problem(min_views=0)
    problem, images = local.problem, local.images
    place = np.full(len(world.keypoints), NONE)
    place[local.rows] = np.arange(len(local.rows))
    tracks = place[world.observations_of(local.points)]
    tracks = tracks[tracks >= 0]
    rows = world.keypoints_of(images)
    counts = world.keypoint_counts[images]
    image = np.repeat(np.arange(len(images)), counts)
    rank = np.arange(len(rows)) - exclusive_sums(counts)[image]
    loose = place[rows] == NONE
    rank_of_row = np.empty(len(world.keypoints), dtype=np.int64)
    rank_of_row[rows] = rank
    problem.metadata.extra = {
        "colmap_camera_ids": world.camera_ids.copy(),
        "colmap_camera_models": list(world.camera_names),
        "colmap_image_ids": world.image_ids[images],
        "colmap_point_ids": world.point_ids[local.points],
        **keypoint_entries(
            rank_of_row[local.rows[tracks]], image[loose], rank[loose], world.keypoints[rows[loose]]
        ),
    }
    if world.camera_sizes.all():
        problem.metadata.extra["colmap_camera_sizes"] = world.camera_sizes.copy()
    if world.origin is not None:
        world.origin.put_into(problem.metadata)
    uncertainty = problem.uncertainty.of_some(tracks)
    return Problem(
        world.camera_model,
        problem.cameras,
        world.intrinsics.copy(),
        problem.points,
        problem.camera_index[tracks],
        problem.point_index[tracks],
        problem.pixels[tracks],
        sigma_px=uncertainty.sigma_px,
        covariance_px2=uncertainty.covariance_px2,
        intrinsics_index=world.image_cameras[images],
        fixed_intrinsics=world.fixed_intrinsics.copy(),
        metadata=problem.metadata,
    )


@checked()
def read_map(path: str | os.PathLike[str], format: str | None = None) -> Map:
    """Read a map, as :func:`sfmcpp.read` reads a problem.

    Parameters
    ----------
    path : path
        A file, or the folder of a COLMAP model.
    format : str, optional
        Name of the format. Default: as the path tells.

    Returns
    -------
    Map

    Raises
    ------
    DatasetError
        If it cannot be read, or has rigs of several cameras.
    """
    problem = read(path, format=format)
    if problem.rigs is not None:
        raise DatasetError(path, _NO_RIGS)
    return map_of_problem(problem)


@checked()
def write_map(world: Map, path: str | os.PathLike[str], format: str | None = None) -> None:
    """Write a map, as :func:`sfmcpp.write` writes a problem: images with a pose, points with a position.

    Parameters
    ----------
    world : Map
        It is not changed.
    path : path
        A file, or the folder of a COLMAP model.
    format : str, optional
        Name of the format. Default: as the path tells.

    Raises
    ------
    DatasetError
        If the format cannot hold it, or it cannot be written.
    """
    write(problem_of_map(world), path, format=format)
