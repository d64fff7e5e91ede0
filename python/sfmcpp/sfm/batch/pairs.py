"""Fundamental matrices of pairs of images, and the observations that they support."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.geometry import fundamental_from_matches
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sfm.batch.measurements import Indices, Measurements
from sfmcpp.sfm.tracks import connected_parts

LEAST_SHARED, _LEAST_INLIERS = 12, 10
_MOST_PAIRS = 12
# Share of its comparisons in which a right observation agrees at least; where a third of all is wrong, it is
# two thirds on average, of few comparisons.
_LEAST_AGREEMENT = 0.25
_CONFIDENCE, _MOST_SAMPLES = 0.99, 4000


@dataclass(frozen=True, eq=False)
class PairGeometry:
    """Epipolar geometry of two images.

    Attributes
    ----------
    first, second : int
        Numbers of the images.
    fundamental : (3, 3) float64
        ``q₁ᵀ F q₂ = 0`` in the frames of the images, of norm one.
    rows : (2, m) int64
        Observations of all tracks they share.
    inliers : (m,) bool
        Which agree.
    """

    first: int
    second: int
    fundamental: FloatArray
    rows: Indices
    inliers: BoolArray


def pair_geometries(measured: Measurements, threshold_px: float, seed: int) -> list[PairGeometry]:
    """Estimate the pairs worth trying: each image with those it shares the most tracks with."""
    found = []
    for first, second in candidate_pairs(measured.shared_counts()):
        rows = measured.common_rows([first, second])
        pixels = measured.pixels[rows]
        estimate = fundamental_from_matches(
            pixels[0],
            pixels[1],
            threshold_px=threshold_px,
            min_inliers=_LEAST_INLIERS,
            confidence=_CONFIDENCE,
            max_iterations=_MOST_SAMPLES,
            seed=seed,
        )
        if estimate.success:
            matrix = _matrix_in_frames(estimate.matrix, *measured.frames[[first, second]])
            found.append(PairGeometry(first, second, matrix, rows, estimate.inliers))
    return found


def candidate_pairs(shared: Indices) -> list[tuple[int, int]]:
    """Pairs that share enough tracks, of each image at most a dozen, those with the most first."""
    counts = np.triu(shared, 1) + np.triu(shared, 1).T
    chosen: set[tuple[int, int]] = set()
    for image, row in enumerate(counts):
        best = np.argsort(-row, kind="stable")[:_MOST_PAIRS]
        chosen.update((min(image, int(o)), max(image, int(o))) for o in best if row[o] >= LEAST_SHARED)
    return sorted(chosen)


def plausible_observations(measured: Measurements, pairs: list[PairGeometry]) -> BoolArray:
    """Whether each observation (M,) agrees with others of its track, by the epipolar geometry of pairs.

    It must belong to the largest part of its track that agreements hold together, and agree with a quarter
    of what it was compared with: a right one does with all that are right, a wrong one with few.
    """
    count = len(measured.image)
    linked = np.concatenate([np.empty((2, 0), np.int64), *(p.rows[:, p.inliers] for p in pairs)], axis=1)
    compared = np.concatenate([np.empty(0, np.int64), *(pair.rows.ravel() for pair in pairs)])
    agreed = np.bincount(linked.ravel(), minlength=count)
    tested = np.bincount(compared, minlength=count)
    agrees = (agreed > 0) & (agreed >= _LEAST_AGREEMENT * tested)
    return np.asarray(agrees & _in_largest_part(measured, linked))


def _in_largest_part(measured: Measurements, linked: Indices) -> BoolArray:
    """Whether each observation (M,) is in the largest connected part of its track, the first among equals."""
    part = connected_parts(linked.T, len(measured.image))
    size = np.bincount(part)[part]
    order = np.lexsort((part, -size, measured.track))
    first = order[np.flatnonzero(np.diff(measured.track[order], prepend=-1))]
    largest = np.full(measured.num_tracks, -1)
    largest[measured.track[first]] = part[first]
    return np.asarray(part == largest[measured.track])


def _matrix_in_frames(matrix: FloatArray, frame_1: FloatArray, frame_2: FloatArray) -> FloatArray:
    moved = _denormalising(frame_1).T @ matrix @ _denormalising(frame_2)
    return np.asarray(moved / np.linalg.norm(moved))


def _denormalising(frame: FloatArray) -> FloatArray:
    scale, cx, cy = frame
    return np.array([[scale, 0, cx], [0, scale, cy], [0, 0, 1.0]])
