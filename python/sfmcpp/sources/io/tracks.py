"""Observations grouped: by point as files list them, or numbered within their image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import Problem
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


def tokens_of_items(first: NDArray[np.int64], counts: NDArray[np.int64], width: int) -> NDArray[np.int64]:
    """First number of each item, where list i starts at number ``first[i]`` and has ``counts[i]`` items."""
    within = np.arange(int(counts.sum())) - np.repeat(exclusive_sums(counts), counts)
    return np.asarray(np.repeat(first, counts) + width * within)
