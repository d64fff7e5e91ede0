"""A problem cut by its points: each part has all cameras and, with its points, all their observations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba.arrays import core_arrays
from sfmcpp.ba.checkpoints import digest
from sfmcpp.ba.ranks import Ranks
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import IndexArray


def partition_points(problem: Problem, count: int) -> IndexArray:
    """Cut a problem into parts that take the same work and see few cameras each.

    Points follow one another as a search through the graph of who sees what meets them (reverse
    Cuthill–McKee), which keeps those of the same cameras together. The work of a point with k images in
    the Schur complement is k².

    Parameters
    ----------
    problem : Problem
        Its indices must be in range.
    count : int
        Number of parts.

    Returns
    -------
    (N,) int32
        Part of each point.
    """
    order = _along_the_graph(problem)
    images = np.bincount(problem.point_index, minlength=problem.num_points)
    work = np.cumsum(images[order].astype(np.float64) ** 2 + 1.0)  # a point without images is work, too
    parts = np.empty(problem.num_points, np.int32)
    parts[order] = np.searchsorted(work[-1] * np.arange(1, count) / count, work) if len(work) else 0
    return parts


def _along_the_graph(problem: Problem) -> NDArray[np.int64]:
    from scipy.sparse import coo_array, csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    cameras, size = problem.num_cameras, problem.num_cameras + problem.num_points
    seen = np.ones(problem.num_observations, np.int8)
    half = coo_array((seen, (problem.camera_index, cameras + problem.point_index)), (size, size))
    order = reverse_cuthill_mckee(csr_array(half + half.T), symmetric_mode=True)
    return order[order >= cameras].astype(np.int64) - cameras


def part_of(problem: Problem, points: NDArray[np.int64]) -> Problem:
    """Take some points with their observations, and all cameras.

    Parameters
    ----------
    problem : Problem
        The whole.
    points : (n,) int
        Which points, in ascending order.

    Returns
    -------
    Problem
        Arrays of cameras and intrinsics are copies, metadata is left out.
    """
    number = np.full(problem.num_points, -1, np.int32)
    number[points] = np.arange(len(points), dtype=np.int32)
    chosen = problem.with_observations(number[problem.point_index] >= 0)
    return replace(
        chosen,
        cameras=problem.cameras.copy(),
        intrinsics=problem.intrinsics.copy(),
        points=problem.points[points],
        fixed_points=problem.fixed_points[points],
        point_index=number[chosen.point_index],
        metadata=Metadata(),
    )


class Scattered:
    """A whole problem of rank 0, of which each rank has a part.

    Parameters
    ----------
    problem : Problem or None
        The whole on rank 0; elsewhere nothing.
    ranks : Ranks
        Who has the parts.

    Attributes
    ----------
    mine : Problem
        The part of this rank.
    """

    def __init__(self, problem: Problem | None, ranks: Ranks) -> None:
        self._whole, self._ranks = problem, ranks
        self._points: list[NDArray[np.int64]] = []
        if problem is not None:
            parts = partition_points(problem, ranks.size)
            self._points = [np.flatnonzero(parts == rank) for rank in range(ranks.size)]
        self.mine: Problem = ranks.dealt(self._part)

    def _part(self, rank: int) -> Problem:
        assert self._whole is not None
        return part_of(self._whole, self._points[rank])

    def collect(self) -> None:
        """Write what the parts have become into the whole."""
        collected = self._ranks.collected(self.mine.points)
        if self._whole is None:
            return
        self._whole.cameras[:] = self.mine.cameras
        self._whole.intrinsics[:] = self.mine.intrinsics
        for points, places in zip(self._points, collected, strict=True):
            self._whole.points[points] = places


class OwnParts:
    """Parts that the ranks have brought themselves, alike in what all must have.

    Parameters
    ----------
    problem : Problem
        The part of this rank.
    ranks : Ranks
        Who has the others.

    Raises
    ------
    InvalidArgument
        If one is no problem, or cameras or intrinsics differ between ranks.
    """

    def __init__(self, problem: Problem, ranks: Ranks) -> None:
        self.mine = problem
        arrays = ranks.agreed(lambda: core_arrays(problem))
        require_alike(ranks, {name: arrays[name] for name in _REPLICATED})

    def collect(self) -> None:
        """Each rank keeps its part."""


_REPLICATED = (
    "camera_model",
    "cameras",
    "intrinsics",
    "intrinsics_index",
    "fixed_cameras",
    "fixed_intrinsics",
)


def require_alike(ranks: Ranks, values: dict[str, Any]) -> None:
    """Raise InvalidArgument, on all ranks, for what is not the same on all of them."""
    mine = {name: digest(value) for name, value in values.items()}
    for rank, theirs in enumerate(digests := ranks.everyones(mine)):
        for name in digests[0] | theirs:
            if theirs.get(name) != digests[0].get(name):
                raise InvalidArgument(f"{name}: differs between ranks 0 and {rank}, must be the same on all")


def is_whole_on_root(problem: Problem | None, ranks: Ranks) -> bool:
    """Tell whether rank 0 has the whole problem and the others nothing; else each has its part.

    Raises
    ------
    InvalidArgument
        If it is neither.
    """
    given = ranks.everyones(problem is not None)
    if all(given):
        return False
    if not given[0] or any(given[1:]):
        raise InvalidArgument(
            f"problem = None on rank {given.index(False)}: either rank 0 has the whole problem and all "
            "others None, or each has its part"
        )
    return True
