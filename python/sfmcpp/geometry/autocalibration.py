"""Autocalibration: plane at infinity and focal length of a projective reconstruction.

Cameras P of a projective reconstruction see the dual absolute quadric Q of the world as the dual image of the
absolute conic, ``K Kᵀ = P Q Pᵀ`` up to scale, and Q is of rank three. What is known of K holds Q: zero skew,
the aspect ratio and the principal point, or all of K. Linear solutions are where the search starts; cameras
that all look at one point from one distance, as those around a turntable may, leave them a quadric too many,
``diag(1, 1, 1, d)`` in the frame of that point, and only the rank decides: d = 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import ANY, FloatArray, finite_array
from sfmcpp.model.checks import require_one_of

FOCALS = ("shared", "varying", "known")

# Standard deviations of what is expected of K, in units of the typical focal length (Pollefeys et al. 2004):
# the focal length within a factor of three, the principal point within a tenth of the image; aspect ratio and
# skew are taken to be better known than there.
_SIGMA_FOCAL, _SIGMA_ASPECT, _SIGMA_SKEW, _SIGMA_CENTRE = 9.0, 0.02, 0.01, 0.1
# Focal lengths that are tried, in units of the typical one.
_TRIED_FOCALS = np.geomspace(0.25, 6.0, 10)
_FOCAL_RANGE = (0.1, 30.0)
# Deviation of a view's conic from the expected one, of norm √3, from which on it counts less.
_ROBUST_SCALE = 0.1
_MAX_STEPS, _ENOUGH = 60, 1e-10
# Least singular value over the largest of a matrix that has a rank of three.
_LEAST_RANK_RATIO = 1e-14
_SAME = 0.01
_UPPER = np.triu_indices(4)


@dataclass(frozen=True, eq=False)
class MetricFrame:
    """One way to see a projective world as a metric one.

    Attributes
    ----------
    homography : (4, 4) float64
        H of thesis eq. 3.43: cameras become ``P H``, points ``H⁻¹ Q``. Its world has the frame of one of the
        cameras; it may be mirrored, which only points can tell.
    focals : (C,) float64
        Focal length of each camera, as a multiple of that of its calibration.
    cost : float
        Robust sum of squared deviations of the cameras' conics from what is known of them.
    """

    homography: FloatArray
    focals: FloatArray
    cost: float


def metric_frames(
    projections: FloatArray, calibrations: FloatArray, *, focal: str = "shared"
) -> list[MetricFrame]:
    """Find the metric frames of a projective world (thesis §3.3.1.2).

    Starts are the linear solution (Triggs 1997), weighted by what is expected of cameras (Pollefeys et al.
    2004), its neighbours of rank three, and the linear planes at infinity of several focal lengths. Each is
    refined over the plane p and the focal length of thesis eq. 3.44. The result does not depend on the frame
    of the projective world, but for rounding.

    Parameters
    ----------
    projections : (C, 3, 4) float64
        Projection matrices to pixels, of any scale and sign.
    calibrations : (C, 3, 3) float64
        Upper triangular K of each camera. Where the focal length is unknown, K has a typical one in its
        place: the true one is ``K diag(φ, φ, 1)``, φ from 0.1 to 30.
    focal : {"shared", "varying", "known"}
        Whether φ is the same for all cameras, its own for each, or one.

    Returns
    -------
    list of MetricFrame
        Different ones, that of the least cost first; none if no start led anywhere.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, a matrix has no rank of three, the projections share a
        centre, or there are fewer than three cameras (two of known focal length).
    """
    require_one_of("focal", focal, FOCALS)
    matrices = finite_array("projections", projections, (ANY, 3, 4))
    kernels = finite_array("calibrations", calibrations, (len(matrices), 3, 3))
    fewest = 2 if focal == "known" else 3
    if len(matrices) < fewest:
        raise InvalidArgument(
            f"projections: {len(matrices)}, must be at least {fewest} with focal = {focal!r}"
        )
    _require_full_rank("calibrations", kernels)
    normalised = np.asarray(np.linalg.solve(kernels, matrices), dtype=np.float64)
    _require_full_rank("projections", normalised)
    cameras, world = _balanced(normalised)
    search = _Search(cameras, focal)
    found = [search.refine(start) for start in search.starts()]
    frames = [search.frame(x, cost, world) for cost, x in sorted(found, key=lambda pair: pair[0])]
    low, high = _FOCAL_RANGE
    inside = [f for f in frames if np.isfinite(f.cost) and low < f.focals.min() and f.focals.max() < high]
    return _distinct_frames(inside)


def _require_full_rank(name: str, matrices: FloatArray) -> None:
    """Raise InvalidArgument unless all matrices (C, 3, n) have a rank of three."""
    values = np.linalg.svd(matrices, compute_uv=False)
    full = values[:, 2] > _LEAST_RANK_RATIO * values[:, 0]
    if not full.all():
        raise InvalidArgument(f"{name}[{int(np.argmin(full))}]: must have a rank of three")


def _balanced(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Cameras of norm one in a frame of the world in which ``Σ PᵀP`` is the identity times a factor.

    Such a frame is unique up to a rotation: what is computed there does not depend on the frame given.
    """
    world = np.eye(4)
    cameras = matrices
    for _ in range(50):
        cameras = cameras / np.linalg.norm(cameras, axis=(1, 2))[:, None, None]
        values, vectors = np.linalg.eigh(np.einsum("nij,nik->jk", cameras, cameras) * (4 / len(cameras)))
        if not values[0] > 1e-14 * values[3]:
            raise InvalidArgument("projections: share a centre or lack the rank of three: no depth is seen")
        step = vectors / np.sqrt(values)
        cameras, world = cameras @ step, world @ step
        if values[3] < (1 + 1e-10) * values[0]:
            break
    return cameras / np.linalg.norm(cameras, axis=(1, 2))[:, None, None], world


def _distinct_frames(frames: list[MetricFrame]) -> list[MetricFrame]:
    """The frames without those that a better one resembles in cost and focal length, or in the plane."""
    kept: list[MetricFrame] = []
    for frame in frames:
        if not any(_are_similar(frame, other) for other in kept):
            kept.append(frame)
    return kept


def _are_similar(a: MetricFrame, b: MetricFrame) -> bool:
    planes = [np.linalg.inv(f.homography)[3] for f in (a, b)]
    cosine = abs(planes[0] @ planes[1]) / np.prod(np.linalg.norm(planes, axis=1))
    return bool(np.allclose(a.focals, b.focals, rtol=_SAME) and cosine > 1 - _SAME**2)


class _Search:
    """The cost of metric frames over ``(log φ, p)`` of the camera in the middle, and its descent.

    Attributes
    ----------
    cameras : (C, 3, 4) float64
        Balanced, to normalised image points of the typical focal length.
    """

    def __init__(self, cameras: FloatArray, focal: str) -> None:
        self.cameras = cameras
        self._focal = focal
        reference = cameras[len(cameras) // 2]
        centre = np.linalg.svd(reference)[2][3]
        # The frame in which the reference camera is [I | 0].
        self._frame = np.column_stack([np.linalg.pinv(reference), centre])

    def starts(self) -> Iterator[FloatArray]:
        """Unknowns to start from."""
        known = self._focal == "known"
        for plane in _planes_at_infinity(_linear_quadrics(self.cameras, known)):
            yield from (self._unknowns(focal, plane) for focal in ((1.0,) if known else (0.4, 1.0, 2.5)))
        for focal in () if known else _TRIED_FOCALS:
            scaled = self.cameras / np.array([focal, focal, 1.0])[:, None]
            yield self._unknowns(focal, _planes_at_infinity(_linear_quadrics(scaled, True))[0])

    def _unknowns(self, focal: float, plane: FloatArray) -> FloatArray:
        """``(log φ, −Kᵀ p)`` of a plane at infinity: the second row of H in thesis eq. 3.44."""
        in_frame = self._frame.T @ plane
        p = in_frame[:3] / np.copysign(max(abs(in_frame[3]), 1e-6 * np.linalg.norm(in_frame)), in_frame[3])
        row = -p * np.array([focal, focal, 1.0])
        return row if self._focal == "known" else np.concatenate([[np.log(focal)], row])

    def _homography(self, x: FloatArray) -> FloatArray:
        """H of thesis eq. 3.44 after the frame of the reference camera."""
        focal = 1.0 if self._focal == "known" else np.exp(x[0])
        inner = np.diag([focal, focal, 1.0, 1.0])
        inner[3, :3] = x[-3:]
        return np.asarray(self._frame @ inner)

    def _conics(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(C, 3, 3) dual images of the absolute conic, and (C,) the focal length of each camera."""
        affine = self.cameras @ self._homography(x)[:, :3]
        conics = affine @ np.swapaxes(affine, 1, 2)
        if self._focal == "varying":
            with np.errstate(all="ignore"):
                focals = np.sqrt((conics[:, 0, 0] + conics[:, 1, 1]) / (2 * conics[:, 2, 2]))
        else:
            focals = np.full(len(conics), 1.0 if self._focal == "known" else np.exp(x[0]))
        return conics, focals

    def _deviations(self, x: FloatArray) -> FloatArray:
        """(C, 6) each conic in units of its focal length and of trace three, less the identity."""
        conics, focals = self._conics(x)
        scales = np.stack([1 / focals, 1 / focals, np.ones_like(focals)], axis=1)
        conics = conics * scales[:, :, None] * scales[:, None, :]
        conics = conics * (3 / np.trace(conics, axis1=1, axis2=2))[:, None, None] - np.eye(3)
        off = np.sqrt(2.0) * conics[:, (0, 0, 1), (1, 2, 2)]
        return np.concatenate([conics[:, (0, 1, 2), (0, 1, 2)], off], axis=1)

    def refine(self, x: FloatArray) -> tuple[float, FloatArray]:
        """Levenberg–Marquardt on the robust cost: where it ends, after its cost."""
        with np.errstate(all="ignore"):
            cost, left, right = self._model(x)
            damping = 1e-3
            for _ in range(_MAX_STEPS):
                if not np.isfinite(cost):
                    break
                held = left + damping * np.diag(np.diag(left) + 1e-12 * np.trace(left))
                candidate = x - np.linalg.solve(held, right)
                candidate_cost = _robust_cost(self._deviations(candidate))
                if not candidate_cost < cost:
                    damping *= 10
                    if damping > 1e10:
                        break
                    continue
                settled = cost - candidate_cost <= _ENOUGH * cost
                x, damping = candidate, max(damping / 10, 1e-12)
                cost, left, right = self._model(x)
                if settled:
                    break
        return (cost if np.isfinite(cost) else np.inf), x

    def _model(self, x: FloatArray) -> tuple[float, FloatArray, FloatArray]:
        """Cost, normal matrix and gradient, derivatives by central differences."""
        here = self._deviations(x)
        steps = 1e-6 * np.maximum(np.abs(x), 1e-3) * np.eye(len(x))
        slopes = [(self._deviations(x + s) - self._deviations(x - s)) / (2 * s.sum()) for s in steps]
        jacobian = np.stack(slopes, axis=2)
        weights = 1 / np.sqrt(1 + (here**2).sum(axis=1) / _ROBUST_SCALE**2)
        left = np.einsum("c,cri,crj->ij", weights, jacobian, jacobian)
        return _robust_cost(here), left, np.einsum("c,cri,cr->i", weights, jacobian, here)

    def frame(self, x: FloatArray, cost: float, world: FloatArray) -> MetricFrame:
        """The metric frame of what was found."""
        return MetricFrame(world @ self._homography(x), self._conics(x)[1], cost)


def _robust_cost(deviations: FloatArray) -> float:
    """Σ over the views of what is a square near zero and grows like the deviation far from it."""
    squares = (deviations**2).sum(axis=1) / _ROBUST_SCALE**2
    return float(_ROBUST_SCALE**2 * np.sum(np.sqrt(1 + squares) - 1))


def _linear_quadrics(cameras: FloatArray, known: bool) -> tuple[FloatArray, FloatArray]:
    """The two symmetric (4, 4) quadrics that fit linearly best, the best first.

    Each camera is divided by its scale, the entry (3, 3) of its conic, as the solution before tells it.
    """
    equations = _equations(cameras, known)
    depth = _quadric_products(cameras, 2, 2)
    scale = np.ones(len(cameras))
    for _ in range(6):
        weighted = equations / scale[:, None, None]
        vectors = np.linalg.eigh(np.einsum("cri,crj->ij", weighted, weighted))[1]
        new = np.abs(depth @ vectors[:, 0])
        new = np.maximum(new, 1e-3 * np.median(new))
        if not new.mean() > 0:
            break
        new = new / new.mean()
        if np.allclose(new, scale, rtol=1e-3):
            break
        scale = new
    return _symmetric(vectors[:, 0]), _symmetric(vectors[:, 1])


def _equations(cameras: FloatArray, known: bool) -> FloatArray:
    """(C, 6, 10) coefficients of what vanishes, over its standard deviation."""
    xx, yy, ww = (_quadric_products(cameras, k, k) for k in range(3))
    xy, xw, yw = (_quadric_products(cameras, a, b) for a, b in ((0, 1), (0, 2), (1, 2)))
    rows = np.stack([xx - ww, yy - ww, xx - yy, xy, xw, yw], axis=1)
    if known:
        return rows
    sigmas = [_SIGMA_FOCAL, _SIGMA_FOCAL, _SIGMA_ASPECT, _SIGMA_SKEW, _SIGMA_CENTRE, _SIGMA_CENTRE]
    return np.asarray(rows / np.array(sigmas)[:, None])


def _quadric_products(cameras: FloatArray, a: int, b: int) -> FloatArray:
    """(C, 10) coefficients of ``p_a Q p_bᵀ`` by the upper triangle of Q."""
    outer = np.einsum("ci,cj->cij", cameras[:, a], cameras[:, b])
    upper = (outer + np.swapaxes(outer, 1, 2))[:, _UPPER[0], _UPPER[1]]
    return np.asarray(np.where(_UPPER[0] == _UPPER[1], 0.5, 1.0) * upper)


def _symmetric(upper: FloatArray) -> FloatArray:
    matrix = np.zeros((4, 4))
    matrix[_UPPER] = upper
    return np.asarray(matrix + matrix.T - np.diag(np.diag(matrix)))


def _planes_at_infinity(quadrics: tuple[FloatArray, FloatArray]) -> list[FloatArray]:
    """Planes at infinity: null vectors of the first, and of its sums with the second that are singular."""
    first, second = quadrics
    at = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    determinants = np.linalg.det(first + at[:, None, None] * second)
    roots = np.roots(np.polyfit(at, determinants, 4))
    real = sorted(root.real for root in roots if abs(root.imag) < 1e-3 * (1 + abs(root)))
    return [_null_vector(first), *(_null_vector(first + root * second) for root in real)]


def _null_vector(quadric: FloatArray) -> FloatArray:
    values, vectors = np.linalg.eigh(quadric)
    return np.asarray(vectors[:, np.argmin(np.abs(values))])
