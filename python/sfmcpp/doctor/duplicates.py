"""Duplicate observations, points and cameras."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sfmcpp.doctor.case import Case, observation_keys
from sfmcpp.doctor.finding import Finding, named_points, numbers
from sfmcpp.model import Problem
from sfmcpp.wording import counted

# Copies of a share s of the points make standard deviations smaller by s / 2. Features with two orientations
# make 3 to 5 % of the points of sets of good repute copies (BAL's Ladybug, Bundler's own example).
_NOTABLE_SHARE = 0.1


def second_observations(problem: Problem) -> NDArray[np.intp]:
    """Numbers of observations whose camera observed their point before."""
    first = np.unique(observation_keys(problem), return_index=True)[1]
    repeated = np.ones(problem.num_observations, dtype=np.bool_)
    repeated[first] = False
    return np.flatnonzero(repeated)


def duplicate_observations(problem: Problem) -> Iterator[Finding]:
    """Find cameras that observe a point twice, which a solve refuses."""
    repeated = second_observations(problem)
    if len(repeated):
        points = np.unique(problem.point_index[repeated])
        yield Finding(
            "duplicate-observations",
            "error",
            f"{counted(len(repeated), 'observation')} of a point that the same camera already observes",
            "use --fix to keep the first of each; if the pixels differ, two different tracks were merged",
            named_points(problem, numbers(points)),
            points=numbers(points),
            observations=numbers(repeated),
        )


def duplicates(case: Case) -> Iterator[Finding]:
    """Find cameras and points that duplicate the observations of others."""
    problem = case.problem
    yield from _duplicate_cameras(case, copies(problem.camera_index, problem.point_index, problem.pixels))
    yield from _duplicate_points(case, copies(problem.point_index, problem.camera_index, problem.pixels))


def copies(
    owner: NDArray[np.integer], partner: NDArray[np.integer], pixels: NDArray[np.float64]
) -> list[tuple[int, int]]:
    """Pairs of owners, the original and its copy, with two observations or more, all of them the same.

    The same are pixels that agree in all bits, and partners: of cameras the points, of points the cameras.
    """
    order = np.lexsort((partner, owner))
    owners, begin = np.unique(owner[order], return_index=True)
    if not len(owners):
        return []
    rows = np.column_stack([partner[order].astype(np.float64), pixels[order]])
    sizes = np.diff([*begin, len(order)])
    # Sums of scrambled bits tell most apart; those that agree are compared in full.
    marks = np.add.reduceat(_hashed_rows(rows), begin)
    sorted_owners = np.argsort(marks, kind="stable")
    repeats = np.r_[False, np.diff(marks[sorted_owners]) == 0]
    first = np.maximum.accumulate(np.where(repeats, 0, np.arange(len(owners))))
    found = []
    for place in np.flatnonzero(repeats & (sizes[sorted_owners] > 1)):
        this, original = sorted_owners[place], sorted_owners[first[place]]
        ours, theirs = (rows[begin[k] : begin[k] + sizes[k]] for k in (this, original))
        if np.array_equal(ours, theirs):
            found.append((int(owners[original]), int(owners[this])))
    return found


def _hashed_rows(rows: NDArray[np.float64]) -> NDArray[np.uint64]:
    """(M,) bits of the three numbers of each row, mixed by odd multipliers (multiplicative hashing)."""
    bits = np.ascontiguousarray(rows).view(np.uint64)
    mixed = np.zeros(len(rows), dtype=np.uint64)
    for column, odd in zip(bits.T, (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9), strict=True):
        mixed = (mixed ^ (column >> np.uint64(29)) ^ column) * np.uint64(odd)
    return mixed


def _duplicate_cameras(case: Case, pairs: list[tuple[int, int]]) -> Iterator[Finding]:
    if pairs:
        copied = [copy for _, copy in pairs]
        yield Finding(
            "duplicate-cameras",
            "warning",
            f"{counted(len(pairs), 'camera')} with exactly the observations of another camera: "
            f"{case.name_of_camera(pairs[0][1])} duplicates {case.name_of_camera(pairs[0][0])}",
            "give each image once; --fix drops the observations of the copies",
            case.named_cameras(sorted(copied)),
            cameras=tuple(copied),
        )


def _duplicate_points(case: Case, pairs: list[tuple[int, int]]) -> Iterator[Finding]:
    if pairs:
        copied = [copy for _, copy in pairs]
        count = case.problem.num_points
        share = len(pairs) / max(count, 1)
        ids = case.problem.metadata.ids_of_points(pairs[0][::-1], count)
        yield Finding(
            "duplicate-points",
            "warning" if share > _NOTABLE_SHARE else "note",
            f"{counted(len(pairs), 'point')} ({share:.1%}) with exactly the observations of another point, "
            f"which count twice: {pairs[0][1]} duplicates {pairs[0][0]}" + (f" ({ids})" if ids else ""),
            "few are usual, as detectors give some corners several orientations; use --fix to drop the "
            "observations of the copies",
            named_points(case.problem, sorted(copied)),
            points=tuple(copied),
            measures={"share": share},
        )
