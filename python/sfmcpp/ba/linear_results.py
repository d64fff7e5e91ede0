"""Results of a linear model: constraint rows, covariances, its minimum; errors name undetermined cameras."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.wording import first_few

if TYPE_CHECKING:
    from scipy.sparse import bsr_matrix, csr_matrix

Method = TypeVar("Method", bound=Callable[..., Any])
_COLUMN = re.compile(r"column (\d+) of a camera: ")
_SINGULAR = "normal equations are singular"
# Least eigenvalue of a block with a unit diagonal that is more than rounding.
_RANK_TOLERANCE = 1e-12
_MOST_NAMED = 8


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

    @classmethod
    def of(cls, problem: Problem, found: dict[str, Any]) -> LinearStep:
        """Of what the core has found."""
        before = {name: getattr(problem, name) for name in ("cameras", "intrinsics", "points")}
        moved: dict[str, Any] = {name: found[name].reshape(x.shape) for name, x in before.items()}
        if problem.rigs is not None:
            sensors = found["rig_sensors"].reshape(problem.rigs.sensors.shape)
            moved["rigs"] = replace(problem.rigs, sensors=sensors)
        return cls(replace(problem, **moved), found["errors"], found["decrease"])


def moved_to_cameras(of_frames: Covariance, by_frame: FloatArray, by_sensor: FloatArray | None) -> Covariance:
    """Propagate covariances of the poses of frames and free sensors to the poses of their cameras.

    Parameters
    ----------
    of_frames : Covariance
        Blocks begin with the pose of the frame and end with that of the sensor, if any sensor is free.
    by_frame, by_sensor : (c, 6, 6) float64
        Derivatives of the poses of the cameras by those of frames and of sensors; None: no sensor is free.

    Returns
    -------
    Covariance
        The same with poses of cameras.
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


class ColumnsOfCameras(Protocol):
    """What errors of a linear model are explained by: its columns, their names, and its normal matrix."""

    camera_columns: IndexArray

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the D parameters of a camera."""

    def normal_matrix(self) -> csr_matrix:
        """(columns, columns) normal matrix."""


def with_camera_names(method: Method) -> Method:
    """Let a method of a linear model name the cameras that are meant where it fails."""

    @wraps(method)
    def call(self: ColumnsOfCameras, *arguments: Any, **named: Any) -> Any:
        try:
            return method(self, *arguments, **named)
        except InvalidArgument as error:
            raise InvalidArgument(_with_cameras(str(error), self)) from error

    return cast(Method, call)


def _with_cameras(text: str, model: ColumnsOfCameras) -> str:
    column = _COLUMN.match(text)
    if column is not None:
        camera, parameter = np.argwhere(model.camera_columns == int(column[1]))[0].tolist()
        return f"camera {camera}, {model.parameter_names[parameter]}: {text[column.end() :]}"
    if _SINGULAR in text and (weak := _undetermined_cameras(model)):
        shown = first_few(map(str, weak), _MOST_NAMED)
        number = "cameras" if len(weak) > 1 else "camera"
        return f"{text}; {number} {shown} would be undetermined even if all points were known"
    return text


def _undetermined_cameras(model: ColumnsOfCameras) -> list[int]:
    """Cameras whose own block of the normal matrix, the points given, is singular."""
    normal = model.normal_matrix()
    found = []
    for camera, columns in enumerate(model.camera_columns):
        own = columns[columns >= 0]
        block = normal[own][:, own].toarray()
        diagonal = np.diagonal(block)
        if len(own) and (diagonal.min() <= 0 or _least_eigenvalue(block, diagonal) < _RANK_TOLERANCE):
            found.append(camera)
    return found


def sparse_jacobian(
    entries: FloatArray, by_camera: IndexArray, by_point: IndexArray, columns: int
) -> csr_matrix:
    """(2 M, columns) of blocks (M, 2, D + 3), in the columns (M, D) of cameras and from (M,) on of points."""
    from scipy.sparse import csr_matrix

    of_points = np.where(by_point[:, None] < 0, -1, by_point[:, None] + np.arange(3))
    places = np.concatenate([by_camera, of_points], axis=1)
    places = np.broadcast_to(places[:, None], entries.shape)
    rows = np.broadcast_to(np.arange(2 * len(entries)).reshape(-1, 2, 1), entries.shape)
    kept = places >= 0
    return csr_matrix((entries[kept], (rows[kept], places[kept])), shape=(2 * len(entries), columns))


def without_points(
    normal: csr_matrix, gradient: FloatArray, c: int, points: NDArray[np.intp], damping: float
) -> tuple[FloatArray, FloatArray]:
    """Schur complement (c, c) and right-hand side of damped normal equations without these points."""
    from scipy.sparse import diags

    damped = (normal + damping * diags(normal.diagonal())).tocsr()
    inverse = _inverse_of_points(damped[c:, c:].tobsr((3, 3)), points)
    across = damped[:c, c:] @ inverse
    matrix = damped[:c, :c].toarray() - (across @ damped[c:, :c]).toarray()
    return matrix, -gradient[:c] + across @ gradient[c:]


def _inverse_of_points(blocks: bsr_matrix, points: NDArray[np.intp]) -> bsr_matrix:
    """Inverse of the blocks (3, 3) of some points; one that is singular but for rounding is refused."""
    diagonals = np.diagonal(blocks.data, axis1=1, axis2=2)
    scale = 1 / np.sqrt(np.where(diagonals > 0, diagonals, 1.0))
    least = np.linalg.eigvalsh(scale[:, :, None] * blocks.data * scale[:, None, :])[:, 0]
    singular = np.flatnonzero(least < _RANK_TOLERANCE)
    if len(singular):
        point = points[np.searchsorted(blocks.indptr, singular[0], side="right") - 1]
        raise InvalidArgument(
            f"points[{point}]: its block is singular to working accuracy; damping > 0 is needed "
            f"({len(singular):,} such points)"
        )
    return type(blocks)((np.linalg.inv(blocks.data), blocks.indices, blocks.indptr), blocks.shape)


def _least_eigenvalue(block: np.ndarray, diagonal: np.ndarray) -> float:
    scale = 1 / np.sqrt(diagonal)
    return float(np.linalg.eigvalsh(scale[:, None] * block * scale)[0])
