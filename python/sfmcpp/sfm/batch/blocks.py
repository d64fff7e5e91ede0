"""Full sub-matrices of the measurement matrix, each rescaled by chained projective depths and factorised.

Thesis §3.1.5.3 and §3.1.5.4; P. Sturm, B. Triggs, ECCV 1996; D. Martinec, T. Pajdla, CVPR 2005.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sfm.batch.measurements import Indices, Measurements
from sfmcpp.sfm.batch.pairs import PairGeometry

_LEAST_TRACKS = 8
_SIZES = (3, 4, 5, 6, 8, 10)
_SETTLED = 1e-4


@dataclass(frozen=True, eq=False)
class Block:
    """A full sub-matrix with its factors.

    Attributes
    ----------
    images : list of int
        Its s images.
    tracks : (n,) int64
        Its tracks.
    factors : Factors
        Cameras and points in a projective frame of its own.
    error_px : float
        Median reprojection error [px].
    """

    images: list[int]
    tracks: Indices
    factors: Factors
    error_px: float


def factorised_blocks(
    measured: Measurements, pairs: list[PairGeometry], kept: BoolArray, threshold_px: float
) -> list[Block]:
    """All blocks that are consistent in themselves."""
    matrices = {(pair.first, pair.second): pair.fundamental for pair in pairs}
    support = {(pair.first, pair.second): int(pair.inliers.sum()) for pair in pairs}
    blocks = [
        _factorised_block(measured, images, matrices, support, kept, threshold_px)
        for images in image_sets(measured, support, kept)
    ]
    return [block for block in blocks if block is not None]


def image_sets(
    measured: Measurements, support: dict[tuple[int, int], int], kept: BoolArray
) -> list[tuple[int, ...]]:
    """Sets of images with enough tracks in common: grown from each image, and triples of close ones."""
    seen = _visibility(measured, kept)
    neighbours: dict[int, list[int]] = {image: [] for image in range(measured.num_images)}
    for (first, second), _ in sorted(support.items(), key=lambda item: (-item[1], item[0])):
        neighbours[first].append(second)
        neighbours[second].append(first)
    chosen: set[tuple[int, ...]] = set()
    for image in range(measured.num_images):
        chosen.update(_nested_image_sets(image, neighbours, seen))
        chosen.update(_image_triples(image, neighbours, seen))
    return sorted(chosen)


def _visibility(measured: Measurements, kept: BoolArray) -> BoolArray:
    seen = np.zeros((measured.num_images, measured.num_tracks), dtype=np.bool_)
    seen[measured.image[kept], measured.track[kept]] = True
    return seen


def _nested_image_sets(
    image: int, neighbours: dict[int, list[int]], seen: BoolArray
) -> list[tuple[int, ...]]:
    """Nested sets: always add the image that leaves the most tracks."""
    images, common = [image], seen[image]
    found: list[tuple[int, ...]] = []
    while True:
        candidates = sorted({other for member in images for other in neighbours[member]} - set(images))
        if not candidates:
            return found
        counts = (seen[candidates] & common).sum(axis=1)
        best = int(np.argmax(counts))
        if counts[best] < _LEAST_TRACKS:
            return found
        images.append(candidates[best])
        common = common & seen[candidates[best]]
        if len(images) in _SIZES:
            found.append(tuple(sorted(images)))
        if len(images) == _SIZES[-1]:
            return found


def _image_triples(image: int, neighbours: dict[int, list[int]], seen: BoolArray) -> list[tuple[int, ...]]:
    """The six triples of an image with two of its neighbours that share the most tracks."""
    others = neighbours[image][:8]
    found: list[tuple[int, tuple[int, ...]]] = []
    for place, second in enumerate(others):
        common = seen[image] & seen[second]
        for third in others[place + 1 :]:
            count = int((common & seen[third]).sum())
            if count >= _LEAST_TRACKS:
                found.append((-count, tuple(sorted((image, second, third)))))
    return [images for _, images in sorted(found)[:8]]


def _factorised_block(
    measured: Measurements,
    images: tuple[int, ...],
    matrices: dict[tuple[int, int], FloatArray],
    support: dict[tuple[int, int], int],
    kept: BoolArray,
    threshold_px: float,
) -> Block | None:
    chain = _depth_chain(images, support)
    if chain is None:
        return None
    order, parents = chain
    rows = measured.common_rows(order, kept)
    scale_px = measured.frames[order, 0][:, None]
    local = {
        (a, b): matrices[order[a], order[b]] if order[a] < order[b] else matrices[order[b], order[a]].T
        for a in range(len(order))
        for b in range(a + 1, len(order))
        if (min(order[a], order[b]), max(order[a], order[b])) in matrices
    }
    for _ in range(3):
        if rows.shape[1] < _LEAST_TRACKS:
            return None
        rays = measured.rays[rows]
        factors = factorise(rays, chained_depths(rays, local, parents))
        error_px = factors.errors(rays) * scale_px
        limit = max(threshold_px, 3 * float(np.median(error_px)))
        good = (error_px < limit).all(axis=0) & (factors.depths > 0).all(axis=0)
        if good.all():
            break
        rows = rows[:, good]
    if not good.all() or float(np.median(error_px)) > threshold_px:
        return None
    return Block(order, measured.track[rows[0]], factors, float(np.median(error_px)))


def _depth_chain(
    images: tuple[int, ...], support: dict[tuple[int, int], int]
) -> tuple[list[int], list[int]] | None:
    """Images ordered along a tree of the best supported pairs, and the place of each one's parent."""
    within = {pair: count for pair, count in support.items() if pair[0] in images and pair[1] in images}
    if not within:
        return None
    order, parents = [max(sorted(within), key=lambda pair: within[pair])[0]], [0]
    while len(order) < len(images):
        edges = [
            (-count, order.index(a), b)
            for (x, y), count in within.items()
            for a, b in ((x, y), (y, x))
            if a in order and b not in order
        ]
        if not edges:
            return None
        _, parent, image = min(edges)
        order.append(image)
        parents.append(parent)
    return order, parents


def chained_depths(
    rays: FloatArray, fundamentals: dict[tuple[int, int], FloatArray], parents: list[int]
) -> FloatArray:
    """Depths of tracks that all images of a block see (thesis eq. 3.21), each from those of its parent.

    Parameters
    ----------
    rays : (s, n, 3) float64
        Homogeneous positions.
    fundamentals : dict
        ``qₐᵀ F q_b = 0`` by the places (a, b), a < b, of the images in the block.
    parents : list of int
        Place of the image from which each takes its depths, an earlier one; that of the first is not used.

    Returns
    -------
    (s, n) float64
        Up to a factor for each image; those of the first image are one.
    """
    depths = np.ones(rays.shape[:2])
    for place, parent in enumerate(parents[1:], start=1):
        swapped = parent < place
        matrix = fundamentals[min(place, parent), max(place, parent)]
        matrix = matrix.T if swapped else matrix
        ratio = depth_ratios(matrix, rays[place], rays[parent])
        depths[place] = ratio * depths[parent]
        depths[place] /= np.median(np.abs(depths[place]))
    return depths


def depth_ratios(fundamental: FloatArray, rays_1: FloatArray, rays_2: FloatArray) -> FloatArray:
    """λ₁/λ₂ (n,) of matches, up to a common factor (thesis eq. 3.21).

    ``λ₁ (e × q₁) = λ₂ F q₂`` with the epipole e of camera 2 in image 1, ``eᵀ F = 0``.
    """
    epipole = np.linalg.svd(fundamental)[0][:, 2]
    across = np.cross(epipole, rays_1)
    length = (across**2).sum(axis=1)
    along = (across * (rays_2 @ fundamental.T)).sum(axis=1)
    return np.asarray(along / np.maximum(length, np.finfo(np.float64).tiny))


@dataclass(frozen=True, eq=False)
class Factors:
    """``λᵢⱼ qᵢⱼ ≈ Pᵢ Xⱼ``: s cameras, n points.

    Attributes
    ----------
    cameras : (s, 3, 4) float64
        P, the 3s rows orthonormal in their four columns.
    points : (n, 4) float64
        X.
    depths : (s, n) float64
        λ, the third coordinate of ``P X``.
    """

    cameras: FloatArray
    points: FloatArray

    @property
    def depths(self) -> FloatArray:
        """λ, the third coordinate of ``P X``."""
        return np.asarray(self.cameras[:, 2] @ self.points.T)

    def errors(self, rays: FloatArray) -> FloatArray:
        """(s, n) distance of the projections from the positions, in the frames of the images."""
        projected = self.cameras @ self.points.T
        with np.errstate(all="ignore"):
            position = projected[:, :2] / projected[:, 2:]
        return np.asarray(np.linalg.norm(np.swapaxes(position, 1, 2) - rays[:, :, :2], axis=2))


def factorise(rays: FloatArray, depths: FloatArray, iterations: int = 30) -> Factors:
    """Cameras and points of tracks that all images see, the depths iterated until they settle.

    Parameters
    ----------
    rays : (s, n, 3) float64
        Homogeneous positions in normalised frames, the third coordinate one.
    depths : (s, n) float64
        Projective depths to begin with.
    iterations : int
        How often the depths are taken anew from the factors, at most.

    Returns
    -------
    Factors
        With depths that are positive for most points of every camera.
    """
    weights, previous = depths, None
    for _ in range(iterations + 1):
        weights = balanced_depths(rays, weights)
        cameras, points = _rank_four_factors(rays, weights)
        weights = np.einsum("sni,sni->sn", rays, np.einsum("sij,nj->sni", cameras, points)) / (rays**2).sum(2)
        if previous is not None and np.abs(weights - previous).max() < _SETTLED:
            break
        previous = weights
    return _with_positive_depths(cameras, points)


def balanced_depths(rays: FloatArray, depths: FloatArray, rounds: int = 3) -> FloatArray:
    """Depths scaled so that all columns, and all images, of the measurement matrix have the same norm."""
    square = (rays**2).sum(axis=2)
    scaled = depths
    for _ in range(rounds):
        scaled = scaled / np.sqrt((square * scaled**2).sum(axis=0, keepdims=True))
        scaled = scaled / np.sqrt((square * scaled**2).mean(axis=1, keepdims=True))
    return np.asarray(scaled)


def _rank_four_factors(rays: FloatArray, depths: FloatArray) -> tuple[FloatArray, FloatArray]:
    matrix = np.swapaxes(rays * depths[:, :, None], 1, 2).reshape(-1, rays.shape[1])
    basis = np.linalg.eigh(matrix @ matrix.T)[1][:, -4:]
    return basis.reshape(-1, 3, 4), matrix.T @ basis


def _with_positive_depths(cameras: FloatArray, points: FloatArray) -> Factors:
    """Turn the signs of cameras and points so that most depths are positive."""
    depths = cameras[:, 2] @ points.T
    camera_sign, point_sign = np.ones(len(cameras)), np.ones(len(points))
    for _ in range(5):
        point_sign = np.where((np.sign(depths) * camera_sign[:, None]).sum(axis=0) < 0, -1.0, 1.0)
        camera_sign = np.where((np.sign(depths) * point_sign).sum(axis=1) < 0, -1.0, 1.0)
    return Factors(cameras * camera_sign[:, None, None], points * point_sign[:, None])
