"""Parts of a problem, cut by points: each has all cameras, its points and all their observations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba.arrays import core_arrays
from sfmcpp.ba.checkpoints import digest
from sfmcpp.ba.partition import partition_points
from sfmcpp.ba.ranks import Ranks
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Metadata, Problem

Rows = dict[str, NDArray[Any]]

# What a row of a part's points and observations has, beside its number in the whole.
NUMBER, COLORS = "number", "point_colors"
_OF_POINTS = ("points", "fixed_points")
POINT_ROWS = (*_OF_POINTS, COLORS)
OBSERVATION_ROWS = ("camera_index", "point_index", "pixels", "sigma_px", "covariance_px2")


@dataclass(frozen=True)
class Part:
    """Some points of a problem with all their observations, and all cameras.

    Attributes
    ----------
    problem : Problem
        The part; its metadata has the colours of these points, and of all else what the whole has.
    point_numbers : (n,) int64
        Which points of the whole they are, in ascending order.
    observation_numbers : (m,) int64
        Which observations of the whole they are, in ascending order.
    """

    problem: Problem
    point_numbers: NDArray[np.int64]
    observation_numbers: NDArray[np.int64]

    def without_numbers(self) -> Part:
        """The same problem, which cannot be written as a part any more."""
        return Part(self.problem, np.zeros(0, np.int64), np.zeros(0, np.int64))

    @property
    def rows_of_points(self) -> Rows:
        """Rows by :func:`rows_of_points`, with the points' numbers in the whole."""
        return rows_of_points(self.problem, self.point_numbers)

    @property
    def rows_of_observations(self) -> Rows:
        """Rows by :func:`rows_of_observations`, with the numbers of observations and points in the whole."""
        points = self.point_numbers[self.problem.point_index].astype(np.int32)
        return rows_of_observations(self.problem, self.observation_numbers) | {"point_index": points}


def cameras_alone(problem: Problem) -> Problem:
    """All cameras, without points."""
    blind = problem.with_observations(np.zeros(0, np.int64))
    return replace(
        blind,
        points=blind.points[:0],
        fixed_points=blind.fixed_points[:0],
        metadata=replace(problem.metadata, point_colors=None),
    )


def rows_of_points(problem: Problem, numbers: NDArray[np.int64]) -> Rows:
    """Arrays (N, …) by name of what each point has, and its number."""
    arrays = {name: getattr(problem, name) for name in _OF_POINTS}
    return _without_none(arrays | {COLORS: problem.metadata.point_colors, NUMBER: numbers})


def rows_of_observations(problem: Problem, numbers: NDArray[np.int64]) -> Rows:
    """Arrays (M, …) by name of what each observation has, and its number."""
    return _without_none({name: getattr(problem, name) for name in OBSERVATION_ROWS} | {NUMBER: numbers})


def _without_none(arrays: dict[str, Any]) -> Rows:
    return {name: array for name, array in arrays.items() if array is not None}


def part_of(problem: Problem, points: NDArray[np.int64]) -> Part:
    """Take some points with their observations, and all cameras.

    Parameters
    ----------
    problem : Problem
        The whole.
    points : (n,) int
        Which points, in ascending order.

    Returns
    -------
    Part
        Arrays of cameras, intrinsics and rigs are copies.
    """
    number = np.full(problem.num_points, -1, np.int32)
    number[points] = np.arange(len(points), dtype=np.int32)
    rows = np.flatnonzero(number[problem.point_index] >= 0)
    chosen, colors = problem.with_observations(rows), problem.metadata.point_colors
    part = replace(
        chosen,
        points=problem.points[points],
        fixed_points=problem.fixed_points[points],
        point_index=number[chosen.point_index],
        metadata=replace(problem.metadata, point_colors=None if colors is None else colors[points]),
    )
    return Part(part, points, rows)


def part_from_rows(cameras: Problem, points: Rows, observations: Rows) -> Part:
    """Make a part of rows in any order.

    Parameters
    ----------
    cameras : Problem
        All cameras, without points.
    points, observations : dict of str to array
        As those of a :class:`Part`; they are used up.

    Returns
    -------
    Part
        Rows in the order of their numbers.
    """
    points, observations = _sorted_by_number(points), _sorted_by_number(observations)
    own_index = np.searchsorted(points[NUMBER], observations["point_index"])
    problem = replace(
        cameras,
        points=points["points"],
        fixed_points=points["fixed_points"],
        camera_index=observations["camera_index"],
        point_index=own_index.astype(np.int32),
        pixels=observations["pixels"],
        sigma_px=observations.get("sigma_px"),
        covariance_px2=observations.get("covariance_px2"),
        metadata=replace(cameras.metadata, point_colors=points.get(COLORS)),
    )
    return Part(problem, points[NUMBER], observations[NUMBER])


def joined_rows(pieces: Sequence[Rows]) -> Rows:
    """Rows of several, one after the other; the pieces are used up."""
    if len(pieces) == 1:
        return pieces[0]
    return {name: np.concatenate([piece.pop(name) for piece in pieces]) for name in list(pieces[0])}


def joined_parts(parts: Sequence[Part]) -> Problem:
    """Join all parts of a problem; cameras are those of the first."""
    points = joined_rows([part.rows_of_points for part in parts])
    return part_from_rows(
        cameras_alone(parts[0].problem), points, joined_rows([part.rows_of_observations for part in parts])
    ).problem


def _sorted_by_number(rows: Rows) -> Rows:
    numbers = rows[NUMBER]
    if (numbers[1:] > numbers[:-1]).all():
        return rows
    order = np.argsort(numbers)
    return {name: rows.pop(name)[order] for name in list(rows)}


@dataclass(frozen=True)
class ProblemSize:
    """How many cameras, points and observations a problem has, and, if it has rigs, frames and sensors."""

    num_cameras: int
    num_points: int
    num_observations: int
    num_frames: int | None = None
    num_sensors: int = 0
    num_free_sensors: int = 0

    @classmethod
    def of(cls, problem: Problem, ranks: Ranks | None = None) -> ProblemSize:
        """Size of a problem, or of the whole whose part it is on this rank."""
        own = (problem.num_points, problem.num_observations)
        points, observations = zip(*([own] if ranks is None else ranks.everyones(own)), strict=True)
        size = cls(problem.num_cameras, sum(points), sum(observations))
        if (rigs := problem.rigs) is None:
            return size
        free = int(rigs.free_sensors.sum())
        return replace(size, num_frames=rigs.num_frames, num_sensors=rigs.num_sensors, num_free_sensors=free)


def part_for_rank(whole: Callable[[], Problem], ranks: Ranks) -> Part:
    """Let rank 0 make a whole problem and deal out its parts; if that fails, all raise what it has raised."""
    made: list[Problem] = []
    ranks.from_root(lambda: made.append(whole()))
    parts = [partition_points(problem, ranks.size) for problem in made]
    return ranks.dealt(lambda rank: part_of(made[0], np.flatnonzero(parts[0] == rank)))


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
        return replace(part_of(self._whole, self._points[rank]).problem, metadata=Metadata())

    def collect(self) -> None:
        """Write what the parts have become into the whole."""
        collected = self._ranks.collected(self.mine.points)
        if self._whole is None:
            return
        self._whole.cameras[:] = self.mine.cameras
        self._whole.intrinsics[:] = self.mine.intrinsics
        if self._whole.rigs is not None and self.mine.rigs is not None:
            self._whole.rigs.sensors[:] = self.mine.rigs.sensors
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
        If one is no problem, cameras, intrinsics or rigs differ between ranks, or the points and observations
        of two do not.
    """

    def __init__(self, problem: Problem, ranks: Ranks) -> None:
        self.mine = problem
        arrays = ranks.agreed(lambda: core_arrays(problem))
        require_alike(ranks, {name: arrays[name] for name in _REPLICATED if name in arrays})
        _require_different(ranks, arrays)

    def collect(self) -> None:
        """Each rank keeps its part."""


def gathered(parts: OwnParts, ranks: Ranks) -> Problem | None:
    """Gather the parts of all ranks on rank 0, one after the other; None elsewhere."""
    mine = _with_uncertainty_as_all(parts.mine, ranks)
    sizes = np.array(ranks.everyones((mine.num_points, mine.num_observations)))
    point, observation = sizes[: ranks.rank].sum(axis=0)
    numbers = point + np.arange(mine.num_points), observation + np.arange(mine.num_observations)
    collected = ranks.collected(Part(replace(mine, metadata=Metadata()), *numbers))
    return joined_parts(collected) if collected else None


def _with_uncertainty_as_all(mine: Problem, ranks: Ranks) -> Problem:
    """The part, with standard deviations or covariances that say the same if any of the ranks has them."""
    own = mine.uncertainty
    some = ranks.everyones((own.sigma_px is not None, own.covariance_px2 is not None))
    with_sigmas, with_covariances = map(any, zip(*some, strict=True))
    if with_covariances:
        return replace(mine, sigma_px=None, covariance_px2=own.as_covariances(mine.num_observations))
    if with_sigmas:
        return replace(mine, sigma_px=own.as_sigmas(mine.num_observations))
    return mine


# What tells a part from another, and of how many rows.
_OF_PART, _COMPARED = ("camera_index", "point_index", "pixels", "points"), 10_000
_REPLICATED = (
    "camera_model",
    "cameras",
    "intrinsics",
    "intrinsics_index",
    "fixed_cameras",
    "fixed_intrinsics",
    "rig_sensors",
    "frame_of_camera",
    "sensor_of_camera",
    "free_sensors",
)


def require_alike(ranks: Ranks, values: dict[str, Any]) -> None:
    """Raise InvalidArgument, on all ranks, for what is not the same on all of them."""
    mine = {name: digest(value) for name, value in values.items()}
    for rank, theirs in enumerate(digests := ranks.everyones(mine)):
        for name in digests[0] | theirs:
            if theirs.get(name) != digests[0].get(name):
                raise InvalidArgument(f"{name}: differs between ranks 0 and {rank}, must be the same on all")


def _require_different(ranks: Ranks, arrays: dict[str, Any]) -> None:
    """Refuse, on all ranks, two with the same part, mostly the whole problem: it would count twice."""
    some = {name: (len(arrays[name]), digest(arrays[name][:_COMPARED])) for name in _OF_PART}
    mine = digest(some) if len(arrays["pixels"]) else None
    first: dict[str, int] = {}
    for rank, theirs in enumerate(ranks.everyones(mine)):
        if theirs is not None and first.setdefault(theirs, rank) != rank:
            raise InvalidArgument(
                f"problem: ranks {first[theirs]} and {rank} have the same points and observations, which "
                "would count twice: pass the whole problem on rank 0 and None on all others, or to each rank "
                "a part of its own"
            )


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
