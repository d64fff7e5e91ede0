"""Runs of solvers in processes of their own: the settings of each compete, then the best run in turn."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from harness.bal_file import BalProblem, cost, count_behind
from harness.protocol import Job, Objective, Outcome, Peer, Variant

PEERS_FOLDER = Path(__file__).resolve().parents[1]
TUNING_TARGET = 1e-3


class RunError(Exception):
    """A run that did not end with a result; the message says how."""


@dataclass(frozen=True)
class Entrant:
    """A peer run in one way; `label` tells its ways apart in the table."""

    peer: Peer
    variant: Variant

    @property
    def title(self) -> str:
        """Name in tables and pictures."""
        label = self.variant.label
        return f"{self.peer.title} ({label})" if label else self.peer.title


@dataclass
class Run:
    """One finished run: what the solver reports, and the costs that NumPy finds in its final state."""

    entrant: Entrant
    outcome: Outcome
    load_average: float
    checked_cost_all: float | None = None
    checked_cost_in_front: float | None = None
    observations_behind: int | None = None


def seconds_to(trace: Iterable[tuple[float, float]], target: float) -> float:
    """Seconds at the first entry whose cost is at most `target`; infinite when none is."""
    return next((seconds for seconds, value in trace if value <= target), float("inf"))


def run_once(entrant: Entrant, job: Job, problem: BalProblem) -> Run:
    """Run in a new process and check the final state.

    Raises
    ------
    RunError
        If the process fails or takes longer than ``job.max_seconds``.
    """
    _empty(job.folder)
    load = os.getloadavg()[0]
    _execute(entrant, job)
    run = Run(entrant, entrant.peer.outcome(job), load)
    if job.keep_state:
        state = entrant.peer.final_state(job)
        run.checked_cost_all = cost(problem, state, only_in_front=False)
        run.checked_cost_in_front = cost(problem, state, only_in_front=True)
        run.observations_behind = count_behind(problem, state)
    return run


def _empty(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)


def _execute(entrant: Entrant, job: Job) -> None:
    path = os.pathsep.join(filter(None, [str(PEERS_FOLDER), os.environ.get("PYTHONPATH")]))
    blas = {"OPENBLAS_NUM_THREADS": str(job.threads), "OMP_NUM_THREADS": str(job.threads)}
    environment = {**os.environ, **blas, **entrant.variant.environment, "PYTHONPATH": path}
    command = entrant.peer.command(job, entrant.variant)
    try:
        done = subprocess.run(
            command,
            env=environment,
            capture_output=True,
            text=True,
            timeout=job.max_seconds,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise RunError(f"no result within {job.max_seconds:g} s") from error
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["no message"]
        raise RunError(f"exit code {done.returncode}: {lines[-1]}")


def tune(
    peer: Peer,
    job: Job,
    problem: BalProblem,
    repeats: int,
    best: float | None,
    say: Callable[[str], None],
    labels: Sequence[str] = (),
) -> tuple[list[Entrant], list[Run], dict[str, str]]:
    """For each label of a peer, the variant that is fastest to 1e-3 of the best cost, by knock-out.

    `labels`, if any, are the only ones tried of a peer that has several.

    Returns
    -------
    entrants : list of Entrant
        One per label that has a working variant.
    runs : list of Run
        Every run made to find them.
    failures : dict
        Title and last reason of the labels without one.
    """
    by_label: dict[str, list[Variant]] = {}
    for variant in peer.variants(job.threads):
        if labels and variant.label and variant.label not in labels:
            continue
        by_label.setdefault(variant.label, []).append(variant)
    entrants, runs, failures = [], [], {}
    for variants in by_label.values():
        rivals = [Entrant(peer, variant) for variant in variants]
        if len(rivals) == 1 or repeats == 0:
            entrants.append(rivals[0])
            continue
        trials, reasons = _knock_out(rivals, job, problem, repeats, best)
        runs += trials
        if trials:
            entrants.append(ranking(trials, best)[0])
            say(f"  {entrants[-1].title}: {entrants[-1].variant.describe()}")
        else:
            failures[rivals[0].title] = reasons[-1]
    return entrants, runs, failures


def _knock_out(
    rivals: list[Entrant], job: Job, problem: BalProblem, repeats: int, best: float | None
) -> tuple[list[Run], list[str]]:
    """Rounds of `repeats` runs each; the better half goes on, so that close rivals meet most often."""
    runs: list[Run] = []
    reasons: list[str] = []
    while len(rivals) > 1:
        finished, failed = _try_all(rivals * repeats, job, problem)
        runs += finished
        reasons += failed
        standing = [entrant for entrant in ranking(runs, best) if entrant in rivals]
        rivals = standing[: (len(standing) + 1) // 2]
    return runs, reasons


def _try_all(entrants: list[Entrant], job: Job, problem: BalProblem) -> tuple[list[Run], list[str]]:
    runs, reasons = [], []
    for entrant in entrants:
        try:
            runs.append(run_once(entrant, job, problem))
        except RunError as error:
            reasons.append(str(error))
    return runs, reasons


def ranking(runs: list[Run], best: float | None) -> list[Entrant]:
    """Entrants by their least seconds to 1e-3 of the best cost; those that never get there by their cost."""
    if not runs:
        return []
    lowest = min(run.outcome.own_cost for run in runs)
    known = best if best is not None and runs[0].entrant.peer.objective is Objective.ALL else lowest
    target = known * (1.0 + TUNING_TARGET)
    ordered = sorted(runs, key=lambda run: (seconds_to(run.outcome.trace, target), run.outcome.own_cost))
    return list({id(run.entrant.variant): run.entrant for run in ordered}.values())


def repeat_in_turn(
    entrants: list[Entrant], job: Job, problem: BalProblem, repeats: int, say: Callable[[str], None]
) -> tuple[dict[str, list[Run]], dict[str, str]]:
    """A B C A B C …: each round runs every entrant once, so that noise of the machine meets all alike.

    Returns
    -------
    runs : dict
        The finished runs of each title.
    failures : dict
        Why a title has no further runs; one failure ends its repeats.
    """
    runs: dict[str, list[Run]] = {}
    failures: dict[str, str] = {}
    for repeat in range(repeats):
        say(f"  round {repeat + 1} of {repeats}")
        for entrant in entrants:
            if repeat >= entrant.peer.max_repeats or entrant.title in failures:
                continue
            try:
                run = run_once(entrant, replace(job, keep_state=repeat == 0), problem)
            except RunError as error:
                failures[entrant.title] = str(error)
            else:
                runs.setdefault(entrant.title, []).append(run)
    return runs, failures
