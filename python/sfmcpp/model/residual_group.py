"""Residuals of cameras by a function of the user's own, in named weighted groups beside constraints."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import check_fields
from sfmcpp.model.arrays import ANY, FloatArray, IndexArray, finite_array, number_array, require_int32
from sfmcpp.model.constraints import ConstraintGroup, MemberGroup
from sfmcpp.model.loss_function import LossFunction
from sfmcpp.model.problem import Problem

ResidualFunction: TypeAlias = Callable[[FloatArray], "ArrayLike | tuple[ArrayLike, ArrayLike]"]

_TANGENT = 6
# Central differences of a double are best at its third root.
_STEP = float(np.cbrt(np.finfo(float).eps))


@dataclass(eq=False)
class ResidualGroup(MemberGroup):
    """Residuals of poses by a NumPy function, as a term of the cost of any solve.

    In :func:`sfmcpp.solve` the group adds ``½ Σ ρ(weight · member_weights · ‖r‖²)`` to the cost. A sensor of
    standard deviation σ has ``r = error / σ`` where observations are over theirs.

    Parameters
    ----------
    function : callable
        Called as ``function(poses)``, for all members at once, with poses (n, 3, 4) of `cameras` (n,), or
        (n, 2, 3, 4) of pairs (n, 2): rotation world_from_camera and centre in the world. Returns residuals r
        (n, k), or r and their derivatives (n, k, 6) or (n, k, 2, 6) by δR of ``R exp([δR]×)`` [rad] and
        the centre; without them it is called twelve times for each camera of a member, for central
        differences. It must be a function of its argument alone. What it raises ends the solve and is raised
        as it is; the problem then holds the best state until there.
    cameras : (n,) or (n, 2) int32
        The camera of each member, or a pair of cameras.
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
        Where the loss leaves the parabola, in units of r. Default: 95 % efficiency on normal errors; of one
        of your own: 1.

    Raises
    ------
    InvalidArgument
        If a shape is wrong or a number is not finite. Camera numbers, weights and what the function returns
        wait for the solve.
    """

    function: ResidualFunction
    cameras: IndexArray
    weight: float = 1.0
    member_weights: FloatArray = None  # type: ignore[assignment]
    name: str = ""
    loss: LossFunction | str = "squared"
    loss_scale: float | None = None

    def _check(self) -> None:
        if not callable(self.function):
            raise InvalidArgument(f"function = {self.function!r}: must be callable")
        check_fields(self, "name", "loss", "weight", "loss_scale")
        self.name = self.name or getattr(self.function, "__name__", "residuals")
        cameras = number_array(self._label("cameras"), self.cameras)
        pairs = cameras.ndim == 2 and cameras.shape[1] == 2
        if not (cameras.ndim == 1 or pairs) or not np.issubdtype(cameras.dtype, np.integer):
            raise InvalidArgument(
                f"{self._label('cameras')}: {cameras.dtype} {cameras.shape}, "
                "must be (any,) or (any, 2) whole numbers"
            )
        require_int32(self._label("cameras"), cameras)
        self.cameras = np.ascontiguousarray(cameras, dtype=np.int32)
        if self.member_weights is None:
            self.member_weights = np.ones(self.num_members)
        self.member_weights = finite_array(
            self._label("member_weights"), self.member_weights, (self.num_members,)
        )

    def evaluate(self, poses: FloatArray, jacobian: bool = True) -> tuple[FloatArray, FloatArray | None]:
        """Residuals of all members, and their derivatives.

        Parameters
        ----------
        poses : (n, p, 3, 4) float64
            Poses of each member, p = 1 or 2.
        jacobian : bool
            Whether derivatives are wanted.

        Returns
        -------
        (n, k) float64 and (n, k, p, 6) float64 or None

        Raises
        ------
        InvalidArgument
            If what the function returns has another shape, or is no number.
        """
        residuals, derivatives = self._called(poses)
        if not jacobian:
            return residuals, None
        if derivatives is None:
            return residuals, self._differences(poses, residuals.shape)
        return residuals, self._given(derivatives, residuals.shape)

    def rows_at(self, problem: Problem) -> int:
        """How many residuals a member has, k, as a call with the poses of a problem tells.

        Raises
        ------
        InvalidArgument
            If a camera is none of the problem, or the function returns another shape than (n, k).
        """
        return len(self.evaluate(self._poses_of(problem), jacobian=False)[0].T)

    def derivative_error(self, problem: Problem) -> float:
        """How far the derivatives that the function gives are from differences, at the poses of a problem.

        Parameters
        ----------
        problem : Problem
            Its poses are what the function is given.

        Returns
        -------
        float
            The largest difference over the largest derivative; 0 where the function gives none.

        Raises
        ------
        InvalidArgument
            As :meth:`evaluate`.
        """
        poses = self._poses_of(problem)
        residuals, derivatives = self._called(poses)
        if derivatives is None:
            return 0.0
        given = self._given(derivatives, residuals.shape)
        differences = self._differences(poses, residuals.shape)
        largest = max(float(np.abs(array).max(initial=0.0)) for array in (given, differences))
        return float(np.abs(given - differences).max(initial=0.0)) / largest if largest > 0 else 0.0

    def _poses_of(self, problem: Problem) -> FloatArray:
        """Poses (n, p, 3, 4) of each member."""
        if self.num_members and not 0 <= self.cameras.min() <= self.cameras.max() < problem.num_cameras:
            raise InvalidArgument(f"{self._label('cameras')}: must be from 0 to {problem.num_cameras - 1}")
        return problem.cameras[self.cameras].reshape(self.num_members, -1, 3, 4)

    def _called(self, poses: FloatArray) -> tuple[FloatArray, ArrayLike | None]:
        answer = self.function(poses if self.cameras.ndim == 2 else poses[:, 0])
        values, derivatives = answer if isinstance(answer, tuple) else (answer, None)
        return finite_array(self._label("function"), values, (self.num_members, ANY)), derivatives

    def _given(self, derivatives: ArrayLike, of: tuple[int, ...]) -> FloatArray:
        """Derivatives (n, k, p, 6) as the function gives them, of residuals of that shape."""
        pairs = self.cameras.ndim == 2
        label = f"derivatives of {self._label('function')}"
        found = finite_array(label, derivatives, (*of, 2, _TANGENT) if pairs else (*of, _TANGENT))
        return found if pairs else found[:, :, None]

    def _differences(self, poses: FloatArray, of: tuple[int, ...]) -> FloatArray:
        result = np.empty((*of, poses.shape[1], _TANGENT))
        # Centres far away move by as much of their distance; rotations are of the size one.
        steps = np.array([_STEP] * 3 + [_STEP * max(1.0, float(np.abs(poses[..., 3]).max(initial=0.0)))] * 3)
        for camera in range(poses.shape[1]):
            for k in range(_TANGENT):
                either = [self._called(_moved(poses, camera, k, sign * steps[k]))[0] for sign in (1, -1)]
                result[:, :, camera, k] = (either[0] - either[1]) / (2 * steps[k])
        return result


Group: TypeAlias = ConstraintGroup | ResidualGroup


def checked_groups(groups: Iterable[object]) -> list[Group]:
    """All groups of a solve, each valid now; InvalidArgument if one is not, or is no group."""
    if not isinstance(groups, Iterable):
        raise InvalidArgument(f"constraints = {groups!r}: must be a sequence of ConstraintGroup")
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


def _moved(poses: FloatArray, camera: int, k: int, step: float) -> FloatArray:
    """Poses (n, p, 3, 4), one of each member moved along one of its six directions."""
    moved: FloatArray = poses.copy()
    if k >= 3:
        moved[:, camera, k - 3, 3] += step
        return moved
    a, b = (k + 1) % 3, (k + 2) % 3
    turn = np.eye(3)
    turn[[a, b], [a, b]] = np.cos(step)
    turn[a, b], turn[b, a] = -np.sin(step), np.sin(step)
    moved[:, camera, :, :3] = poses[:, camera, :, :3] @ turn
    return moved
