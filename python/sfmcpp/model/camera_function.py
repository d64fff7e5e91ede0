"""User-defined camera models, as functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray, finite_array, require_double, shaped_array
from sfmcpp.model.checks import require_text

if TYPE_CHECKING:
    from sfmcpp.model.problem import Problem

Projection: TypeAlias = Callable[[FloatArray, FloatArray], ArrayLike]
Jacobians: TypeAlias = Callable[[FloatArray, FloatArray], tuple[ArrayLike, ArrayLike]]

_MOST_INTRINSICS = 12  # columns that a camera has room for beside those of its pose
# Central differences of a double are best at its third root; larger where the function is close to straight,
# as images are in intrinsics, and what high orders of a lens do to a pixel is little beside its rounding.
_STEP, _STRAIGHT_STEP = (float(np.finfo(float).eps ** power) for power in (1 / 3, 1 / 4))


@dataclass(frozen=True, eq=False)
class CameraFunction:
    """Your own camera model as a NumPy function, for ``Problem(camera_model=…)``.

    Poses are ``[R | c]`` as for other metric models; the function maps points in the frame of the camera, ``x
    = Rᵀ (X − c)``, to pixels. No point counts as behind the camera, and operations that need rays, matrices
    or files are refused. Each pass over the observations is one call, from the thread that called the solve;
    results do not depend on the number of threads.

    Parameters
    ----------
    project : callable
        Called as ``project(points, intrinsics)`` with the points (M, 3) of all observations and the
        intrinsics (M, K) of their cameras; returns pixels (M, 2), each row only from the same row of the
        arguments. These are copies, which it may change, and it may return the same array each time. NaN: the
        camera cannot see this point; a step that leads there is rejected. An exception ends the solve and is
        passed on; the problem then has the best state so far.
    intrinsics : sequence of str
        Names of the K intrinsic parameters, 1 to 12. The constraints ``focal`` and ``principal-point`` go by
        ``f``, ``cx`` and ``cy``.
    jacobians : callable, optional
        Called as `project` is; returns the derivatives of the pixels by points (M, 2, 3) and by intrinsics
        (M, 2, K). Default: central differences, of 2 (3 + K) calls of `project`. Check them with
        :func:`sfmcpp.check_jacobians`.
    name : str
        Its name in messages. Default: that of `project`.
    free_by_default : sequence of str
        Intrinsics that are free by default. Default: none.

    Raises
    ------
    InvalidArgument
        If a function is not callable, or a name is missing, unknown or duplicate. Return values are checked
        by the solve.
    """

    project: Projection
    intrinsics: tuple[str, ...]
    jacobians: Jacobians | None = None
    name: str = ""
    free_by_default: tuple[str, ...] = ()

    if TYPE_CHECKING:  # what is given need not be what is held

        def __init__(
            self,
            project: Projection,
            intrinsics: Sequence[str],
            jacobians: Jacobians | None = None,
            name: str = "",
            free_by_default: Sequence[str] = (),
        ) -> None: ...

    can_be_free = True
    metric = True
    point_size = 3

    def __post_init__(self) -> None:
        for label in ("project", "jacobians"):
            value = getattr(self, label)
            if not (callable(value) or (label == "jacobians" and value is None)):
                raise InvalidArgument(f"{label} = {value!r}: must be callable")
        object.__setattr__(self, "intrinsics", _names("intrinsics", self.intrinsics))
        if not 0 < len(self.intrinsics) <= _MOST_INTRINSICS:
            raise InvalidArgument(f"intrinsics = {self.intrinsics!r}: must be 1 to {_MOST_INTRINSICS} names")
        object.__setattr__(self, "free_by_default", _names("free_by_default", self.free_by_default))
        for name in self.free_by_default:
            if name not in self.intrinsics:
                raise InvalidArgument(f"free_by_default: {name!r} is none of {', '.join(self.intrinsics)}")
        require_text("name", self.name)
        object.__setattr__(self, "name", self.name or getattr(self.project, "__name__", "function"))

    def __repr__(self) -> str:
        return f"CameraFunction({self.name!r}: {', '.join(self.intrinsics)})"

    def evaluate(
        self, points: FloatArray, intrinsics: FloatArray, jacobians: bool
    ) -> tuple[FloatArray, FloatArray | None, FloatArray | None]:
        """Pixels and their derivatives.

        Parameters
        ----------
        points : (M, 3) float64
            In the frame of the camera.
        intrinsics : (M, K) float64
            Of the camera of each point.
        jacobians : bool
            Whether derivatives are wanted.

        Returns
        -------
        (M, 2) float64, (M, 2, 3) float64 or None, (M, 2, K) float64 or None

        Raises
        ------
        InvalidArgument
            If what a function returns has another shape or is of single precision, or a derivative that
            `jacobians` gives is no finite number.
        """
        pixels = self._pixels(points, intrinsics)
        if not jacobians:
            return pixels, None, None
        if self.jacobians is None:
            return pixels, *self._differences(points, intrinsics)
        count, label = len(points), f"camera_model {self.name!r}: derivatives"
        found: Any = self.jacobians(points.copy(), intrinsics.copy())
        if not isinstance(found, tuple | list) or len(found) != 2:
            raise InvalidArgument(f"{label}: must be two arrays, by points and by intrinsics")
        by_point, by_intrinsics = found
        require_double(label, by_point, by_intrinsics)
        return (
            pixels,
            finite_array(f"{label} by points", by_point, (count, 2, 3)).copy(),
            finite_array(f"{label} by intrinsics", by_intrinsics, (count, 2, len(self.intrinsics))).copy(),
        )

    def require_images(self, problem: Problem) -> None:
        """Raise InvalidArgument unless every observation of a problem has an image that is a number.

        Indices out of range are left to the checks of the problem.
        """
        if not _indices_fit(problem):
            return
        points, rows = _points_in_cameras(problem)
        self._require_numbers("gives no number for", self._pixels(points, rows).sum(axis=1), points)

    def require_derivatives(self, problem: Problem) -> None:
        """Raise InvalidArgument unless the derivatives of every observation are numbers."""
        points, rows = _points_in_cameras(problem)
        _, *found = self.evaluate(points, rows, jacobians=True)
        sums = np.sum([part.sum(axis=(1, 2)) for part in found if part is not None], axis=0)
        self._require_numbers("has no derivatives at", sums, points)

    def _require_numbers(self, fault: str, sums: FloatArray, points: FloatArray) -> None:
        """Raise InvalidArgument at the first observation whose sum is none; `points` are in their cameras."""
        (bad,) = np.nonzero(~np.isfinite(sums))
        if len(bad):
            k = int(bad[0])
            raise InvalidArgument(
                f"camera_model {self.name!r}: project {fault} observation {k}, of a point at "
                f"{points[k].tolist()} in its camera ({len(bad)} of {len(points)} observations)"
            )

    def change_when_repeated(self, problem: Problem) -> float:
        """How far the pixels of a second call are from the first's, over the largest."""
        if not _indices_fit(problem):
            return 0.0
        points, rows = _points_in_cameras(problem)
        first, again = self._pixels(points, rows), self._pixels(points, rows)
        largest = float(np.abs(first).max(initial=0.0))
        return float(np.abs(again - first).max(initial=0.0)) / largest if largest > 0 else 0.0

    def derivative_error(self, problem: Problem) -> float:
        """How far the derivatives that `jacobians` gives are from differences, at the state of a problem.

        Parameters
        ----------
        problem : Problem
            Its observations are what the function is given.

        Returns
        -------
        float
            The largest difference over the largest derivative by the same quantity; 0 without `jacobians` or
            observations, and where indices are out of range.

        Raises
        ------
        InvalidArgument
            As :meth:`evaluate`.
        """
        if self.jacobians is None or not _indices_fit(problem):
            return 0.0
        points, rows = _points_in_cameras(problem)
        _, *given = self.evaluate(points, rows, jacobians=True)
        errors = [0.0]
        for found, expected in zip(given, self._differences(points, rows), strict=True):
            assert found is not None
            largest = np.abs([found, expected]).max(axis=(0, 1, 2))  # of each quantity
            off = np.abs(found - expected).max(axis=(0, 1), initial=0.0)
            errors += list(off[largest > 0] / largest[largest > 0])
        return float(max(errors))

    def _pixels(self, points: FloatArray, intrinsics: FloatArray) -> FloatArray:
        label = f"camera_model {self.name!r}: project"
        found = self.project(points.copy(), intrinsics.copy())
        require_double(label, found)
        return np.array(shaped_array(label, found, (len(points), 2)))  # `project` may write into it again

    def _differences(self, points: FloatArray, intrinsics: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives by points and by intrinsics; NaN where no place beside a point has any either."""
        step = _STEP * np.linalg.norm(points, axis=1)
        found = self._differences_at(points, intrinsics, step)
        for k, sign in product(range(3), (-1, 1)):
            lost = ~np.isfinite(found[0].sum(axis=(1, 2)) + found[1].sum(axis=(1, 2)))
            if not lost.any():
                break
            beside = points.copy()
            beside[lost, k] += sign * step[lost]
            for kept, other in zip(found, self._differences_at(beside, intrinsics, step), strict=True):
                kept[lost] = other[lost]
        return found

    def _differences_at(
        self, points: FloatArray, intrinsics: FloatArray, step: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        here = self._pixels(points, intrinsics)
        by_point = [
            _difference(lambda x: self._pixels(x, intrinsics), here, points, k, step) for k in range(3)
        ]
        steps = _STRAIGHT_STEP * np.maximum(1.0, np.abs(intrinsics))
        by_intrinsics = [
            _difference(lambda x: self._pixels(points, x), here, intrinsics, k, steps[:, k])
            for k in range(len(self.intrinsics))
        ]
        return np.stack(by_point, axis=2), np.stack(by_intrinsics, axis=2)


def _difference(
    pixels: Callable[[FloatArray], FloatArray], here: FloatArray, values: FloatArray, k: int, step: FloatArray
) -> FloatArray:
    """∂pixels / ∂values[:, k]: central differences, or one-sided ones at the edge of an image."""
    images, places = [], []
    for sign in (1, -1):
        moved = values.copy()
        moved[:, k] += sign * step
        image = pixels(moved)
        seen = np.isfinite(image.sum(axis=1))
        images.append(np.where(seen[:, None], image, here))
        places.append(np.where(seen, moved[:, k], values[:, k]))  # as it was rounded
    with np.errstate(invalid="ignore"):  # seen from neither side: no number
        difference: FloatArray = (images[0] - images[1]) / (places[0] - places[1])[:, None]
    return difference


def _indices_fit(problem: Problem) -> bool:
    return all(
        index.size and 0 <= index.min() <= index.max() < size
        for index, size in (
            (problem.intrinsics_index, len(problem.intrinsics)),
            (problem.camera_index, problem.num_cameras),
            (problem.point_index, problem.num_points),
        )
    )


def _points_in_cameras(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """The point of each observation in the frame of its camera (M, 3), and its intrinsics (M, K)."""
    poses = problem.cameras[problem.camera_index]
    points = problem.points[problem.point_index] - poses[:, :, 3]
    rows = problem.intrinsics[problem.intrinsics_index[problem.camera_index]]
    return np.einsum("nji,nj->ni", poses[:, :, :3], points), rows


def _names(label: str, value: object) -> tuple[str, ...]:
    names = (value,) if isinstance(value, str) else value
    if not isinstance(names, tuple | list) or not all(isinstance(name, str) and name for name in names):
        raise InvalidArgument(f"{label} = {value!r}: must be names")
    for name in names:
        require_text(label, name)
    if len(set(names)) < len(names):
        raise InvalidArgument(f"{label} = {value!r}: a name is there twice")
    return tuple(names)
