"""What a linear model gives out: rows of constraints, covariances, its minimum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """The errors ``√(member weight) e`` of a group and their derivatives, without the weight of the group.

    Attributes
    ----------
    name : str
        Name of the group.
    weight : float
        Its weight w: the group costs ``½ w ‖errors‖²``.
    member : (R,) int32
        The member each row belongs to; members of weight zero have none.
    errors : (R,) float64
        Errors over the root of their number of entries (thesis table 5.1).
    data, indices, indptr : arrays
        Their derivatives by the columns of cameras, or, of residuals on points, by all columns; compressed
        by rows.
    columns : int
        Number of these columns.
    """

    name: str
    weight: float
    member: IndexArray
    errors: FloatArray
    data: FloatArray
    indices: IndexArray
    indptr: IndexArray
    columns: int

    @property
    def squared_error(self) -> float:
        """Σ (member weight) ε over the members: ``‖errors‖²``."""
        return float(self.errors @ self.errors)

    def jacobian(self) -> csr_matrix:
        """(R, columns) derivatives G of the errors, SciPy CSR."""
        from scipy.sparse import csr_matrix

        return csr_matrix((self.data, self.indices, self.indptr), shape=(len(self.errors), self.columns))


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariances for observations whose σ is exact.

    Attributes
    ----------
    cameras : (c, D, D) float64
        Of each chosen camera: pose, free intrinsics and, if any sensor of a rig is free, the pose of its
        sensor in the rig; zero for what has no column.
    points : (p, 3, 3) float64
        Of each chosen point; zero for a fixed one.
    joint : (c D + 3 p, c D + 3 p) float64 or None
        Of all together, the cameras first, if asked for.
    """

    cameras: FloatArray
    points: FloatArray
    joint: FloatArray | None


@dataclass(frozen=True, eq=False)
class LinearStep:
    """The minimum of a linear model.

    Attributes
    ----------
    problem : Problem
        The problem moved there: one undamped Gauss–Newton step.
    errors : list of (R,) float64
        What the model predicts of the errors of each group there.
    decrease : float
        What it predicts the cost to fall by.
    """

    problem: Problem
    errors: list[FloatArray]
    decrease: float


def moved_to_cameras(of_frames: Covariance, by_frame: FloatArray, by_sensor: FloatArray | None) -> Covariance:
    """Covariances with the poses of frames, and at the end of free sensors, moved to those of their cameras.

    By derivatives (c, 6, 6) of the poses of cameras by those of frames and, if any is free, of sensors.
    """
    count, size = of_frames.cameras.shape[:2]
    by_columns = np.tile(np.eye(size), (count, 1, 1))
    by_columns[:, :6, :6] = by_frame
    if by_sensor is not None:
        by_columns[:, :6, -6:] = by_sensor
    joint = of_frames.joint
    if joint is not None:
        rows = joint.copy()
        for _ in range(2):  # the rows, then the columns
            cameras = rows[: count * size].reshape(count, size, -1)
            rows[: count * size] = (by_columns @ cameras).reshape(count * size, -1)
            rows = rows.T
        joint = rows
    return Covariance(by_columns @ of_frames.cameras @ by_columns.transpose(0, 2, 1), of_frames.points, joint)
