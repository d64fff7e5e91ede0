"""Peers that are Python packages: they run in a worker process of their own."""

from __future__ import annotations

import importlib
import importlib.util
import json
import sys
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from harness.bal_file import BalProblem, State
from harness.protocol import Job, Outcome, Peer, Variant


@dataclass
class Solution:
    """What a solve inside the worker returns; see :class:`Outcome` for the trace."""

    trace: list[tuple[float, float]]
    own_cost: float
    message: str
    final_state: Callable[[], State]


class InProcessPeer(Peer):
    """A peer that is imported. `prepare` builds its inputs, the callable it returns is timed.

    Attributes
    ----------
    package : str
        The package to import before memory is first measured.
    """

    package: str

    def missing(self, build_folder: Path) -> str | None:
        """Whether the package is installed."""
        return None if importlib.util.find_spec(self.package) else f"package {self.package} is not installed"

    @abstractmethod
    def prepare(self, problem: BalProblem, job: Job, settings: dict[str, str]) -> Callable[[], Solution]:
        """Build the solver's own inputs; the callable returned runs the solver and nothing else."""

    def command(self, job: Job, variant: Variant) -> list[str]:
        """Start the worker on this peer's file."""
        request = {"module": type(self).__module__, "settings": variant.settings, "job": asdict(job)}
        path = job.folder / "request.json"
        path.write_text(json.dumps(request, default=str))
        return [sys.executable, "-m", "harness.worker", str(path)]

    def save(self, job: Job, solution: Solution, seconds: float, memory: tuple[int, int, int]) -> None:
        """Leave outcome and final state in the folder of the job."""
        start, inputs, peak = memory
        outcome = Outcome(
            trace=solution.trace,
            seconds_total=seconds,
            own_cost=solution.own_cost,
            message=solution.message,
            start_bytes=start,
            inputs_bytes=inputs,
            peak_bytes=peak,
        )
        outcome.save(job.folder / "outcome.json")
        solution.final_state().save(job.folder / "state.npz")
