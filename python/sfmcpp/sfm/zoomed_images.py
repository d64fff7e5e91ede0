"""Models of images that a zoom, or a crop, would relate as well.

A camera that stands and turns by R while its focal length grows by a factor s relates its images by the
homography ``K diag(s, s, 1) R K⁻¹``. The same homography is that of a flat scene that a camera of one focal
length comes nearer to, straight on. A model is made of it, whose depths mean nothing after a zoom: images
alone cannot tell.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sfmcpp.geometry.pinhole import PINHOLE, inverse_calibration
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.geometry.two_view_matrices import homography_errors_px
from sfmcpp.map import Map
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sfm.match_graph import MatchGraph, Pair
from sfmcpp.sfm.turned_cameras import focal_of_least

# A smaller factor is within what lenses of one kind differ by, and focusing does.
_LEAST_ZOOM = 1.1
# How much worse than homographies zooms may fit; below that error both are rounding [px].
_WORSE, _LEAST_ERROR_PX = 1.5, 0.1
# Pairs of a model that are looked at, those of most matches.
_PAIRS = 20


def zoom_warnings(graph: MatchGraph, models: Sequence[Map]) -> Iterator[str]:
    """Warn of models whose images may differ by a zoom alone.

    Parameters
    ----------
    graph : MatchGraph
        Images, features and pairs.
    models : sequence of Map
        What was made of them.

    Yields
    ------
    str
        A sentence for each such model.
    """
    for world in models:
        pairs = [
            pair
            for pair in graph.pairs
            if world.registered[[pair.first, pair.second]].all() and pair.geometry.kind != "none"
        ]
        if found := _most_zoomed(graph, world, pairs):
            yield _warning(graph, *found)


def _most_zoomed(graph: MatchGraph, world: Map, pairs: Sequence[Pair]) -> tuple[Pair, float] | None:
    """The pair that is zoomed most, and its factor, if all pairs fit zooms with one focal length."""
    planar = [pair for pair in pairs if pair.geometry.kind == "planar"]
    planar = sorted(planar, key=lambda pair: -pair.num_verified)[:_PAIRS]
    if not planar or any(pair.geometry.kind == "general" for pair in pairs):
        return None
    if not all(np.isfinite(pair.geometry.homography).all() for pair in planar):
        return None
    matched = [_Matched.of(graph, pair) for pair in planar]
    row = world.intrinsics[world.image_cameras[planar[0].first], :PINHOLE]

    def worse(focal_px: float) -> float:
        return max(one.worse(focal_px, row) for one in matched)

    # That of few images is a guess, and where the camera turned, too, only the right one fits.
    focal_px = row[0] if worse(row[0]) <= _WORSE else focal_of_least(worse, row)
    factors = np.array([one.zoom(focal_px, row)[0] for one in matched])
    most = int(np.argmax(np.abs(np.log(factors))))
    if worse(focal_px) > _WORSE or np.abs(np.log(factors[most])) < np.log(_LEAST_ZOOM):
        return None
    return planar[most], float(factors[most])


@dataclass(frozen=True)
class _Matched:
    """Positions of the matches of a pair in both images, and their homography."""

    first: FloatArray
    second: FloatArray
    homography: FloatArray

    @classmethod
    def of(cls, graph: MatchGraph, pair: Pair) -> _Matched:
        """Those that agree with the homography of a pair."""
        first = graph.features[pair.first].pixels[pair.verified[:, 0]]
        second = graph.features[pair.second].pixels[pair.verified[:, 1]]
        return cls(first, second, pair.geometry.homography)

    def zoom(self, focal_px: float, row: FloatArray) -> tuple[float, FloatArray]:
        """Factor of the zoom that is nearest to the homography, and that zoom as one."""
        inverse = inverse_calibration(np.concatenate([[focal_px], row[1:]]))
        matrix = np.linalg.inv(inverse)
        rays = inverse @ self.homography @ matrix
        factor = float(np.linalg.norm(rays[:2]) / np.sqrt(2) / np.linalg.norm(rays[2]))
        scale = np.diag([factor, factor, 1.0])
        turn = nearest_rotation(np.linalg.inv(scale) @ rays * np.sign(np.linalg.det(rays)))
        return factor, matrix @ scale @ turn @ inverse

    def worse(self, focal_px: float, row: FloatArray) -> float:
        """How many times as far as from the homography matches are from a zoom in the middle."""
        least_px = max(self._error_px(self.homography), _LEAST_ERROR_PX)
        return self._error_px(self.zoom(focal_px, row)[1]) / least_px

    def _error_px(self, homography: FloatArray) -> float:
        return float(np.median(homography_errors_px(homography, self.first, self.second)))


def _warning(graph: MatchGraph, pair: Pair, factor: float) -> str:
    images = (pair.first, pair.second) if factor > 1 else (pair.second, pair.first)
    far, near = (graph.photos[image].name for image in images)
    return (
        f"{near} shows what {far} shows as after a zoom or a crop ({max(factor, 1 / factor):.2f} times): "
        "then the depths of the model mean nothing; they are right only of a flat scene that the camera "
        "came nearer to; move the camera sideways between photos"
    )
