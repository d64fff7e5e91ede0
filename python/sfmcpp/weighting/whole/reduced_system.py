"""The normal equations of a whole problem with its points eliminated, and what their inverse tells.

With J the Jacobian of the observations and G the rows of the constraints, ``H = JᵀJ + GᵀG``. Points have
constraints neither among themselves nor with a sensor, so that the Schur complement on the cameras is
``S = S_images + GᵀG``: it is gathered once, and any rows are added to it. Everything is dense, for a few
thousand columns; NumPy alone.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray
from sfmcpp.weighting.whole.image_jacobian import ImageJacobian

Indices = NDArray[np.signedinteger[Any]]

MAX_COLUMNS = 4000
# Points whose columns are in memory together.
_CHUNK = 512
# Share of the diagonal that is added to it: holds the gauge, which no residual feels, without large numbers
# that cancel; and points that one camera sees.
_RIDGE = 1e-10
_POINT_RIDGE = 1e-12
# Stiffness, as a share of the diagonal, below which the images do not feel a motion of the world.
_FREE = 1e-9


@dataclass(frozen=True)
class Chunk:
    """Some points with their observations.

    Attributes
    ----------
    observations : (m,) int
        Observations of the points.
    points : (m,) int
        The point of each, numbered from 0 within the chunk.
    columns : (c,) int
        Camera columns that see any of the points.
    coupling : (c, 3 P) float64
        ``J_cᵀ J_p L⁻ᵀ`` with ``V = L Lᵀ`` the block of a point.
    """

    observations: Indices
    points: Indices
    columns: Indices
    coupling: FloatArray


@dataclass(frozen=True)
class Inverse:
    """The inverse of a reduced system.

    Attributes
    ----------
    covariance : (n, n) float64
        Covariance of the cameras for observations of unit variance; where nothing is determined, as in the
        gauge, large and of no meaning.
    parameters : float
        How many parameters of cameras and points are determined: the trace of ``H⁻¹ H``.
    log_determinant : float
        Of the reduced system; that of H but for what no weight changes.
    """

    covariance: FloatArray
    parameters: float
    log_determinant: float


class ReducedSystem:
    """The Schur complement on the cameras of weighted observations.

    Parameters
    ----------
    jacobian : ImageJacobian
        Derivatives of the observations.
    counts : (M,) float64
        How much each observation counts: ρ′ of a robust loss.

    Raises
    ------
    InvalidArgument
        If there are more than `MAX_COLUMNS` columns.
    """

    def __init__(self, jacobian: ImageJacobian, counts: FloatArray) -> None:
        self.columns = jacobian.cameras.count
        if self.columns > MAX_COLUMNS:
            raise InvalidArgument(
                f"problem: {self.columns} free parameters of cameras, must be at most {MAX_COLUMNS} for "
                "a weight chosen by 'variance' or 'loo-approx'"
            )
        root = np.sqrt(counts)[:, None, None]
        self._by_camera = jacobian.by_camera * root
        self._camera_columns = jacobian.columns
        self._camera_index = jacobian.camera_index
        self._point_index = jacobian.point_index
        self._motions = jacobian.motions
        self._by_point, self.point_parameters = self._whitened(jacobian.by_point * root)
        self.images = self._gather()

    def _whitened(self, by_point: FloatArray) -> tuple[FloatArray, float]:
        """``J_p L⁻ᵀ``, and how many parameters of points the observations determine."""
        count = int(self._point_index.max(initial=-1)) + 1
        normal = _sums(self._point_index, np.swapaxes(by_point, 1, 2) @ by_point, count)
        scale = np.trace(normal, axis1=1, axis2=2)
        ridge = np.where(scale > 0, _POINT_RIDGE * scale, 1.0)[:, None, None] * np.eye(3)
        inverse_root = np.linalg.inv(np.linalg.cholesky(normal + ridge))
        determined = inverse_root @ normal @ np.swapaxes(inverse_root, 1, 2)
        white = by_point @ np.swapaxes(inverse_root, 1, 2)[self._point_index]
        return white, float(np.trace(determined, axis1=1, axis2=2).sum())

    def _gather(self) -> FloatArray:
        """``S_images = Σ J_cᵀ J_c − Σ Y Yᵀ`` with the coupling Y of each chunk."""
        full = np.zeros((self.columns + 1, self.columns + 1))
        cameras, first, numbers = np.unique(self._camera_index, return_index=True, return_inverse=True)
        blocks = _sums(numbers, np.swapaxes(self._by_camera, 1, 2) @ self._by_camera, len(cameras))
        columns = self._camera_columns[first]
        np.add.at(full, (columns[:, :, None], columns[:, None, :]), blocks)
        for chunk in self.chunks():
            full[np.ix_(chunk.columns, chunk.columns)] -= chunk.coupling @ chunk.coupling.T
        return full[: self.columns, : self.columns]

    def chunks(self) -> Iterator[Chunk]:
        """Points in the order of their first cameras, with their couplings to the cameras."""
        first = np.full(int(self._point_index.max(initial=-1)) + 1, np.iinfo(np.int32).max)
        np.minimum.at(first, self._point_index, self._camera_index)
        place = np.empty_like(first)
        place[np.argsort(first, kind="stable")] = np.arange(len(first))
        places = place[self._point_index]
        order = np.argsort(places, kind="stable")
        bounds = np.searchsorted(places[order], np.arange(0, len(first) + _CHUNK, _CHUNK))
        for begin, end in itertools.pairwise(bounds):
            if end > begin:
                yield self._chunk(order[begin:end], places[order[begin:end]] % _CHUNK)

    def _chunk(self, chosen: Indices, points: Indices) -> Chunk:
        used = np.zeros(self.columns + 1, dtype=np.int64)
        used[self._camera_columns[chosen]] = 1
        columns, rows = np.flatnonzero(used), (np.cumsum(used) - 1)[self._camera_columns[chosen]]
        entries = np.swapaxes(self._by_camera[chosen], 1, 2) @ self._by_point[chosen]
        count = int(points.max()) + 1
        coupling = _sums(rows * count + points[:, None], entries, len(columns) * count)
        return Chunk(chosen, points, columns, coupling.reshape(len(columns), -1))

    def inverse(self, rows: FloatArray) -> Inverse:
        """Invert ``S_images + GᵀG``.

        Parameters
        ----------
        rows : (R, n) float64
            G, the rows of all constraints, times the roots of their weights.

        Returns
        -------
        Inverse
            The inverse and what belongs to it.
        """
        held = np.diag(self.images)
        ridge = np.where(held > 0, _RIDGE * held, 1.0)
        system = self.images + rows.T @ rows + np.diag(ridge)
        root = np.sqrt(np.diag(system))
        unit = system / np.outer(root, root)
        inverse = np.linalg.inv(unit) / np.outer(root, root)
        determined = self.columns - float(ridge @ np.diag(inverse)) + self.point_parameters
        log_determinant = float(np.linalg.slogdet(unit)[1] + 2 * np.log(root).sum())
        return Inverse(inverse, determined, log_determinant)

    def leverages(self, inverse: FloatArray) -> FloatArray:
        """How much each observation draws the fit to itself: ``J_o H⁻¹ J_oᵀ``.

        No observation feels a motion of the world: that part of the covariance, large where the sensor is
        weak, is taken out before it has to cancel.

        Parameters
        ----------
        inverse : (n, n) float64
            From :meth:`inverse`.

        Returns
        -------
        (M, 2, 2) float64
            Their traces add up to the parameters that the observations determine, less what constraints did.
        """
        covariance = np.pad(self._without_gauge(inverse), (0, 1))
        found = np.empty((len(self._by_camera), 2, 2))
        for chunk in self.chunks():
            found[chunk.observations] = self._leverages_of(chunk, covariance)
        return found

    def _without_gauge(self, covariance: FloatArray) -> FloatArray:
        """``Q C Qᵀ`` with Q the projection along the motions of the world that the images leave free."""
        root = np.sqrt(np.diag(self.images))[:, None]
        motions = np.linalg.qr(root * self._motions)[0]
        stiffness, turned = np.linalg.eigh(motions.T @ (self.images / (root * root.T)) @ motions)
        free = motions @ turned[:, stiffness < _FREE]
        scaled = covariance * (root * root.T)
        scaled -= free @ (free.T @ scaled)
        scaled -= (scaled @ free) @ free.T
        return np.asarray(scaled / (root * root.T))

    def _leverages_of(self, chunk: Chunk, covariance: FloatArray) -> FloatArray:
        camera, point = self._by_camera[chunk.observations], self._by_point[chunk.observations]
        columns = self._camera_columns[chunk.observations]
        seen = covariance[np.ix_(chunk.columns, chunk.columns)] @ chunk.coupling
        width = len(chunk.columns)
        by_point = seen.reshape(width, -1, 3)
        shared = np.einsum("cpi,cpj->pij", chunk.coupling.reshape(width, -1, 3), by_point) + np.eye(3)
        rows = np.searchsorted(chunk.columns, columns)
        own = covariance[columns[:, :, None], columns[:, None, :]]
        cross = camera @ by_point[rows, chunk.points[:, None]] @ np.swapaxes(point, 1, 2)
        return np.asarray(
            camera @ own @ np.swapaxes(camera, 1, 2)
            + point @ shared[chunk.points] @ np.swapaxes(point, 1, 2)
            - cross
            - np.swapaxes(cross, 1, 2)
        )


def _sums(index: Indices, values: FloatArray, count: int) -> FloatArray:
    """Sums of the values of each index, in their order: ``np.add.at``, many times as fast."""
    shape = values.shape[index.ndim :]
    size = int(np.prod(shape))
    places = index.reshape(-1, 1).astype(np.int64) * size + np.arange(size)
    sums = np.bincount(places.ravel(), values.ravel(), count * size)
    return np.asarray(sums.reshape(count, *shape), dtype=np.float64)
