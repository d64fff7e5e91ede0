"""The thesis' uncalibrated adjustment: all entries of matrices and points, added to (eqs 3.30, 3.31, 3.34).

Twelve unknowns for each camera and four for each point, in the frame in which the scene is given; Hartley's
rule for λ (eq. 2.45), D = diag(JᵀJ), and a stop where an accepted step gains less than an absolute amount
(§2.2.2). `sfmcpp` moves points on the sphere, in a frame of its own. Here every camera sees every point.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import lstsq
from scipy.optimize import minimize_scalar

import sfmcpp
from sfmcpp.model.arrays import FloatArray

SEARCHES = 5  # steps that are searched, from the first on (thesis §4.4.3.2)
_FIRST_DAMPING, _LARGEST_DAMPING = 1e-3, 1e12
_LONGEST = 4.0
Lengths = tuple[float, float]


@dataclass(frozen=True)
class World:
    """Matrices (C, 3, 4) and points (N, 4), and steps of both."""

    cameras: FloatArray
    points: FloatArray

    def plus(self, step: World, lengths: Lengths = (1.0, 1.0)) -> World:
        """The world some lengths along a step."""
        return World(self.cameras + lengths[0] * step.cameras, self.points + lengths[1] * step.points)


@dataclass
class History:
    """Sum of squared errors after each step tried [px²]."""

    costs: list[float] = field(default_factory=list)


def world_of(problem: sfmcpp.Problem) -> tuple[World, FloatArray]:
    """A calibrated problem as matrices, points with a one, and pixels (C, N, 2)."""
    shape = (problem.num_cameras, problem.num_points)
    pixels = np.full((*shape, 2), np.nan)
    pixels[problem.camera_index, problem.point_index] = problem.pixels
    assert np.isfinite(pixels).all(), "a point is not seen by every camera"
    focal, aspect, x, y, skew = problem.intrinsics.T
    zero, one = np.zeros_like(focal), np.ones_like(focal)
    rows = [[focal, skew, x], [zero, aspect * focal, y], [zero, zero, one]]
    calibrations = np.moveaxis(np.array(rows), 2, 0)
    turns = np.swapaxes(problem.cameras[:, :, :3], 1, 2)
    moves = -turns @ problem.cameras[:, :, 3:]
    points = np.concatenate([problem.points, np.ones((shape[1], 1))], axis=1)
    return World(calibrations @ np.concatenate([turns, moves], axis=2), points), pixels


def adjust(world: World, pixels: FloatArray, search: str, gain_px2: float, max_steps: int) -> History:
    """Minimise from a world until a step gains less than that."""
    cost, damping = _cost(world, pixels), _FIRST_DAMPING
    history = History([cost])
    algebraic = Algebraic(pixels)
    while len(history.costs) <= max_steps and damping < _LARGEST_DAMPING:
        step = damped_step(world, pixels, damping)
        candidates = [(1.0, 1.0)]
        if len(history.costs) <= SEARCHES and np.isfinite(step.points).all():
            candidates += LINE_SEARCHES[search](world, step, pixels, algebraic)
        costs = [_cost(world.plus(step, lengths), pixels) for lengths in candidates]
        best = int(np.argmin(costs))
        gain = cost - costs[best]
        if gain > 0:
            world, cost, damping = world.plus(step, candidates[best]), costs[best], damping / 10
        else:
            damping *= 10
        history.costs.append(cost)
        if 0 <= gain < gain_px2:
            break
    return history


def _projected(world: World) -> FloatArray:
    return np.einsum("cij,nj->cni", world.cameras, world.points)


def _cost(world: World, pixels: FloatArray) -> float:
    image = _projected(world)
    with np.errstate(all="ignore"):
        cost = float(np.sum((image[..., :2] / image[..., 2:] - pixels) ** 2))
    return cost if np.isfinite(cost) else np.inf


def damped_step(world: World, pixels: FloatArray, damping: float) -> World:
    """Step of Levenberg and Marquardt, by the Schur complement of the points."""
    image = _projected(world)
    depths, seen = image[..., 2], image[..., :2] / image[..., 2:]
    residuals = seen - pixels
    shape = depths.shape
    by_camera = np.zeros((*shape, 2, 3, 4))
    rows = world.points[None] / depths[..., None]
    for k in range(2):
        by_camera[..., k, k, :] = rows
        by_camera[..., k, 2, :] = -seen[..., k, None] * rows
    by_camera = by_camera.reshape(*shape, 2, 12)
    matrices = world.cameras[:, None]
    by_point = (matrices[:, :, :2] - seen[..., None] * matrices[:, :, 2:]) / depths[..., None, None]
    u = _damped(np.einsum("cnka,cnkb->cab", by_camera, by_camera), damping)
    v = _damped(np.einsum("cnka,cnkb->nab", by_point, by_point), damping)
    w = np.einsum("cnka,cnkb->canb", by_camera, by_point).reshape(12 * shape[0], -1)
    inverse = np.linalg.inv(v)
    y = np.einsum("inb,nbd->ind", w.reshape(12 * shape[0], -1, 4), inverse).reshape(w.shape)
    to_cameras = -np.einsum("cnka,cnk->ca", by_camera, residuals).ravel()
    to_points = -np.einsum("cnka,cnk->na", by_point, residuals).ravel()
    reduced = -y @ w.T
    for c in range(shape[0]):
        reduced[12 * c : 12 * c + 12, 12 * c : 12 * c + 12] += u[c]
    cameras = _solved(reduced, to_cameras - y @ to_points)
    points = np.einsum("nab,nb->na", inverse, (to_points - w.T @ cameras).reshape(-1, 4))
    return World(cameras.reshape(-1, 3, 4), points)


def _damped(blocks: FloatArray, damping: float) -> FloatArray:
    diagonal = np.arange(blocks.shape[1])
    blocks[:, diagonal, diagonal] *= 1 + damping
    return blocks


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    """By columns of one length; what is singular to rounding gets the shortest answer, NaN without any."""
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
    scaled = scale[:, None] * matrix * scale
    if not (np.isfinite(scaled).all() and np.isfinite(right).all()):
        return np.full_like(right, np.nan)
    return np.asarray(scale * lstsq(scaled, scale * right, cond=1e-15, lapack_driver="gelsy")[0])


class Algebraic:
    """The algebraic residuals of normalised images along a step (eqs 4.3, 4.10 and 4.14)."""

    def __init__(self, pixels: FloatArray) -> None:
        centres = pixels.mean(axis=1, keepdims=True)
        away = pixels - centres
        size = np.linalg.norm(away, axis=2).mean(axis=1) / np.sqrt(2)
        self._normal = np.tile(np.eye(3), (len(pixels), 1, 1))
        self._normal[:, :2, 2], self._normal[:, 2, 2] = -centres[:, 0], size
        self._observed = np.concatenate([away, np.broadcast_to(size[:, None, None], (*away.shape[:2], 1))], 2)

    def residuals(self, cameras: FloatArray, points: FloatArray) -> FloatArray:
        """First two rows of q̂ × N P Q, all in one array."""
        x = np.einsum("cij,nj->cni", self._normal @ cameras, points)
        return np.cross(self._observed, x)[..., :2].ravel()

    def products(self, world: World, step: World) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """A, B_P, B_Q and C: the residual is A + α_P B_P + α_Q B_Q + α_P α_Q C."""
        cameras, points = (world.cameras, step.cameras), (world.points, step.points)
        a, b_q, b_p, c = (self.residuals(p, q) for p in cameras for q in points)
        return a, b_p, b_q, c


def _no_search(*_: object) -> Iterator[Lengths]:
    return iter(())


def _g_als(world: World, step: World, _: FloatArray, algebraic: Algebraic) -> Iterator[Lengths]:
    a, b_p, b_q, c = algebraic.products(world, step)
    b = b_p + b_q
    for root in _real_roots([2 * c @ c, 3 * b @ c, 2 * a @ c + b @ b, a @ b]):
        yield root, root


def _t_als(world: World, step: World, _: FloatArray, algebraic: Algebraic) -> Iterator[Lengths]:
    """Both partial derivatives vanish: α_Q = −u(α_P) / v(α_P), put into the other, is a quintic."""
    a, b_p, b_q, c = algebraic.products(world, step)
    u, v = [b_p @ c, b_p @ b_q + a @ c, a @ b_q], [c @ c, 2 * b_q @ c, b_q @ b_q]
    alone = np.polymul([b_p @ b_p, a @ b_p], np.polymul(v, v))
    mixed = np.polymul([2 * b_p @ c, b_p @ b_q + a @ c], np.polymul(u, v))
    square = np.polymul([c @ c, b_q @ c], np.polymul(u, u))
    for root in _real_roots(alone - mixed + square):
        yield root, -float(np.polyval(u, root) / np.polyval(v, root))


def _exact(world: World, step: World, pixels: FloatArray, _: Algebraic) -> Iterator[Lengths]:
    def along(length: float) -> float:
        return _cost(world.plus(step, (length, length)), pixels)

    length = float(minimize_scalar(along, bounds=(0.0, _LONGEST), method="bounded").x)
    yield length, length


def _real_roots(coefficients: list[float] | FloatArray) -> list[float]:
    roots = np.roots(np.asarray(coefficients, dtype=np.float64))
    return [float(root.real) for root in roots if abs(root.imag) <= 1e-9 * (1 + abs(root.real))]


LINE_SEARCHES: dict[str, Callable[..., Iterator[Lengths]]] = {
    "LM": _no_search,
    "LM+G-ALS": _g_als,
    "LM+T-ALS": _t_als,
    "LM+exact": _exact,
}
