"""Reading of one file by several ranks: each reads some rows and receives those of its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba.partition import Tracks, camera_links, camera_places
from sfmcpp.ba.parts import (
    NUMBER,
    Part,
    Rows,
    cameras_alone,
    joined_rows,
    part_from_rows,
    rows_of_observations,
    rows_of_points,
)
from sfmcpp.ba.ranks import Ranks
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray

# So many are on their way: what is pickled and sent is in memory some times over.
_ROWS_AT_ONCE = 1 << 16


@dataclass(frozen=True)
class Share:
    """Share of a file that one rank has read: all cameras, and consecutive rows.

    Attributes
    ----------
    cameras : Problem
        All cameras, without points.
    num_points : int
        Of the whole.
    points, observations : dict of str to array
        Rows with their numbers in the whole; they are used up as they are sent.
    """

    cameras: Problem
    num_points: int
    points: Rows
    observations: Rows

    @classmethod
    def of(cls, read: Problem, num_points: int, first_point: int, first_observation: int) -> Share:
        """Take what a rank has read, rows from these on; its `point_index` counts the points of the whole."""
        points = rows_of_points(read, first_point + np.arange(read.num_points))
        observations = rows_of_observations(read, first_observation + np.arange(read.num_observations))
        return cls(cameras_alone(read), num_points, points, observations)

    @property
    def is_in_range(self) -> bool:
        """Whether cameras and points of all observations exist."""
        sizes = {"camera_index": self.cameras.num_cameras, "point_index": self.num_points}
        columns = [(self.observations[name], size) for name, size in sizes.items()]
        return all(not len(index) or (index.min() >= 0 and index.max() < size) for index, size in columns)


def part_of_share(share: Share, ranks: Ranks) -> Part:
    """Give each rank its part of what all have read: the part that `partition_points` would give it.

    Rows go first to the rank whose range of numbers their point is in, which then knows all of who observes
    it; and from there to the one whose part it is. No rank ever has those of all.

    Parameters
    ----------
    share : Share
        Of this rank; its indices must be in range.
    ranks : Ranks
        Who has read the others.

    Returns
    -------
    Part
        That of this rank.
    """
    starts = share.num_points * np.arange(ranks.size + 1) // ranks.size
    home, first = starts[1:-1], int(starts[ranks.rank])
    points = _exchanged_rows(share.points, _index_in_ranges(home, share.points[NUMBER]), ranks)
    observations = _exchanged_rows(
        share.observations, _index_in_ranges(home, share.observations["point_index"]), ranks
    )
    owner = _owners(share, observations, first, int(starts[ranks.rank + 1]) - first, ranks)
    observations = _exchanged_rows(observations, owner[observations["point_index"] - first], ranks)
    points = _exchanged_rows(points, owner[points[NUMBER] - first], ranks)
    return part_from_rows(share.cameras, points, observations)


def _index_in_ranges(starts: NDArray[np.int64], numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.searchsorted(starts, numbers, side="right")


def _exchanged_rows(rows: Rows, destination: NDArray[np.integer], ranks: Ranks) -> Rows:
    """Exchange rows: each rank receives those that the others have for it; those sent are freed."""
    received: list[Rows] = []
    for begin in range(0, max(ranks.everyones(len(destination))), _ROWS_AT_ONCE):
        own = destination[begin : begin + _ROWS_AT_ONCE]
        of_ranks = [begin + np.flatnonzero(own == rank) for rank in range(ranks.size)]
        pieces = [{name: array[chosen] for name, array in rows.items()} for chosen in of_ranks]
        received += ranks.exchanged(pieces)
    rows.clear()
    return joined_rows(received)


def _owners(share: Share, observations: Rows, first: int, count: int, ranks: Ranks) -> NDArray[np.int32]:
    """Rank of each of the points whose range this is."""

    def summed(work: FloatArray) -> FloatArray:
        return np.asarray(np.sum(ranks.everyones(work), axis=0))

    cameras, points = observations["camera_index"], observations["point_index"]
    count_of_cameras = share.cameras.num_cameras
    links = ranks.collected(camera_links(cameras, points, count_of_cameras))
    # By rank 0 alone: SciPy takes 25 MB of each process that loads it.
    places = ranks.from_root(lambda: camera_places(np.unique(np.concatenate(links)), count_of_cameras))
    return Tracks(cameras, points, count, first, share.num_points).cut(places, ranks.size, summed)
