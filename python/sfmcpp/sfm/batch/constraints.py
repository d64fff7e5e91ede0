"""Cameras in a common frame from overlapping blocks: closure constraints (Triggs 1997; Tardif et al. 2007).

The cameras of a block span a known space: ``(I − B Bᵀ) D P = 0``, with B (3s, 4) the basis of the block; D
has the scales of its cameras against those of the whole, and P (3C, 4) are all cameras. Scales come first,
from the depths of tracks that blocks share; P is then what all constraints together leave open.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sfmcpp.geometry.significance import SIGMA_OF_MEDIAN
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sfm.batch.blocks import Block
from sfmcpp.sfm.batch.measurements import Indices
from sfmcpp.sfm.tracks import connected_parts

_LEAST_COMMON = 4
_SCALE_ROUNDS, _CAMERA_ROUNDS = 4, 5
# A block whose constraint is off by more than this many times the usual loses weight.
_USUAL = 2.0
# Scatter of log depths below which it is rounding or luck, and of reprojection [px].
_LEAST_SCATTER, _LEAST_ERROR_PX = 1e-4, 0.05
# Standard deviation of a median of n over that of one, times that of one over their median distance.
_MEDIAN_SIGMA = 1.25 * SIGMA_OF_MEDIAN


@dataclass(frozen=True)
class _CameraInBlock:
    """A pair of images within a block."""

    block: int
    first: int
    second: int


@dataclass(frozen=True)
class _Equation:
    """``xₐ₁ − xₐ₂ − x_b₁ + x_b₂ = value ± sigma`` of the log scales of a pair of images in two blocks."""

    one: _CameraInBlock
    other: _CameraInBlock
    value: float
    sigma: float


def connected_blocks(blocks: list[Block]) -> tuple[list[Block], list[FloatArray]]:
    """Blocks that hang together, as many images as possible, and the scales (s,) of their cameras.

    With ``λᵢⱼ = αᵢ γⱼ λ*ᵢⱼ`` in every block, ``log λᵢⱼ − log λₖⱼ`` of two blocks differ by the same for all
    tracks: their medians are linear in ``log α``, which robust least squares solve for.
    """
    equations = _closure_equations(blocks)
    chosen = _largest_part(blocks, equations)
    number = {block: place for place, block in enumerate(chosen)}
    kept = [e for e in equations if e.one.block in number]
    return [blocks[block] for block in chosen], _scales([blocks[b] for b in chosen], kept, number)


def joint_cameras(blocks: list[Block], scales: list[FloatArray], num_images: int) -> FloatArray:
    """Cameras (C, 3, 4) by the constraints of all blocks, least squares with doubtful blocks down-weighted.

    Cameras of images that are in no block are not numbers.
    """
    from scipy.linalg import eigh

    images = np.unique(np.concatenate([block.images for block in blocks]))
    places = [np.searchsorted(images, block.images) for block in blocks]
    rows = [(3 * place[:, None] + np.arange(3)).ravel() for place in places]
    across = [_complement_projector(block, scale) for block, scale in zip(blocks, scales, strict=True)]
    prior = np.array([_stiffness(block) for block in blocks])
    weights, cameras = prior, np.empty((0, 4))
    for _ in range(_CAMERA_ROUNDS):
        normal = np.zeros((3 * len(images), 3 * len(images)))
        for row, matrix, weight in zip(rows, across, weights, strict=True):
            normal[np.ix_(row, row)] += weight**2 * matrix
        cameras = eigh(normal, subset_by_index=[0, 3])[1]
        off = [np.linalg.norm(matrix @ cameras[row]) for row, matrix in zip(rows, across, strict=True)]
        normalised = prior * np.array(off)
        weights = prior / np.maximum(1.0, normalised / (_USUAL * np.median(normalised) + 1e-300))
    result = np.full((num_images, 3, 4), np.nan)
    result[images] = cameras.reshape(-1, 3, 4)
    return result


def _closure_equations(blocks: list[Block]) -> list[_Equation]:
    """Compare the blocks of every pair of images, in the order of their numbers of tracks.

    The first with each of the others, and neighbours with each other.
    """
    holders: dict[tuple[int, int], list[_CameraInBlock]] = defaultdict(list)
    for number, block in enumerate(blocks):
        for i, first in enumerate(block.images):
            for k, second in enumerate(block.images):
                if first < second:
                    holders[first, second].append(_CameraInBlock(number, i, k))
    found = []
    for pair in sorted(holders):
        places = sorted(holders[pair], key=lambda place: -len(blocks[place.block].tracks))
        compared = [(places[0], other) for other in places[1:]]
        compared += pairwise(places[1:])
        found += [_closure_equation(blocks, one, other) for one, other in compared]
    return [equation for equation in found if equation is not None]


def _closure_equation(blocks: list[Block], one: _CameraInBlock, other: _CameraInBlock) -> _Equation | None:
    first, second = blocks[one.block], blocks[other.block]
    _, at_1, at_2 = np.intersect1d(first.tracks, second.tracks, assume_unique=True, return_indices=True)
    if len(at_1) < _LEAST_COMMON:
        return None
    depths_1, depths_2 = first.factors.depths[:, at_1], second.factors.depths[:, at_2]
    ratio_1 = depths_1[one.first] / depths_1[one.second]
    difference = np.log(ratio_1 / (depths_2[other.first] / depths_2[other.second]))
    middle = float(np.median(difference))
    scatter = max(float(np.median(np.abs(difference - middle))), _LEAST_SCATTER)
    return _Equation(one, other, middle, scatter * _MEDIAN_SIGMA / float(np.sqrt(len(at_1))))


def _largest_part(blocks: list[Block], equations: list[_Equation]) -> list[int]:
    """Numbers of the blocks that equations connect, of the part with the most images."""
    links = np.array([(e.one.block, e.other.block) for e in equations], dtype=np.intp).reshape(-1, 2)
    part = connected_parts(links, len(blocks))
    numbers = range(int(part.max()) + 1)
    images = [{i for b in np.flatnonzero(part == p) for i in blocks[b].images} for p in numbers]
    best = max(numbers, key=lambda p: (len(images[p]), int((part == p).sum()), -p))
    return [int(b) for b in np.flatnonzero(part == best)]


def _scales(blocks: list[Block], equations: list[_Equation], number: dict[int, int]) -> list[FloatArray]:
    """Scales of the cameras of each block, their geometric mean one, by robust least squares."""
    from scipy.sparse import csr_array
    from scipy.sparse.linalg import lsqr

    start = np.cumsum([0] + [len(block.images) for block in blocks])
    columns = np.array([_columns_of_block(equation, start, number) for equation in equations], dtype=np.int64)
    columns = columns.reshape(-1, 4)
    values, sigmas = (np.array([getattr(e, name) for e in equations]) for name in ("value", "sigma"))
    signs = np.array([1.0, -1.0, -1.0, 1.0])
    weights, logs = 1 / sigmas, np.zeros(start[-1])
    for _ in range(_SCALE_ROUNDS if equations else 0):
        data = (weights[:, None] * signs).ravel()
        pointers = 4 * np.arange(len(equations) + 1)
        system = csr_array((data, columns.ravel(), pointers), shape=(len(equations), start[-1]))
        logs = lsqr(system, weights * values, atol=1e-12, btol=1e-12, iter_lim=20_000)[0]
        weights = 1 / np.maximum(sigmas, np.abs(logs[columns] @ signs - values))
    return [np.exp(logs[a:b] - logs[a:b].mean()) for a, b in pairwise(start)]


def _columns_of_block(equation: _Equation, start: Indices, number: dict[int, int]) -> list[int]:
    one, other = equation.one, equation.other
    at_1, at_2 = start[number[one.block]], start[number[other.block]]
    return [at_1 + one.first, at_1 + one.second, at_2 + other.first, at_2 + other.second]


def _complement_projector(block: Block, scale: FloatArray) -> FloatArray:
    """(3s, 3s) projector on what is not in the block's space, its cameras scaled as those of the whole."""
    basis = np.linalg.qr((block.factors.cameras / scale[:, None, None]).reshape(-1, 4))[0]
    return np.asarray(np.eye(len(basis)) - basis @ basis.T)


def _stiffness(block: Block) -> float:
    """How well its points hold the space of its cameras: their smallest singular value over the error."""
    points = block.factors.points / np.linalg.norm(block.factors.points, axis=1, keepdims=True)
    smallest = np.sqrt(max(float(np.linalg.eigvalsh(points.T @ points)[0]), 0.0))
    return float(smallest / max(block.error_px, _LEAST_ERROR_PX))
