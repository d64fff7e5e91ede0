"""Observations grouped: by point as files list them, or numbered within their image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.rows import exclusive_sums


def by_point(problem: Problem) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Order (M,) that groups the observations by point, otherwise unchanged, and how many each point has."""
    order = np.argsort(problem.point_index, kind="stable")
    return order, np.bincount(problem.point_index, minlength=problem.num_points)


def keypoint_ranks(problem: Problem) -> NDArray[np.int64]:
    """Give each observation its number (M,) among those of its camera, from 0."""
    order = np.argsort(problem.camera_index, kind="stable")
    counts = np.bincount(problem.camera_index, minlength=problem.num_cameras)
    ranks = np.empty(problem.num_observations, dtype=np.int64)
    ranks[order] = np.arange(len(order)) - np.repeat(exclusive_sums(counts), counts)
    return ranks


def all_keypoints(problem: Problem) -> tuple[NDArray[np.int64], FloatArray, NDArray[np.int64]]:
    """Keypoints of all images, image after image, those that see no point among them.

    Parameters
    ----------
    problem : Problem
        Its metadata may number the keypoints of each image, and hold those without a point.

    Returns
    -------
    counts : (C,) int64
        How many each image has.
    pixels : (K, 2) float64
        Where they are [px].
    rows : (M,) int64
        The keypoint of each observation.

    Raises
    ------
    InvalidArgument
        If the metadata do not fit the problem.
    """
    extra = problem.metadata.extra
    loose = np.asarray(extra.get("colmap_loose_image", np.empty(0, np.int64)))
    ranks = np.asarray(extra.get("colmap_keypoint_index", keypoint_ranks(problem)))
    if len(ranks) != problem.num_observations:
        raise InvalidArgument(
            f"metadata colmap_keypoint_index has {len(ranks)} entries: must be {problem.num_observations}"
        )
    image = np.concatenate([problem.camera_index, loose])
    index = np.concatenate([ranks, extra.get("colmap_loose_keypoint_index", np.empty(0, np.int64))])
    counts = np.bincount(image, minlength=problem.num_cameras)
    place = exclusive_sums(counts)[image] + index
    if ((index < 0) | (index >= counts[image])).any() or len(np.unique(place)) != len(place):
        raise InvalidArgument("metadata colmap_keypoint_index does not number each image's keypoints once")
    pixels = np.empty((len(place), 2))
    pixels[place] = np.concatenate([problem.pixels, extra.get("colmap_loose_pixels", np.empty((0, 2)))])
    return counts, pixels, place[: problem.num_observations]


def tokens_of_items(first: NDArray[np.int64], counts: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """First number of each item, where list i starts at number ``first[i]`` and has ``counts[i]`` items."""
    within = np.arange(int(counts.sum())) - np.repeat(exclusive_sums(counts), counts)
    return np.asarray(np.repeat(first, counts) + width * within)
