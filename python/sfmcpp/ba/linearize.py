"""The linear model of a problem at its present state: Jacobian, constraint rows, covariances, leverages."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp import _core
from sfmcpp.ba.arrays import chosen_numbers, core_arrays, core_constraints, with_own_fields
from sfmcpp.ba.linear_results import (
    ConstraintRows,
    Covariance,
    LinearStep,
    moved_to_cameras,
    sparse_jacobian,
    with_camera_names,
    without_points,
)
from sfmcpp.ba.options import SolveOptions
from sfmcpp.ba.variance_factor import InfluenceSums, independent_numbers
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import CameraFunction, LossFunction, Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_not_negative
from sfmcpp.model.names import Datum, Gauge, Loss
from sfmcpp.model.residual_group import Group, checked_groups

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

_POSE = ("rotation x", "rotation y", "rotation z", "centre x", "centre y", "centre z")
_SENSOR = tuple(f"sensor {name}" for name in _POSE)


class LinearModel:
    """A problem linearised at one state; :func:`linearize` makes one.

    With r the residuals, ρ′ their weights by the loss, J the Jacobian and G, w rows and weight of each group,
    the normal matrix is ``H = JᵀJ + Σ w GᵀG`` and the gradient of the cost ``Jᵀ √ρ′ r + Σ w Gᵀ e``. Columns
    are those of the solver: a rotation moves as ``R exp(δ)`` [rad], in the frame of the camera, all else by
    addition; first come cameras and intrinsics, then three columns for each point that may move. With rigs,
    the pose columns of a camera are those of its frame; if sensors are free, each has another six.

    Covariances, leverages and what follows from them use the inverse of H. In the free gauge H is singular,
    unless fixed cameras, fixed points or constraints leave no similarity of the world free, and the datum
    says what covariances refer to. "cameras": the mean of the cameras, for the solution whose poses move
    least, centres in units of the largest distance of one from their mean. Points that images hardly tell
    have no part in it. "all": the Moore–Penrose pseudo-inverse, for the solution of least norm over all
    columns as they are, radians beside lengths beside pixels. In the fixed gauge what is held has no column,
    and the plain inverse is meant. All are for exact σ; :attr:`variance_factor` estimates a factor of them.

    Parameters
    ----------
    problem : Problem
        The state; the arrays may change afterwards.
    constraints : iterable of ConstraintGroup or ResidualGroup
        Groups with their weights.
    options : SolveOptions
        Of these, the loss, the gauge ("auto" is "free") and the threads matter.
    ridge : float
        Share of its diagonal added to H where it is inverted.
    datum : {"cameras", "all"}
        What covariances in the free gauge refer to; "all" where cameras in one place tell no size.

    Attributes
    ----------
    residuals : (M, 2) float64
        Residuals (observed − projected) / σ, in the order of the observations.
    observation_weights : (M,) float64
        ρ′ of each observation: one without robust loss.
    camera_index, point_index : (M,) int32
        Camera and point of each observation.
    cost : float
        The whole cost, that of :func:`sfmcpp.solve`.
    groups : list of ConstraintRows
        The constraints.
    camera_columns : (C, D) int32
        Column of each parameter of each camera; −1: none, as it is fixed, held or not seen. Cameras that
        share intrinsics, a frame or a sensor share its columns.
    point_columns : (N,) int32
        First of the three columns of each point; −1: none.
    parameter_names : tuple of str
        Names of the D parameters of a camera.
    num_columns, num_camera_columns : int
        Columns in all, and those of cameras and intrinsics.
    loss_scale_px : float
        Scale of the loss, as given or as estimated.

    Raises
    ------
    InvalidArgument
        If the problem, a group or an option breaks a rule.
    """

    @checked()
    def __init__(
        self,
        problem: Problem,
        constraints: Iterable[Group],
        options: SolveOptions,
        ridge: float = 0.0,
        datum: Datum = "cameras",
    ) -> None:
        groups, problem = checked_groups(constraints), with_own_fields(problem)
        arrays = {**core_arrays(problem), "constraints": core_constraints(groups, problem)}
        self._problem, self._core = problem, _core.CoreLinearModel(arrays, options, ridge, datum)
        self.camera_index, self.point_index = arrays["camera_index"], arrays["point_index"]
        rigs, poses = problem.rigs, problem.cameras
        self._by_frame = None if rigs is None else rigs.motions(poses)
        self._by_sensor = rigs.sensor_motions(poses) if rigs is not None and rigs.free_sensors.any() else None
        self.cost, self.loss_scale_px, self._loss = self._core.cost, self._core.loss_scale_px, options.loss
        self.num_columns, self.num_camera_columns = self._core.num_columns, self._core.num_camera_columns
        self.residuals, self.observation_weights = self._core.residuals, self._core.observation_weights
        self.camera_columns, self.point_columns = self._core.camera_columns, self._core.point_columns
        self.groups = [ConstraintRows(**rows) for rows in self._core.groups()]
        self._num_measured = sum(map(independent_numbers, groups, self.groups))
        if isinstance(problem.camera_model, CameraFunction) and not np.isfinite(self.gradient()).all():
            problem.camera_model.require_derivatives(problem)

    def __repr__(self) -> str:
        of = f"{self._problem.num_cameras} cameras, {self._problem.num_points} points"
        return f"LinearModel({of}: {self.num_columns} columns, cost {self.cost:.6e})"

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the D parameters of a camera."""
        intrinsics = tuple(self._core.free_intrinsics)
        if self._problem.is_metric:
            return _POSE + intrinsics + (() if self._by_sensor is None else _SENSOR)
        return tuple(f"tangent {k}" for k in range(self.camera_columns.shape[1]))

    @property
    def group_costs(self) -> dict[str, float]:
        """Weighted cost of each group by its name; the observations cost the rest of `cost`."""
        return {rows.name: 0.5 * rows.weight * rows.squared_error for rows in self.groups}

    def blocks(self) -> tuple[FloatArray, FloatArray]:
        """The Jacobian J of the observations by blocks, times √ρ′.

        Returns
        -------
        (M, 2, D) float64, (M, 2, 3) float64
            By the columns of :attr:`camera_columns`, and by the point; zero where there is no column.
        """
        return self._core.jacobian()

    def jacobian(self) -> csr_matrix:
        """(2 M, columns) Jacobian ∂r/∂δ of the residuals times √ρ′, two rows of each in turn, SciPy CSR."""
        columns = self.camera_columns[self.camera_index], self.point_columns[self.point_index]
        return sparse_jacobian(np.concatenate(self.blocks(), axis=2), *columns, self.num_columns)

    def normal_matrix(self) -> csr_matrix:
        """(columns, columns) normal matrix H of observations and constraints, SciPy CSR."""
        jacobian = self.jacobian()
        normal: csr_matrix = (jacobian.T @ jacobian).tocsr()
        for rows in self.groups:
            own = rows.jacobian()
            own.resize((own.shape[0], self.num_columns))
            normal = normal + rows.weight * (own.T @ own)
        return normal

    def gradient(self) -> FloatArray:
        """(columns,) gradient ``Jᵀ √ρ′ r + Σ w Gᵀ e`` of the cost."""
        weighted = np.sqrt(self.observation_weights)[:, None] * self.residuals
        gradient: FloatArray = self.jacobian().T @ weighted.ravel()
        for rows in self.groups:
            gradient[: rows.columns] += rows.weight * (rows.jacobian().T @ rows.errors)
        return gradient

    def reduced_system(self, damping: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Eliminate the points of the damped normal equations ``(H + λ diag H) δ = −gradient``.

        The Schur complement of the note, §3; points follow from ``H_pp δ_p = −g_p − H_pc δ_c``.

        Parameters
        ----------
        damping : float
            λ, not negative.

        Returns
        -------
        matrix : (c, c) float64
            S of the c columns of cameras and intrinsics.
        rhs : (c,) float64
            Right-hand side: ``S δ_c = rhs``.

        Raises
        ------
        InvalidArgument
            If `damping` is negative, or a point's block is singular, as of a point that one camera sees.
        """
        require_not_negative("damping", damping)
        points = np.flatnonzero(self.point_columns >= 0)
        return without_points(self.normal_matrix(), self.gradient(), self.num_camera_columns, points, damping)

    @property
    @with_camera_names
    def num_determined(self) -> int:
        """Number of parameters that observations and constraints determine: the rank of H.

        Raises InvalidArgument where more than the gauge is open: for parts without a common point, for
        projective cameras. `normal_matrix` is right for these, too.
        """
        return self._core.num_determined()

    @property
    def variance_factor(self) -> float:
        """What to multiply covariances by where all σ are right up to a common factor.

        ``(Σ r² + Σ w ‖e‖²) / (2 M + n − num_determined)``, with ‖e‖² the `squared_error` of a group and n the
        independent numbers of all groups (three of a rotation, not nine); with a robust loss by Huber's
        asymptotic variance. Not a number without redundancy. Raises as `num_determined`.
        """
        squares = sum(rows.weight * rows.squared_error for rows in self.groups)
        return self.influence_sums().variance_factor(self.num_determined, self._num_measured, squares)

    def influence_sums(self) -> InfluenceSums:
        """What the loss leaves of the observations."""
        squared = (self.residuals**2).sum(axis=1)
        return InfluenceSums.of(squared, *_core.loss_terms(self._loss, self.loss_scale_px, squared)[1:])

    @property
    @with_camera_names
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the reduced camera system, in the fixed gauge."""
        return self._core.log_determinant()

    @with_camera_names
    def covariance(
        self,
        *,
        cameras: ArrayLike | Literal["all"] = (),
        points: ArrayLike | Literal["all"] = (),
        joint: bool = False,
    ) -> Covariance:
        """Covariances of chosen cameras and points.

        Parameters
        ----------
        cameras : (c,) int or "all"
            Numbers of cameras.
        points : (p,) int or "all"
            Numbers of points.
        joint : bool
            Whether to compute the covariances between them too.

        Returns
        -------
        Covariance
            A block for each; the class describes its meaning in either gauge, and the factor that the
            caller chooses.

        Raises
        ------
        InvalidArgument
            For a number out of range, a parameter that nothing determines, normal equations singular beyond
            the gauge, and the camera model "projective", whose gauge of 15 freedoms nothing holds.
        """
        chosen_cameras = chosen_numbers("cameras", cameras, len(self.camera_columns))
        chosen_points = chosen_numbers("points", points, len(self.point_columns))
        of_cameras, first = self.camera_columns[chosen_cameras], self.point_columns[chosen_points, None]
        of_points = np.where(first < 0, -1, first + np.arange(3)).astype(np.int32)
        together = None
        if joint:
            columns = np.concatenate([of_cameras.ravel(), of_points.ravel()])
            places = np.flatnonzero(columns >= 0)
            together = np.zeros((len(columns), len(columns)))
            together[np.ix_(places, places)] = self.covariance_of_columns(columns[places])
        found = Covariance(
            self._core.covariance_blocks(of_cameras), self._core.covariance_blocks(of_points), together
        )
        if self._by_frame is None:
            return found
        by_sensor = None if self._by_sensor is None else self._by_sensor[chosen_cameras]
        return moved_to_cameras(found, self._by_frame[chosen_cameras], by_sensor)

    @with_camera_names
    def covariance_of_columns(self, columns: NDArray[np.integer]) -> FloatArray:
        """(c, c) covariances of some columns, in their order; raises as :meth:`covariance`."""
        return self._core.covariance(columns.tolist())

    @with_camera_names
    def leverages(self) -> FloatArray:
        """Leverage of each observation, its influence on its own fit: ``J_o H⁻¹ J_oᵀ``.

        Returns
        -------
        (M, 2, 2) float64
            Their traces add up to the parameters determined, less those of the groups' hat matrices.

        Raises
        ------
        InvalidArgument
            As :meth:`covariance`, and beyond 4000 free parameters of cameras.
        """
        return self._core.leverages()

    @checked()
    @with_camera_names
    def hat_matrix(self, group: int) -> FloatArray:
        """Hat matrix of a group, the leverage of its errors: ``w G H⁻¹ Gᵀ``.

        Parameters
        ----------
        group : int
            Number of the group.

        Returns
        -------
        (R, R) float64
            Its trace is the number of the group's equations that the fit uses up. The rest of the independent
            ones is the redundancy of the group; diagonal blocks give that of its members.

        Raises
        ------
        InvalidArgument
            As :meth:`covariance`.
        """
        return self._core.hat(self._group(group))

    @checked()
    @with_camera_names
    def hat_spectrum(self, group: int) -> tuple[FloatArray, FloatArray]:
        """Eigenvalues, ascending, and eigenvectors, in columns, of :meth:`hat_matrix`.

        Parameters
        ----------
        group : int
            Number of the group.

        Returns
        -------
        (R,) float64, (R, R) float64
            Eigenvalues, and the eigenvectors as columns.
        """
        return self._core.hat_spectrum(self._group(group))

    def _group(self, group: int) -> int:
        if not 0 <= group < len(self.groups):
            raise InvalidArgument(f"group = {group}: must be in [0, {len(self.groups)})")
        return group

    @with_camera_names
    def step(self) -> LinearStep:
        """The minimum of the linear model: an undamped Gauss–Newton step.

        Returns
        -------
        LinearStep
            The state at the minimum, and the errors and the decrease of the cost that the model predicts.
        """
        return LinearStep.of(self._problem, self._core.step())


def linearize(
    problem: Problem,
    *,
    constraints: Iterable[Group] = (),
    loss: Loss | LossFunction = "squared",
    loss_scale_px: float | Literal["auto"] = 1.0,
    gauge: Gauge = "auto",
    datum: Datum = "cameras",
    threads: int = 0,
) -> LinearModel:
    """Linearise a problem at its current state, for Jacobians, covariances and leverages.

    Parameters
    ----------
    problem : Problem
        The state, usually an optimum; not changed.
    constraints : iterable of ConstraintGroup or ResidualGroup
        Groups with their weights.
    loss : {"squared", "huber", "cauchy", "tukey", "geman-mcclure", "truncated", "auto"} or LossFunction
        Robust loss ρ: observations are weighted by ρ′ in the normal equations, as in the solver.
    loss_scale_px : float or "auto"
        Where the loss leaves the parabola; "auto": from the residuals, as at the start of a solve.
    gauge : {"auto", "free", "fixed"}
        "free", and "auto" with it: all parameters have columns, covariances are those of the free network.
        "fixed": the first pose and the scale are held, unless something else determines them.
    datum : {"cameras", "all"}
        What covariances of the free network refer to: see :class:`LinearModel`.
    threads : int
        0: automatic. Does not change the result.

    Returns
    -------
    LinearModel
        Residuals, Jacobian, constraint rows; covariances and leverages on request.

    Raises
    ------
    InvalidArgument
        If the problem, a group or an option breaks a rule.
    """
    options = SolveOptions(loss=loss, loss_scale_px=loss_scale_px, gauge=gauge, threads=threads)
    return LinearModel(problem, constraints, options, datum=datum)
