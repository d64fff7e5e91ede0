"""The agreement between the harness and a peer: what is asked of a solver and what it hands back."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from dataclasses import asdict, dataclass, field
from enum import Enum
from pathlib import Path

from harness.bal_file import State


class Objective(str, Enum):
    """Which observations count in a solver's cost ½ Σ‖r‖²."""

    ALL = "all"
    IN_FRONT = "in-front"


@dataclass(frozen=True)
class StoppingRule:
    """Stop when the cost changes by at most `function_tolerance` of itself; no other tolerance.

    Solvers that know the time also stop after `max_seconds`, with what they have; none is killed for it.
    """

    max_iterations: int = 50
    function_tolerance: float = 1e-6
    max_seconds: float = 1e6


@dataclass(frozen=True)
class Variant:
    """One way to run a peer. Variants of the same label compete; the fastest represents the label."""

    label: str
    settings: dict[str, str] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)

    def describe(self) -> str:
        """Every setting in one line."""
        return " ".join(f"{k}={v}" for k, v in {**self.settings, **self.environment}.items())


@dataclass(frozen=True)
class Job:
    """One run: the plain-text BAL file, a folder for the run's own files, and the common rules."""

    bal_path: Path
    folder: Path
    threads: int
    rule: StoppingRule
    max_seconds: float
    keep_state: bool = True


@dataclass
class Outcome:
    """What a run reports.

    Attributes
    ----------
    trace : list of (seconds, cost)
        One entry per iteration, the first before any step: seconds since the solve began, cost of the
        accepted state.
    seconds_total : float
        Seconds of the whole solve.
    own_cost : float
        Final cost as the solver itself computes it.
    message : str
        Why the solver stopped, in its own words.
    start_bytes, inputs_bytes, peak_bytes : int
        Resident memory after start and imports, after reading the file, and the peak of the solve.
        `inputs_bytes` is −1 where a peer cannot tell.
    """

    trace: list[tuple[float, float]]
    seconds_total: float
    own_cost: float
    message: str
    start_bytes: int
    inputs_bytes: int
    peak_bytes: int

    @classmethod
    def load(cls, path: Path) -> Outcome:
        """Read the JSON that :meth:`save`, or a driver in another language, wrote."""
        values = json.loads(path.read_text())
        values["trace"] = [(float(seconds), float(cost)) for seconds, cost in values["trace"]]
        return cls(**values)

    def save(self, path: Path) -> None:
        """Write the JSON that :meth:`load` reads."""
        path.write_text(json.dumps(asdict(self)))


class Peer(ABC):
    """A solver under comparison. Adding one is adding a file to `solvers/` that defines ``PEER``.

    Attributes
    ----------
    name : str
        Key on the command line.
    title : str
        Name in tables and pictures.
    objective : Objective
        The cost this solver minimises.
    is_python : bool
        Whether a run starts a Python interpreter, whose own memory is then subtracted.
    max_repeats : int
        Cap for solvers so slow that repeating them is a waste.
    """

    name: str
    title: str
    objective: Objective = Objective.ALL
    is_python: bool = True
    max_repeats: int = 1000

    @abstractmethod
    def missing(self, build_folder: Path) -> str | None:
        """Why this peer cannot run here, or None. Builds what has to be built."""

    @abstractmethod
    def variants(self, threads: int) -> list[Variant]:
        """All the ways to run it that are worth trying, at most `threads` threads each."""

    @abstractmethod
    def command(self, job: Job, variant: Variant) -> list[str]:
        """The command of one run."""

    def outcome(self, job: Job) -> Outcome:
        """What the run in ``job.folder`` reported."""
        return Outcome.load(job.folder / "outcome.json")

    def final_state(self, job: Job) -> State:
        """Where the run in ``job.folder`` ended."""
        return State.load(job.folder / "state.npz")
