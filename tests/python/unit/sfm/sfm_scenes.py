"""Match graphs of synthetic scenes, whose cameras and points are known."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from sfmcpp.geometry import two_view_geometry
from sfmcpp.model import Problem
from sfmcpp.model.photos import Features, Photo
from sfmcpp.sfm import MatchGraph, Pair

SIZE = (640, 480)


def match_graph(
    truth: Problem,
    *,
    sigma_px: float = 0.5,
    outliers: float = 0.0,
    seed: int = 0,
    known: bool = True,
    reach: int = 4,
) -> MatchGraph:
    """Match images of a scene that are at most `reach` apart on the circle; `outliers`: a part of each."""
    random = np.random.default_rng(seed)
    features, rows_of = [], []
    for camera in range(truth.num_cameras):
        rows = np.flatnonzero(truth.camera_index == camera)
        rows = rows[np.argsort(truth.point_index[rows])]
        pixels = truth.pixels[rows] + random.normal(0, sigma_px, (len(rows), 2))
        unknown = np.full(len(rows), np.nan)
        colors = np.full((len(rows), 3), 128, dtype=np.uint8)
        features.append(Features(pixels, unknown, unknown, colors, np.zeros((len(rows), 0), dtype=np.uint8)))
        rows_of.append(truth.point_index[rows])
    photos = [Photo(f"{camera:03d}.jpg", size=SIZE) for camera in range(truth.num_cameras)]
    pairs = []
    for i, j in combinations(range(truth.num_cameras), 2):
        if min(j - i, truth.num_cameras + i - j) > reach:
            continue
        _, in_i, in_j = np.intersect1d(rows_of[i], rows_of[j], return_indices=True)
        wrong = random.random(len(in_i)) < outliers
        in_j[wrong] = np.roll(in_j[wrong], 1)
        matches = np.column_stack([in_i, in_j]).astype(np.int32)
        rows = [truth.intrinsics[truth.intrinsics_index[k]] if known else None for k in (i, j)]
        geometry = two_view_geometry(features[i].pixels[in_i], features[j].pixels[in_j], *rows, seed=seed)
        pairs.append(Pair(i, j, matches, geometry))
    return MatchGraph(photos, features, pairs)
