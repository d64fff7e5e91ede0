"""Focal length and distortion with which pairs of images of one camera are rotations, as far as any are.

The images of a lens that bends lines are related by no homography when the camera turns on the spot, and look
like a scene in depth. Rays are free of that: one lens makes those of all pairs rotations of each other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from sfmcpp.geometry.pinhole import PINHOLE, homogeneous, to_normalised, to_pixels, unit
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.sfm.match_graph import MatchGraph, Pair

# Focal lengths that are tried, in lengths of the longer side, and k1 r² at half of that side.
_FOCALS = np.geomspace(0.3, 2.5, 12)
_BENDS = (-0.12, -0.06, 0.0, 0.06, 0.12)
_FIRST_STEPS = 0.1, 0.03, 0.01
_MOST_STEPS = 250
_EXACT = 1e-3
# Pairs that are looked at, those first that have most matches, and matches of each.
_PAIRS, _MATCHES = 12, 150
# Matches so many times as far off as half of them are wrong; no matches are better [px].
_FAR, _LEAST_ERROR_PX = 3.0, 0.3
_REFITS = 3
_K1 = PERSPECTIVE.index("k1")


def lenses_of_rotations(graph: MatchGraph, pairs: Sequence[Pair], row: FloatArray) -> Iterator[FloatArray]:
    """Find lenses with which pairs come nearest to rotations.

    Parameters
    ----------
    graph : MatchGraph
        Images and features.
    pairs : sequence of Pair
        Of one camera; at least one.
    row : (12,) float64
        Its intrinsics, of which focal length and distortion are unknown.

    Yields
    ------
    (12,) float64
        The intrinsics with focal length and k1; then also with k2. Whether the pairs are rotations is for the
        caller to judge.
    """
    most = sorted(pairs, key=lambda pair: -pair.num_verified)[:_PAIRS]
    first, second = _some_matches(graph, most)

    def worse(unknowns: FloatArray) -> float:
        return float(np.median(_median_errors_px(first, second, _lens(row, unknowns))))

    tried = [np.array([np.log(focal), bend]) for focal in _FOCALS for bend in _BENDS]
    best = _descend(worse, min(tried, key=worse))
    yield _lens(row, best)
    yield _lens(row, _descend(worse, np.append(best, 0.0)))


def _descend(worse: Callable[[FloatArray], float], start: FloatArray) -> FloatArray:
    from scipy.optimize import minimize

    steps = np.vstack([np.zeros(len(start)), np.diag(_FIRST_STEPS[: len(start)])])
    options: Any = {
        "initial_simplex": start + steps,
        "maxiter": _MOST_STEPS,
        "xatol": _EXACT,
        "fatol": _EXACT,
    }
    return np.asarray(minimize(worse, start, method="Nelder-Mead", options=options).x)


def _lens(row: FloatArray, unknowns: FloatArray) -> FloatArray:
    """Intrinsics of ln of the focal length in lengths of the longer side, k1 r² and k2 r⁴ at half of it."""
    focal, bends = float(np.exp(unknowns[0])), unknowns[1:]
    lens = np.zeros(len(PERSPECTIVE))
    lens[:PINHOLE] = row[:PINHOLE]
    lens[0] = focal * 2 * row[2:4].max()
    lens[_K1 : _K1 + len(bends)] = bends * (2 * focal) ** (2 * np.arange(1, len(bends) + 1))
    return lens


def _some_matches(graph: MatchGraph, pairs: Sequence[Pair]) -> tuple[FloatArray, FloatArray]:
    """(P, m, 2) pixels of as many verified matches of each pair, in both images."""
    both: tuple[list[FloatArray], list[FloatArray]] = ([], [])
    for pair in pairs:
        spread = np.linspace(0, pair.num_verified - 1, _MATCHES).astype(np.intp)
        for pixels, image, column in zip(
            both, (pair.first, pair.second), pair.verified[spread].T, strict=True
        ):
            pixels.append(graph.features[image].pixels[column])
    return np.array(both[0]), np.array(both[1])


def _median_errors_px(first: FloatArray, second: FloatArray, lens: FloatArray) -> FloatArray:
    """Median error (P,) of the rotations that fit the rays of matches (P, m, 2) best [px]."""
    rays_1, rays_2 = (unit(homogeneous(to_normalised(pixels, lens))) for pixels in (first, second))
    seen: BoolArray = np.asarray(np.isfinite(rays_1).all(axis=-1) & np.isfinite(rays_2).all(axis=-1))
    rays_1, rays_2 = np.where(seen[..., None], rays_1, 0), np.where(seen[..., None], rays_2, 0)
    good = seen
    for _ in range(_REFITS):
        turn = nearest_rotation(np.swapaxes(rays_2 * good[..., None], 1, 2) @ rays_1)
        errors = np.where(seen, _errors_px(rays_1 @ np.swapaxes(turn, 1, 2), second, lens), np.inf)
        median = np.median(errors, axis=1)
        good = errors <= _FAR * np.maximum(median, _LEAST_ERROR_PX)[:, None]
    return np.asarray(median)


def _errors_px(rays: FloatArray, pixels: FloatArray, lens: FloatArray) -> FloatArray:
    """Distances (P, m) of the images of rays (P, m, 3) from pixels; infinite behind the camera."""
    before = rays[..., 2] > 0
    depths = np.where(before, rays[..., 2], 1.0)
    errors = np.linalg.norm(to_pixels(rays[..., :2] / depths[..., None], lens) - pixels, axis=-1)
    return np.asarray(np.where(before, errors, np.inf))
