"""Geometry of cameras and points: near-critical configurations, small angles, units."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sfmcpp.doctor.case import Case
from sfmcpp.doctor.connections import held_by_points
from sfmcpp.doctor.conventions import better_at_start
from sfmcpp.doctor.finding import Finding, named_points, numbers
from sfmcpp.geometry.pinhole import (
    PINHOLE,
    homogeneous,
    pinhole_rows,
    to_normalised,
    undistorted_pixels,
    unit,
)
from sfmcpp.geometry.point_tests import triangulation_angles_deg
from sfmcpp.geometry.rotation_fit import angles_rad, fit_rotation
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.wording import counted

# Pairs of cameras whose rays are compared, and matches that a pair needs: a rotation takes two.
_PAIRS, _MATCHES = 40, 10
# Share of pairs, and of their matches, that a rotation alone must explain.
_MOST = 0.9
# Normal errors are within 3 σ nearly all: 1 − e^(−9/2) = 98.9 % in two coordinates.
_SIGMAS = 3.0
# As in the core: rays that differ by rounding alone.
_ONE_PLACE = 1e-9
# Beyond, squares of lengths differ from those of angles by more than the roots of double precision span.
_FAR_FROM_ONE = 1e6
# Double precision holds 16 digits: with 5 of them spent on an offset, and a step's square root, few are left.
_FAR_FROM_ORIGIN = 1e5


def pure_rotation(case: Case) -> Iterator[Finding]:
    """Find image sets that a purely rotating camera explains: they do not determine depths."""
    if case.is_misread or not case.problem.num_observations:
        return
    held = _held_cameras(case)
    turned = [_is_turned(case, *pair) for pair in _pairs(case) if not held[list(pair)].all()]
    if len(turned) and np.mean(turned) >= _MOST:
        yield Finding(
            "pure-rotation",
            "error",
            f"a rotation alone explains {_MOST:.0%} of the matches in {np.count_nonzero(turned)} "
            f"of {len(turned)} camera pairs: without a baseline, depths and centres are arbitrary",
            "take images from other positions, or fix the centres and solve for a panorama",
            measures={"pairs": float(len(turned)), "share": float(np.mean(turned))},
        )


def _held_cameras(case: Case) -> NDArray[np.bool_]:
    """(C,) cameras whose place fixed points tell, without any baseline."""
    return held_by_points(case.problem, np.arange(case.problem.num_cameras))


def _pairs(case: Case) -> list[tuple[int, int]]:
    """For some cameras the one that they share fewest points with, but enough: likely the farthest."""
    common = case.common_points
    cameras = np.flatnonzero(np.diff(common.indptr))
    chosen = cameras[np.linspace(0, len(cameras) - 1, min(len(cameras), _PAIRS)).astype(np.int64)]
    pairs = []
    for camera in chosen:
        row = slice(common.indptr[camera], common.indptr[camera + 1])
        others, counts = common.indices[row], common.data[row]
        if (counts >= _MATCHES).any():
            enough = counts >= _MATCHES
            pairs.append((int(camera), int(others[enough][np.argmin(counts[enough])])))
    return pairs


def _is_turned(case: Case, first: int, second: int) -> bool:
    rays = [_rays(case.problem, camera) for camera in (first, second)]
    _, a, b = np.intersect1d(rays[0][0], rays[1][0], return_indices=True)
    tolerance = _SIGMAS * np.sqrt(2.0) * case.sigma_px / case.focal_px
    one, other = rays[0][1][a], rays[1][1][b]
    rotation = fit_rotation(one, other, tolerance, seed=0)
    return bool(np.mean(angles_rad(one, other, rotation) <= tolerance) >= _MOST)


def _rays(problem: Problem, camera: int) -> tuple[NDArray[np.int32], FloatArray]:
    """Points that a camera observes, and unit vectors towards them in its frame."""
    rows = np.flatnonzero(problem.camera_index == camera)
    intrinsics = pinhole_rows(problem.intrinsics[problem.intrinsics_index[[camera]]])
    pixels = problem.pixels[rows]
    if intrinsics.shape[1] > PINHOLE:
        pixels = undistorted_pixels(pixels, intrinsics, np.zeros(len(rows), dtype=np.int32))
    return problem.point_index[rows], unit(homogeneous(to_normalised(pixels, intrinsics[0, :PINHOLE])))


def angles(case: Case) -> Iterator[Finding]:
    """Find points whose rays are parallel within the noise."""
    trial = case.trial
    if case.is_misread or trial is None:
        return
    problem = trial.problem
    parallax_px = np.radians(triangulation_angles_deg(problem, problem.points)) * case.focal_px
    seen = np.bincount(problem.point_index, minlength=problem.num_points) > 1
    small = seen & ~problem.fixed_points & (parallax_px < _SIGMAS * trial.sigma_px)
    if not small.any():
        return
    share = np.count_nonzero(small) / np.count_nonzero(seen)
    points = numbers(np.flatnonzero(small))
    yield Finding(
        "small-angles",
        "warning" if share > 0.5 else "note",
        f"{counted(len(points), 'point')} ({share:.1%}) with a parallax below {_SIGMAS:g} σ of the noise "
        f"({_SIGMAS * trial.sigma_px:.2g} px): their depth is undetermined",
        "use longer baselines, or leave these points out: they only contribute to rotations",
        named_points(problem, points),
        points=points,
        measures={"share": share},
    )


def coincident_centres(case: Case) -> Iterator[Finding]:
    """Find an initial state with all cameras at the same position."""
    problem = case.problem
    seen = (case.views_of_cameras > 0) & ~_held_cameras(case)
    if seen.sum() < 2:
        return
    spread = _spread(problem.centres[seen])
    depth = np.median(np.linalg.norm(problem.points - problem.centres[seen].mean(axis=0), axis=1))
    # Translations of camera_from_world, read as centres, are equal where the cameras look at one point.
    if spread <= _ONE_PLACE * depth and better_at_start(case) is None:
        case.is_misread = True
        yield Finding(
            "no-baseline",
            "error",
            f"all {np.count_nonzero(seen):,} cameras with observations are at the same position: no depth is "
            "determined",
            "start from distinct centres: from relative poses, GPS or `sfmcpp reconstruct`",
            measures={"spread": spread},
        )


def units(case: Case) -> Iterator[Finding]:
    """Find worlds whose size or place is far from what double precision and tolerances are made for."""
    problem = case.problem
    places = np.concatenate(
        [problem.points[case.views_of_points > 0], problem.centres[case.views_of_cameras > 0]]
    )
    if len(places) < 2:
        return
    extent, offset = _spread(places), float(np.linalg.norm(np.median(places, axis=0)))
    if extent > 0 and not 1 / _FAR_FROM_ONE < extent < _FAR_FROM_ONE:
        yield Finding(
            "units",
            "warning",
            f"the scene is {extent:.1e} units wide: the scales of lengths and angles differ too much",
            "choose a unit in which the scene is about 1 to 1,000 wide",
            measures={"extent": extent},
        )
    if extent > 0 and offset > _FAR_FROM_ORIGIN * extent:
        yield Finding(
            "far-from-origin",
            "warning",
            f"the scene is {offset:.1e} units from the origin and {extent:.1e} wide: differences of "
            f"coordinates lose {np.log10(offset / extent):.0f} of 16 digits",
            "subtract the median position from centres and points",
            measures={"offset": offset, "extent": extent},
        )


def _spread(positions: FloatArray) -> float:
    """Median distance from the median."""
    return float(np.median(np.linalg.norm(positions - np.median(positions, axis=0), axis=1)))
