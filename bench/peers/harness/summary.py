"""From runs to the rows of the table."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median

from harness.measure import Run, seconds_to
from harness.protocol import Objective

ACCURACIES = (1e-2, 1e-3, 1e-4)
CHECK_TOLERANCE = 1e-6
MEGABYTE = 1e6


@dataclass
class Row:
    """One solver on one file; times in seconds, memory in bytes, over all its repeats.

    Attributes
    ----------
    seconds_to_median, seconds_to_min : dict
        Accuracy to seconds; infinite where never reached.
    iterations_to : dict
        Accuracy to number of iterations, None where never reached.
    above_start, above_imports, above_inputs : int or None
        Median peak less the resident memory of the bare process (for Python, of a bare interpreter),
        after the imports, and after reading the file.
    own_cost, checked_cost : float
        Final cost by the solver, and by NumPy from the final state, over the observations of `objective`.
    checked_cost_all : float
        Final cost by NumPy over all observations.
    """

    title: str
    peer: str
    settings: str
    objective: Objective
    best_cost: float
    repeats: int
    seconds_to_median: dict[str, float]
    seconds_to_min: dict[str, float]
    iterations_to: dict[str, int | None]
    seconds_per_iteration: float
    seconds_per_iteration_min: float
    iterations: int
    own_cost: float
    checked_cost: float
    checked_cost_all: float
    observations_behind: int
    peak: int
    above_start: int
    above_imports: int
    above_inputs: int | None
    message: str

    @property
    def cost_is_confirmed(self) -> bool:
        """Whether NumPy finds the cost that the solver claims."""
        return abs(self.own_cost - self.checked_cost) <= CHECK_TOLERANCE * self.checked_cost

    @property
    def rank(self) -> tuple[float, ...]:
        """Order of the table: by seconds to 1e-3, then 1e-2, then final cost."""
        return (self.seconds_to_median["0.001"], self.seconds_to_median["0.01"], self.own_cost)


def best_costs(runs: list[Run], known: float | None) -> dict[Objective, float]:
    """The cost that counts as best for each objective: the known one, else the lowest of these runs."""
    best: dict[Objective, float] = {}
    for run in runs:
        objective = run.entrant.peer.objective
        best[objective] = min(run.outcome.own_cost, best.get(objective, float("inf")))
    if known is not None:
        best[Objective.ALL] = known
    return best


def seconds_per_iteration(trace: list[tuple[float, float]]) -> float:
    """Mean seconds from one entry of the trace to the next; what precedes the first is not an iteration."""
    return (trace[-1][0] - trace[0][0]) / max(len(trace) - 1, 1)


def median_run(runs: list[Run], best: float) -> Run:
    """The run whose time to 1e-3 of the best cost is the (lower) median; its curve is the one drawn."""
    target = best * (1.0 + 1e-3)
    ordered = sorted(runs, key=lambda run: (seconds_to(run.outcome.trace, target), run.outcome.seconds_total))
    return ordered[(len(ordered) - 1) // 2]


def make_row(runs: list[Run], best: float, interpreter: int) -> Row:
    """Summarise the repeats of one entrant; `interpreter` is a bare Python's resident memory [bytes]."""
    first, peer = runs[0], runs[0].entrant.peer
    outcomes = [run.outcome for run in runs]
    times = {
        f"{eps:g}": [seconds_to(outcome.trace, best * (1 + eps)) for outcome in outcomes]
        for eps in ACCURACIES
    }
    per_iteration = [seconds_per_iteration(outcome.trace) for outcome in outcomes]
    in_front = peer.objective is Objective.IN_FRONT
    return Row(
        title=first.entrant.title,
        peer=peer.name,
        settings=first.entrant.variant.describe(),
        objective=peer.objective,
        best_cost=best,
        repeats=len(runs),
        seconds_to_median={eps: median(values) for eps, values in times.items()},
        seconds_to_min={eps: min(values) for eps, values in times.items()},
        iterations_to={f"{eps:g}": _iterations_to(first, best * (1 + eps)) for eps in ACCURACIES},
        seconds_per_iteration=median(per_iteration),
        seconds_per_iteration_min=min(per_iteration),
        iterations=len(first.outcome.trace) - 1,
        own_cost=first.outcome.own_cost,
        checked_cost=_known(first.checked_cost_in_front if in_front else first.checked_cost_all),
        checked_cost_all=_known(first.checked_cost_all),
        observations_behind=int(_known(first.observations_behind)),
        message=first.outcome.message,
        **_memory(runs, interpreter),
    )


def _memory(runs: list[Run], interpreter: int) -> dict[str, int]:
    """Median memory figures, as keyword arguments of :class:`Row`."""
    outcomes = [run.outcome for run in runs]
    is_python = runs[0].entrant.peer.is_python
    figures = {
        "peak": [o.peak_bytes for o in outcomes],
        "above_start": [o.peak_bytes - (interpreter if is_python else o.start_bytes) for o in outcomes],
        "above_imports": [o.peak_bytes - o.start_bytes for o in outcomes],
        "above_inputs": [o.peak_bytes - o.inputs_bytes for o in outcomes],
    }
    known: dict[str, int | None] = {key: int(median(values)) for key, values in figures.items()}
    if any(outcome.inputs_bytes < 0 for outcome in outcomes):
        known["above_inputs"] = None
    return known  # type: ignore[return-value]


def _iterations_to(run: Run, target: float) -> int | None:
    return next((k for k, (_, value) in enumerate(run.outcome.trace) if value <= target), None)


def _known(value: float | None) -> float:
    if value is None:
        raise ValueError("the first repeat of an entrant must keep its final state")
    return value
