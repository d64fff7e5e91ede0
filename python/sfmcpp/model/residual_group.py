"""User-defined residuals of poses and points, in named groups."""

from __future__ import annotations

import reprlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import check_fields
from sfmcpp.model.arrays import (
    ANY,
    FloatArray,
    IndexArray,
    as_stored,
    finite_array,
    number_array,
    require_double,
    require_int32,
)
from sfmcpp.model.central_differences import by_point, by_pose
from sfmcpp.model.constraints import ConstraintGroup, MemberGroup
from sfmcpp.model.loss_function import LossFunction
from sfmcpp.model.problem import Problem

ResidualFunction: TypeAlias = Callable[..., "ArrayLike | tuple[ArrayLike, ...]"]


class Evaluation(NamedTuple):
    """Residuals of the members of a group, and their derivatives if requested.

    Attributes
    ----------
    residuals : (n, k) float64
        r of each member.
    by_poses : (n, k, p, 6) float64 or None
        Derivatives by the poses of each member, p = 1 or 2: δR, then the centre. None without cameras.
    by_point : (n, k, 3) float64 or None
        Derivatives by the point of each member. None without points.
    """

    residuals: FloatArray
    by_poses: FloatArray | None = None
    by_point: FloatArray | None = None


@dataclass(eq=False)
class ResidualGroup(MemberGroup):
    """User-defined residuals of poses, points or both, computed by a NumPy function and added to the cost.

    In :func:`sfmcpp.solve` the group adds ``½ Σ ρ(weight · member_weights · ‖r‖²)`` to the cost. For a sensor
    of standard deviation σ return ``r = error / σ``, as observations are divided by theirs.

    Parameters
    ----------
    function : callable
        Called once for all members. Its arguments are the poses (n, 3, 4) of `cameras` (n,), or (n, 2, 3, 4)
        of pairs (n, 2), each with rotation world_from_camera and centre in the world, and the world
        coordinates (n, 3) of `points` (n,); with both, poses come first. Returns residuals r (n, k),
        optionally with derivatives: (n, k, 6) or (n, k, 2, 6) by δR of ``R exp([δR]×)`` [rad] and the centre,
        and (n, k, 3) by the point, as ``r, by_pose``, ``r, by_point`` or ``r, by_pose, by_point``. Without
        derivatives it is called twelve times for each camera of a member and six times for its point, for
        central differences. The result must depend on the arguments only; these are copies, which it may
        change, and it may return the same array each time. An exception ends the solve and is passed on; the
        problem then holds the best state so far.
    cameras : (n,) or (n, 2) int32, optional
        The camera of each member, or a pair of cameras. Default: none, with `points`.
    weight : float
        Weight of the group.
    member_weights : (n,) float64, optional
        Weight of each member. Default: 1.
    name : str
        Name of the group in summaries and messages, unique in a solve. Default: that of the function.
    loss : str or LossFunction
        Robust loss ρ: ``"squared"`` (none), ``"huber"``, ``"cauchy"``, ``"tukey"``, ``"geman-mcclure"`` or
        ``"truncated"``, or one of your own.
    loss_scale : float, optional
        Residual at which the loss leaves the parabola, in units of r. Default: 95 % efficiency on normal
        errors; 1 for your own loss.
    points : (n,) int32, optional
        The point of each member, alone or with one camera. The camera need not observe it.

    Raises
    ------
    InvalidArgument
        If a shape is wrong or a number is not finite. Indices of cameras and points, weights and the return
        value of the function are checked by the solve.
    """

    function: ResidualFunction
    cameras: IndexArray | None = None
    weight: float = 1.0
    member_weights: FloatArray = None  # type: ignore[assignment]
    name: str = ""
    loss: LossFunction | str = "squared"
    loss_scale: float | None = None
    points: IndexArray | None = None

    if TYPE_CHECKING:  # what is given need not be what is held

        def __init__(
            self,
            function: ResidualFunction,
            cameras: ArrayLike | None = None,
            weight: float = 1.0,
            member_weights: ArrayLike | None = None,
            name: str = "",
            loss: LossFunction | str = "squared",
            loss_scale: float | None = None,
            points: ArrayLike | None = None,
        ) -> None: ...

    @property
    def num_members(self) -> int:
        """Number of members, n."""
        members = self.cameras if self.points is None else self.points
        return 0 if members is None else len(members)

    def _check(self) -> None:
        if not callable(self.function):
            raise InvalidArgument(f"function = {self.function!r}: must be callable")
        check_fields(self, "name", "loss", "weight", "loss_scale")
        self.name = self.name or getattr(self.function, "__name__", "residuals")
        if self.cameras is None and self.points is None:
            raise InvalidArgument(f"{self._label('cameras')}: must be given, or points")
        if self.cameras is not None:
            self.cameras = self._numbers("cameras", self.cameras)
        if self.points is not None:
            self.points = self._numbers("points", self.points)
            self._check_beside_points()
        if self.member_weights is None:
            self.member_weights = np.ones(self.num_members)
        self.member_weights = finite_array(
            self._label("member_weights"), self.member_weights, (self.num_members,)
        )

    @property
    def _pairs(self) -> bool:
        return self.cameras is not None and self.cameras.ndim == 2

    def _numbers(self, field_name: str, values: ArrayLike) -> IndexArray:
        numbers = number_array(self._label(field_name), values)
        pairs = field_name == "cameras" and numbers.ndim == 2 and numbers.shape[1] == 2
        if not (numbers.ndim == 1 or pairs) or not np.issubdtype(numbers.dtype, np.integer):
            rule = "(any,) or (any, 2)" if field_name == "cameras" else "(any,)"
            raise InvalidArgument(
                f"{self._label(field_name)}: {numbers.dtype} {numbers.shape}, must be {rule} whole numbers"
            )
        require_int32(self._label(field_name), numbers)
        return as_stored(numbers, np.int32)

    def _check_beside_points(self) -> None:
        if self.cameras is not None and self.cameras.shape != (self.num_members,):
            raise InvalidArgument(
                f"{self._label('cameras')}: shape {self.cameras.shape}, must be ({self.num_members},): "
                "one for each of points"
            )

    def evaluate(
        self, poses: FloatArray | None = None, points: FloatArray | None = None, jacobian: bool = True
    ) -> Evaluation:
        """Residuals of all members, and their derivatives.

        Parameters
        ----------
        poses : (n, p, 3, 4) float64, optional
            Poses of each member, p = 1 or 2; of groups with cameras.
        points : (n, 3) float64, optional
            Point of each member; of groups with points.
        jacobian : bool
            Whether derivatives are wanted.

        Returns
        -------
        Evaluation
            Residuals, and derivatives by the cameras and points of the group.

        Raises
        ------
        InvalidArgument
            If the return value of the function has a wrong shape or is not a number.
        """
        residuals, derivatives = self._call_function(poses, points)
        if not jacobian:
            return Evaluation(residuals)
        if not derivatives:
            return self._differences(residuals, poses, points)
        return self._given_derivatives(residuals, derivatives)

    def residuals_at(self, problem: Problem) -> FloatArray:
        """Residuals (n, k) at the state of a problem.

        Raises
        ------
        InvalidArgument
            If a camera or a point is none of the problem, or the function returns another shape than (n, k).
        """
        return self.evaluate(*self._arguments_of(problem), jacobian=False).residuals

    def change_when_repeated(self, problem: Problem) -> float:
        """How far a second call at the state of a problem is from the first, over the largest residual.

        Raises
        ------
        InvalidArgument
            As :meth:`residuals_at`.
        """
        return _relative_error(self.residuals_at(problem), self.residuals_at(problem))

    def derivative_error(self, problem: Problem) -> float:
        """How far the derivatives that the function gives are from differences, at the state of a problem.

        Parameters
        ----------
        problem : Problem
            Its poses and points are what the function is given.

        Returns
        -------
        float
            The largest difference over the largest derivative, by poses or by points, whichever is worse; 0
            where the function gives none.

        Raises
        ------
        InvalidArgument
            As :meth:`evaluate`.
        """
        arguments = self._arguments_of(problem)
        residuals, derivatives = self._call_function(*arguments)
        if not derivatives:
            return 0.0
        given, differences = (
            self._given_derivatives(residuals, derivatives),
            self._differences(residuals, *arguments),
        )
        return max(_relative_error(*pair) for pair in zip(given[1:], differences[1:], strict=True))

    def _arguments_of(self, problem: Problem) -> tuple[FloatArray | None, FloatArray | None]:
        """Poses (n, p, 3, 4) and points (n, 3) of all members."""
        poses = points = None
        if self.cameras is not None:
            self._require_range("cameras", self.cameras, problem.num_cameras)
            poses = problem.cameras[self.cameras].reshape(self.num_members, 1 + self._pairs, 3, 4)
        if self.points is not None:
            self._require_range("points", self.points, problem.num_points)
            if not problem.is_metric:
                raise InvalidArgument(
                    f"{self._label('points')}: camera_model = 'projective': must be points of a metric world"
                )
            points = problem.points[self.points]
        return poses, points

    def _require_range(self, field_name: str, numbers: IndexArray, count: int) -> None:
        if len(numbers) and not 0 <= numbers.min() <= numbers.max() < count:
            raise InvalidArgument(f"{self._label(field_name)}: must be from 0 to {count - 1}")

    def _call_function(
        self, poses: FloatArray | None, points: FloatArray | None, rows: int = ANY
    ) -> tuple[FloatArray, tuple[ArrayLike, ...]]:
        """Residuals, `rows` of each member, and the derivatives that the function gives, if it does."""
        arguments = []
        if poses is not None:
            arguments.append(poses if self._pairs else poses[:, 0])
        if points is not None:
            arguments.append(points)
        answer = self.function(*(argument.copy() for argument in arguments))
        values, *derivatives = answer if isinstance(answer, tuple) else (answer,)
        if derivatives and len(derivatives) != len(arguments):
            raise InvalidArgument(
                f"{self._label('function')}: {len(derivatives)} arrays of derivatives, "
                f"must be none or {len(arguments)}"
            )
        require_double(self._label("function"), values, *derivatives)
        residuals = finite_array(self._label("function"), values, (self.num_members, rows))
        return residuals.copy(), tuple(derivatives)  # it may write into the same array the next time

    def _given_derivatives(self, residuals: FloatArray, derivatives: tuple[ArrayLike, ...]) -> Evaluation:
        """Derivatives as the function gives them."""
        left, poses, point = list(derivatives), None, None
        label = f"derivatives of {self._label('function')}"
        if self.cameras is not None:
            shape = (*residuals.shape, 2, 6) if self._pairs else (*residuals.shape, 6)
            poses = finite_array(label, left.pop(0), shape).reshape(*residuals.shape, -1, 6).copy()
        if self.points is not None:
            point = finite_array(f"{label} by points", left.pop(0), (*residuals.shape, 3)).copy()
        return Evaluation(residuals, poses, point)

    def _differences(
        self, residuals: FloatArray, poses: FloatArray | None, points: FloatArray | None
    ) -> Evaluation:
        def at(poses: FloatArray | None, points: FloatArray | None) -> FloatArray:
            return self._call_function(poses, points, residuals.shape[1])[0]

        return Evaluation(
            residuals,
            None if poses is None else by_pose(lambda moved: at(moved, points), poses),
            None if points is None else by_point(lambda moved: at(poses, moved), points),
        )


def _relative_error(given: FloatArray | None, differences: FloatArray | None) -> float:
    """The largest difference of two arrays over the largest number in them."""
    if given is None or differences is None:
        return 0.0
    largest = max(float(np.abs(array).max(initial=0.0)) for array in (given, differences))
    return float(np.abs(given - differences).max(initial=0.0)) / largest if largest > 0 else 0.0


Group: TypeAlias = ConstraintGroup | ResidualGroup


def checked_groups(groups: Iterable[object]) -> list[Group]:
    """All groups of a solve, each valid now; InvalidArgument if one is not, or is no group."""
    is_scalar = getattr(groups, "ndim", 1) == 0  # an array that cannot be looped over
    if is_scalar or not isinstance(groups, Iterable):
        found = reprlib.repr(groups)  # a group holds all its cameras
        raise InvalidArgument(f"constraints = {found}: must be a sequence of groups, such as [group]")
    checked: list[Group] = []
    for number, group in enumerate(groups):
        if not isinstance(group, ConstraintGroup | ResidualGroup):
            raise InvalidArgument(f"constraints[{number}] = {group!r}: must be a ConstraintGroup")
        group.validate()
        checked.append(group)
    return checked


def require_kinds(groups: Iterable[Group], what: str) -> list[ConstraintGroup]:
    """The groups, if all are of a kind; InvalidArgument if one is a function, which `what` cannot take."""
    known = []
    for group in groups:
        if isinstance(group, ResidualGroup):
            raise InvalidArgument(
                f"constraints[{group.name!r}]: a ResidualGroup, must be a ConstraintGroup {what}"
            )
        known.append(group)
    return known
