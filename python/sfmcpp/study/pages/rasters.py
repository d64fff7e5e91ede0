"""Pictures of pixels for pages: the model from above, and which image matches which."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import FloatArray

_CAMERA = (213, 94, 0, 255)
# Steps from few to many inliers, even in lightness.
_RAMP = np.array(
    [[222, 235, 247], [158, 202, 225], [66, 146, 198], [8, 81, 156], [8, 48, 107]], dtype=np.float64
)
_MOST_CELLS = 500
_SHOWN = (0.01, 0.99)  # of the points, along each axis: a few lie far off

Pixels = NDArray[np.uint8]


def top_view(
    points: FloatArray, colors: NDArray[np.uint8], centres: FloatArray, size: tuple[int, int] = (640, 400)
) -> Pixels:
    """Draw a model as from above, what is higher over what is lower; transparent where there is nothing.

    Parameters
    ----------
    points : (N, 3) float64
        x right, y ahead, z up.
    colors : (N, 3) uint8
        Their colours.
    centres : (K, 3) float64
        Centres of the cameras, drawn as dots.
    size : (int, int)
        Width and height of the picture [px].
    """
    width, height = size
    picture: Pixels = np.zeros((height, width, 4), dtype=np.uint8)
    low, high = _box(points, centres)
    middle, spans = (low + high) / 2, high - low
    scale = min((width - 24) / max(spans[0], 1e-12), (height - 24) / max(spans[1], 1e-12))
    order = np.argsort(points[:, 2], kind="stable")
    at = _pixels(points[order], middle, scale, size)
    rgba = np.concatenate([colors[order], np.full((len(points), 1), 255, dtype=np.uint8)], axis=1)
    for dx, dy in np.ndindex(2, 2):
        _dab(picture, at + np.array([dx, dy]), rgba)
    marks = _pixels(centres, middle, scale, size)
    for dx in range(-3, 4):
        for dy in range(-3, 4):
            if dx * dx + dy * dy <= 10:
                _dab(picture, marks + np.array([dx, dy]), np.array(_CAMERA, dtype=np.uint8))
    return picture


def _box(points: FloatArray, centres: FloatArray) -> FloatArray:
    """Least and largest coordinates (2, 3) of all cameras and of all but the farthest points."""
    ends = [centres] if len(centres) else []
    if len(points):
        ends.append(np.quantile(points, _SHOWN, axis=0))
    both = np.concatenate(ends) if ends else np.array([[-0.5] * 3, [0.5] * 3])
    return np.stack([both.min(axis=0), both.max(axis=0)])


def _pixels(places: FloatArray, middle: FloatArray, scale: float, size: tuple[int, int]) -> NDArray[np.int64]:
    flat = (places[:, :2] - middle[:2]) * (scale, -scale) + (size[0] / 2, size[1] / 2)
    # Far outside is as good as just outside.
    return np.asarray(np.floor(np.clip(flat, -100, 100_000)), dtype=np.int64)


def _dab(picture: Pixels, at: NDArray[np.int64], rgba: Pixels) -> None:
    inside = ((at >= 0) & (at < (picture.shape[1], picture.shape[0]))).all(axis=1)
    x, y = at[inside].T
    picture[y, x] = rgba[inside] if rgba.ndim == 2 else rgba


def match_matrix(
    count: int, firsts: NDArray[np.intp], seconds: NDArray[np.intp], inliers: NDArray[np.intp]
) -> Pixels:
    """Draw which of `count` images match: a cell for each two, or for each two groups of many images.

    Parameters
    ----------
    count : int
        Images.
    firsts, seconds, inliers : (p,) int
        Images of each pair, and how many matches agree; 0 for a pair that was tried and does not match.
    """
    cells = max(1, min(count, _MOST_CELLS))
    group = -(-max(count, 1) // cells)
    cells = -(-max(count, 1) // group)
    most = np.zeros((cells, cells))
    tried = np.zeros((cells, cells), dtype=np.bool_)
    for a, b in ((firsts, seconds), (seconds, firsts)):
        np.maximum.at(most, (a // group, b // group), inliers)
        tried[a // group, b // group] = True
    picture: Pixels = np.full((cells, cells, 4), (0, 0, 0, 0), dtype=np.uint8)
    picture[tried] = (128, 128, 128, 40)
    share = np.sqrt(most / max(float(most.max(initial=0)), 1.0)) * (len(_RAMP) - 1)
    shown = most > 0
    steps = np.arange(len(_RAMP))
    rgb = np.stack([np.interp(share[shown], steps, channel) for channel in _RAMP.T], axis=1)
    picture[shown] = np.concatenate([rgb, np.full((len(rgb), 1), 255)], axis=1).astype(np.uint8)
    picture[np.arange(cells), np.arange(cells)] = (128, 128, 128, 160)
    zoom = max(1, 480 // cells)
    return np.repeat(np.repeat(picture, zoom, axis=0), zoom, axis=1)
