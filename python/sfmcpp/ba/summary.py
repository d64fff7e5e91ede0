"""Summary of a solve, and the record of each iteration."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.loss_function import LossFunction
from sfmcpp.model.names import Loss
from sfmcpp.model.problem import html_table
from sfmcpp.model.weight_selection import WeightSelection


@dataclass(frozen=True, repr=False)
class Iteration:
    """One step of the minimiser, accepted or not; iteration 0 is the start.

    Attributes
    ----------
    iteration : int
        Number of the step.
    cost : float
        ½ Σ ρ(‖r‖²) of the current accepted state, over all observations.
    seconds : float
        Since the start of the solve [s].
    accepted : bool
        Whether the step was taken.
    damping : float
        λ of the step; 0 for methods without, as dog-leg. Neither its radius nor gain ratios are kept.
    gradient_norm : float
        Largest entry of the gradient where the step started: the same in the first two rows.
    step_norm : float
        Euclidean norm of the step.
    step_lengths : (float, float)
        How far along the step the cameras and the points went.
    linear_solver_iterations : int
        Conjugate-gradient iterations; 0 for direct solvers.
    proposed_lengths : list of (float, float)
        What an algebraic line search proposed, accepted or not.
    line_searched : bool
        Whether a line search was made.
    accelerated : bool
        Whether the step was bent by an acceleration that lowered the cost.
    held_points : int
        Points that the step made worse and that were drawn back along it.
    refitted_points : int
        Points that the step had moved far and that were fitted to the cameras after it.
    intrinsics_held : bool
        Whether the step left the intrinsics as they were, until the poses had settled.
    cost_evaluations : int
        Evaluations of the cost for this step.
    bytes_sent : float
        To other ranks, by this one, since the iteration before; 0 for one process alone.
    """

    iteration: int
    cost: float
    seconds: float
    accepted: bool
    damping: float
    gradient_norm: float
    step_norm: float
    step_lengths: tuple[float, float]
    linear_solver_iterations: int
    proposed_lengths: list[tuple[float, float]] = field(default_factory=list)
    line_searched: bool = False
    accelerated: bool = False
    held_points: int = 0
    refitted_points: int = 0
    intrinsics_held: bool = False
    cost_evaluations: int = 1
    bytes_sent: float = 0.0

    def __repr__(self) -> str:
        camera, point = self.step_lengths
        outcome = "accepted" if self.accepted else "rejected"
        return (
            f"Iteration(iteration={self.iteration}: cost {self.cost:.6e}, {outcome}, "
            f"damping {self.damping:.3g}, step lengths {camera:.4g} and {point:.4g})"
        )


@dataclass(frozen=True)
class LinearSolverForecast:
    """Predicted cost of a step with a linear solver, before the solve.

    Attributes
    ----------
    solver : str
        Its name.
    flops : float
        Floating-point operations.
    bytes : float
        Memory that the whole solve keeps, the problem itself aside.
    seconds : float
        Of a step, on this machine where that is worth measuring, else on the machine of the reference [s].
    iterations : float
        Conjugate-gradient iterations expected; 0 for direct solvers.
    work_once, work_of_step, work_of_iteration : dict of str to float
        The counts behind these numbers, by kind of work: before the first step, in every step, and in every
        conjugate-gradient iteration.
    """

    solver: str
    flops: float
    bytes: float
    seconds: float
    iterations: float
    work_once: dict[str, float]
    work_of_step: dict[str, float]
    work_of_iteration: dict[str, float]


@dataclass(frozen=True)
class LinearSolverChange:
    """A linear solver that took over where steps had cost more than predicted.

    Attributes
    ----------
    solves : int
        Solves before it.
    solver : str
        The one that took over.
    reason : str
        Why, in words.
    """

    solves: int
    solver: str
    reason: str


@dataclass(frozen=True)
class RankLoad:
    """Work of one rank of several.

    Attributes
    ----------
    points, observations : int
        Size of its part.
    threads : int
        Threads that it used.
    seconds_computing, seconds_waiting : float
        For itself; and for the other ranks and the network [s].
    messages : int
        Collective calls.
    bytes_sent : float
        To other ranks.
    """

    points: int
    observations: int
    threads: int
    seconds_computing: float
    seconds_waiting: float
    messages: int
    bytes_sent: float


@dataclass(frozen=True, repr=False)
class Summary:
    """Result of :func:`sfmcpp.solve`; print it for a table.

    Attributes
    ----------
    initial_cost, final_cost : float
        ½ Σ ρ(‖r‖²) with residuals over their standard deviation, and the costs of the constraints.
    initial_rms_px, final_rms_px : float
        sqrt(Σ‖r‖² / 2M), without the loss (thesis eq. 3.27), in `rms_unit`.
    rms_unit : str
        ``"px"`` where every observation has σ = 1 px, else ``"σ"``: residuals are then over their own.
    termination : str
        ``"converged"``, ``"max_iterations"``, ``"max_seconds"``, ``"interrupted"``,
        ``"stopped_by_callback"``, ``"stalled"`` (the cost fell, and then no step lowered it although the
        gradient is not negligible) or ``"numerical_failure"`` (no step lowered the cost).
    message : str
        The termination in words.
    loss : str or LossFunction
        The given loss.
    method, line_search, linear_solver : str
        What was used.
    point_steps : str
        How points that a step makes worse were treated; resolved if ``"auto"`` was given.
    options : dict
        All options of the solve by name, defaults included.
    version : str
        Version of this package.
    linear_solver_reason : str
        Why this linear solver was chosen; its MB are of the solver alone, `bytes` of the forecast of all.
    linear_solver_forecast : list of LinearSolverForecast
        Predicted cost of each solver considered.
    linear_solver_changes : list of LinearSolverChange
        Changes of the solver during the run, in order.
    loss_scale_px : float
        Scale of the loss, as given or as estimated, in `rms_unit`: residuals are over their σ.
    threads : int
        Threads used.
    seconds_setup, seconds_total : float
        Time before the first iteration, and total [s].
    warnings : list of str
        Named warnings about valid but suspicious input or results.
    observations_behind_camera : (int, int)
        Observations whose point is not in front of the camera, at the start and at the end.
    constraint_costs : dict of str to (float, float)
        Weighted cost of each group of constraints, by its name, at the start and at the end.
    iterations : list of Iteration
        The history; the first entry is the initial state.
    group_weights : list of WeightSelection
        Groups whose weight was chosen from the data.
    ranks : list of RankLoad
        Load of each rank, in order; empty for a single process.
    """

    initial_cost: float
    final_cost: float
    initial_rms_px: float
    final_rms_px: float
    termination: str
    message: str
    method: str
    line_search: str
    linear_solver: str
    linear_solver_reason: str
    loss: Loss | LossFunction
    loss_scale_px: float
    threads: int
    seconds_setup: float
    seconds_total: float
    warnings: list[str] = field(default_factory=list)
    observations_behind_camera: tuple[int, int] = (0, 0)
    constraint_costs: dict[str, tuple[float, float]] = field(default_factory=dict)
    iterations: list[Iteration] = field(default_factory=list)
    group_weights: list[WeightSelection] = field(default_factory=list)
    linear_solver_forecast: list[LinearSolverForecast] = field(default_factory=list)
    linear_solver_changes: list[LinearSolverChange] = field(default_factory=list)
    ranks: list[RankLoad] = field(default_factory=list)
    point_steps: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    version: str = ""
    rms_unit: str = "px"

    @property
    def converged(self) -> bool:
        """Whether a tolerance was met, rather than a limit."""
        return self.termination == "converged"

    def require_uninterrupted(self) -> Summary:
        """Return the summary itself, for code that continues with the state.

        Raises
        ------
        KeyboardInterrupt
            If Ctrl-C ended the solve.
        """
        if self.termination == "interrupted":
            raise KeyboardInterrupt
        return self

    def history(self) -> dict[str, NDArray[Any]]:
        """Columns (n,) of the iterations by field name, as for a data frame.

        The two step lengths are ``step_length_camera`` and ``step_length_point``. Proposed lengths are left
        out: each iteration has its own number of them.
        """
        lengths = ("step_length_camera", "step_length_point")
        rows = []
        for iteration in self.iterations:
            row = asdict(iteration)
            del row["proposed_lengths"]
            rows.append(row | dict(zip(lengths, row.pop("step_lengths"), strict=True)))
        return {name: np.array([row[name] for row in rows]) for name in (rows[0] if rows else {})}

    def to_dict(self) -> dict[str, Any]:
        """Plain values only, as for JSON."""
        return {
            **asdict(self),
            "loss": str(self.loss),
            "options": {**self.options, "loss": str(self.loss)},
            "group_weights": [chosen.to_dict() for chosen in self.group_weights],
        }

    def __repr__(self) -> str:
        steps = max(len(self.iterations) - 1, 0)
        return (
            f"Summary({self.termination} after {steps} steps: cost {self.initial_cost:.6e} → "
            f"{self.final_cost:.6e}, RMS {self.initial_rms_px:.6g} → {self.final_rms_px:.6g} {self.rms_unit})"
        )

    def __str__(self) -> str:
        return "\n".join(f"{name:<21} {value}" for name, value in self._rows())

    def _repr_html_(self) -> str:
        """The same as a table, for notebooks."""
        return html_table(self._rows())

    @property
    def _scale(self) -> str:
        return f"{self.loss_scale_px:.4g} {self.rms_unit}"

    def describe_steps(self) -> str:
        """How many steps were tried, accepted, and made with the intrinsics held."""
        steps = self.iterations[1:]
        held = sum(i.intrinsics_held for i in steps)
        told = f", {held} with intrinsics held" if held else ""
        return f"{len(steps)} ({sum(i.accepted for i in steps)} accepted{told})"

    def _rows(self) -> list[tuple[str, str]]:
        rows = [
            ("cost", f"{self.initial_cost:.6e} → {self.final_cost:.6e}"),
            *(
                (f"cost of {name!r}", f"{initial:.6e} → {final:.6e}")
                for name, (initial, final) in self.constraint_costs.items()
            ),
            *((f"weight of {chosen.name!r}", chosen.describe()) for chosen in self.group_weights),
            (f"RMS [{self.rms_unit}]", f"{self.initial_rms_px:.6g} → {self.final_rms_px:.6g}"),
            ("termination", f"{self.termination}: {self.message.removeprefix('interrupted; ')}"),
            ("iterations", self.describe_steps()),
            ("method", f"{self.method}, line search {self.line_search}, point steps {self.point_steps}"),
            ("linear solver", f"{self.linear_solver}, {self.threads} thread{'s' * (self.threads != 1)}"),
            ("loss", self.loss if self.loss == "squared" else f"{self.loss}, {self._scale}"),
            ("seconds", f"{self.seconds_total:.4g}"),
        ]
        return rows + [("warning", warning) for warning in self.warnings]
