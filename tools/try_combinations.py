#!/usr/bin/env python3
"""Usage: try_combinations.py [--scenes NAME ...] [--processes N] [--results FILE]: all methods with all else.

Each method × line search × linear solver × camera model × loss solves small scenes. A combination that is
refused must be refused by name. Any other must end without a raw exception, at the cost of the state that it
returns, and if it says "converged" no more than 0.1 % above the best cost of that scene, camera model and
loss. Where it is more, the gradient at its end is looked at, by differences of residuals: a Gauss–Newton
step promises less than 0.1 % ("another minimum"), or an iteration gained less than `function_tolerance` on
the way ("slow"). Anything else is a fault: it is printed, and the program ends with 1. What is found with a
scene and a camera model is added to FILE, and taken from there by a run that goes on after it was stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

import sfmcpp
from sfmcpp import _core
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.synthetic import hide_observations

CHOICES = {option.name: [name for name, _ in option.choices] for option in _core.SOLVE_OPTIONS}
WAYS = ("method", "line_search", "linear_solver", "loss")
LOSS_SCALE_PX, MAX_ITERATIONS = 2.0, 200
# A cost that is as good as another: in shares of it, or so small per observation that no pixel tells.
SAME_COST, NO_COST = 1e-3, 1e-6
# Steps of differences, in sizes of unknowns: what their errors promise, one of them does not. Singular values
# below the other number are the gauge's.
DIFFERENCES, RANK = (1e-6, 1e-7), 1e-7
ENDS = (
    "refused",
    "best",
    "another minimum",
    "slow",
    "not converged",
    "raw exception",
    "untrue",
    "unexplained",
)
FAULTS = ENDS[5:]
Scene = Callable[[str], Problem]


def started(problem: Problem, level: float = 1.0) -> Problem:
    """A start away from the truth."""
    return sfmcpp.perturb(
        problem, point_sigma_m=0.2 * level, position_sigma_m=0.2 * level, rotation_sigma_deg=level, seed=1
    )


def circle(model: str, cameras: int = 5, points: int = 20, level: float = 1.0, **more: float) -> Problem:
    """Cameras around a cube."""
    return started(sfmcpp.circle_scene(cameras, points, camera_model=model, **more), level)


def with_outliers(model: str) -> Problem:
    """Every tenth observation is wrong."""
    return sfmcpp.add_outliers(circle(model), 0.1, seed=2)[0]


def with_sigmas(model: str) -> Problem:
    """Observations of unequal standard deviations."""
    problem = circle(model)
    problem.sigma_px = np.geomspace(0.1, 10.0, problem.num_observations)
    return problem


def with_covariances(model: str) -> Problem:
    """Observations with covariances."""
    problem = circle(model)
    problem.covariance_px2 = np.tile([[4.0, 1.0], [1.0, 0.5]], (problem.num_observations, 1, 1))
    return problem


def with_shared_intrinsics(model: str) -> Problem:
    """One row of intrinsics for all cameras."""
    problem = circle(model)
    problem.intrinsics, problem.fixed_intrinsics = problem.intrinsics[:1], problem.fixed_intrinsics[:1]
    problem.intrinsics_index[:] = 0
    return problem


def with_all_intrinsics_free(model: str) -> Problem:
    """All intrinsics that may be free are."""
    problem = circle(model, 6, 40)
    if sfmcpp.CAMERA_MODELS[model].can_be_free:
        problem.fixed_intrinsics[:] = False
    return problem


def with_fixed_cameras(model: str) -> Problem:
    """Two poses are known."""
    problem = circle(model)
    problem.fixed_cameras[[0, 2]] = True
    return problem


def with_points_alone(model: str) -> Problem:
    """All cameras are known, with their intrinsics."""
    problem = circle(model)
    problem.fixed_cameras[:] = True
    problem.fixed_intrinsics[:] = True
    return problem


def with_cameras_alone(model: str) -> Problem:
    """All points are known."""
    problem = circle(model)
    problem.fixed_points[:] = True
    return problem


def with_points_seen_once(model: str) -> Problem:
    """Half of the observations are missing."""
    return hide_observations(circle(model, 6, 30), 0.5, seed=3)


def of_a_plane(model: str) -> Problem:
    """All points lie in a plane."""
    problem = sfmcpp.circle_scene(5, 20, camera_model=model)
    flat = problem.copy()
    flat.points[:, 2] = 0.0
    flat.pixels -= sfmcpp.residuals(problem) - sfmcpp.residuals(flat)
    return started(flat)


def of_another_unit(model: str) -> Problem:
    """The world in micrometres."""
    problem = circle(model)
    problem.points *= 1e6
    problem.centres[:] *= 1e6
    return problem


SCENES: dict[str, Scene] = {
    "circle": circle,
    "far start": lambda model: circle(model, level=5.0),
    "without noise": lambda model: circle(model, pixel_sigma_px=0.0),
    "much noise": lambda model: circle(model, pixel_sigma_px=20.0),
    "two views": lambda model: circle(model, 2, 30),
    "many cameras": lambda model: circle(model, 16, 12),
    "far away": lambda model: circle(model, radius_m=200.0, level=0.5, focal_px=5000.0),
    "sphere": lambda model: started(sfmcpp.sphere_scene(6, 20, camera_model=model)),
    "corridor": lambda model: started(
        sfmcpp.corridor_scene(6, 120, length_m=6.0, camera_model=model), level=0.3
    ),
    "outliers": with_outliers,
    "standard deviations": with_sigmas,
    "covariances": with_covariances,
    "shared intrinsics": with_shared_intrinsics,
    "free intrinsics": with_all_intrinsics_free,
    "fixed cameras": with_fixed_cameras,
    "points alone": with_points_alone,
    "cameras alone": with_cameras_alone,
    "points seen once": with_points_seen_once,
    "plane": of_a_plane,
    "micrometres": of_another_unit,
}


def start_of(scene: str, model: str) -> Problem:
    """Where every solve of a scene with a camera model starts."""
    if sfmcpp.CAMERA_MODELS[model].metric:
        return SCENES[scene](model)
    return sfmcpp.as_projective(SCENES[scene]("calibrated"))


@dataclass
class Ending:
    """How a combination ended, with the state it returned."""

    way: dict[str, str]
    kind: str
    told: str = ""
    cost: float = np.inf
    scale: float = LOSS_SCALE_PX
    state: Problem | None = None


def cost_of(problem: Problem, loss: str, scale: float) -> float:
    """The cost of a state."""
    squared = (sfmcpp.residuals(problem) ** 2).sum(axis=1)
    return 0.5 * float(_core.loss_terms(loss, scale, squared)[0].sum())


def moved(problem: Problem, step: FloatArray) -> Problem:
    """A state with everything that is free moved by a step."""
    result = problem.copy()
    size = 6 if problem.is_metric else 12
    cameras, points = ~problem.fixed_cameras, ~problem.fixed_points
    sizes = (size * int(cameras.sum()), points.sum() * problem.points.shape[1])
    of_cameras, of_points, of_intrinsics = np.split(step, np.cumsum(sizes))
    rows = of_cameras.reshape(-1, size)
    if problem.is_metric:
        result.rotations[cameras] = problem.rotations[cameras] @ so3.exp(rows[:, :3])
        result.centres[cameras] += rows[:, 3:]
    else:
        result.cameras[cameras] += rows.reshape(-1, 3, 4)
    result.points[points] += of_points.reshape(-1, problem.points.shape[1])
    result.intrinsics[~problem.fixed_intrinsics] += of_intrinsics
    return result


def sizes_of_unknowns(problem: Problem) -> FloatArray:
    """How large what `moved` takes is: radians, lengths of the world, entries of matrices, intrinsics."""
    world = float(np.ptp(problem.points)) if problem.is_metric else 1.0
    of_camera = [1.0, 1.0, 1.0, world, world, world] if problem.is_metric else [1.0] * 12
    free_points = problem.points[~problem.fixed_points]
    intrinsics = np.maximum(np.abs(problem.intrinsics[~problem.fixed_intrinsics]), 1e-2)
    cameras = np.tile(of_camera, int((~problem.fixed_cameras).sum()))
    return np.concatenate([cameras, np.full(free_points.size, world), intrinsics])


def promised_decrease(problem: Problem, loss: str, scale: float, difference: float) -> float:
    """By how much a Gauss–Newton step would lower the cost; derivatives are differences of residuals.

    The weights of observations stay what they are: at the corner of a loss differences tell nothing.
    """
    here = sfmcpp.residuals(problem)
    weights = np.sqrt(_core.loss_terms(loss, scale, (here**2).sum(axis=1))[1])[:, None]
    steps = np.diag(difference * sizes_of_unknowns(problem))
    with np.errstate(all="ignore"):
        columns = [
            weights * (sfmcpp.residuals(moved(problem, step)) - sfmcpp.residuals(moved(problem, -step)))
            for step in steps
        ]
    jacobian = np.nan_to_num(np.stack(columns, axis=-1).reshape(-1, len(steps)))
    jacobian /= np.maximum(np.linalg.norm(jacobian, axis=0), np.finfo(float).tiny)
    basis, singular, _ = np.linalg.svd(jacobian, full_matrices=False)
    told = basis[:, singular > RANK * singular[0]].T @ (weights * here).ravel()
    return 0.5 * float(told @ told)


def ending_of(start: Problem, way: dict[str, str]) -> Ending:
    """Solve, and look at whether what is told is true."""
    state = start.copy()
    scaled = {} if way["loss"] == "squared" else {"loss_scale_px": LOSS_SCALE_PX}
    try:
        told = sfmcpp.solve(state, **way, **scaled, max_iterations=MAX_ITERATIONS, threads=1)
    except InvalidArgument:
        return Ending(way, "refused")
    except Exception as error:
        return Ending(way, "raw exception", f"{type(error).__name__}: {error}")
    scale = told.loss_scale_px
    ending = Ending(
        way, "not converged", f"{told.termination}: {told.message}", told.final_cost, scale, state
    )
    cost = cost_of(state, way["loss"], scale)
    if not np.isclose(told.final_cost, cost, rtol=1e-6, atol=1e-12):
        ending.kind = "untrue"
        ending.told += f" at {told.final_cost}, but the cost is {cost}"
    elif told.converged:
        ending.kind = "converged"
    return ending


class Judge:
    """Tells of the endings with a loss which are at the best cost, and why others are not."""

    def __init__(self, endings: Iterable[Ending], loss: str) -> None:
        self._loss = loss
        # Many combinations end in the same place: the lowest tells of all.
        states = sorted((ending for ending in endings if ending.state is not None), key=lambda e: -e.cost)
        self._places = {self._place_of(ending): ending for ending in states}
        self._promises: dict[str, float] = {}

    @staticmethod
    def _place_of(ending: Ending) -> str:
        return f"{ending.cost:.4g} {ending.scale:.3g}"

    def judge(self, ending: Ending) -> None:
        """Change "converged" into what it is; costs are compared at the ending's scale of the loss."""
        assert ending.state is not None
        states = [place.state for place in self._places.values() if place.state is not None]
        best = min(ending.cost, *(cost_of(state, self._loss, ending.scale) for state in states))
        negligible = SAME_COST * best + NO_COST * ending.state.num_observations
        if ending.cost - best <= negligible:
            ending.kind = "best"
            return
        promised = self._promise(ending, SAME_COST * ending.cost + negligible)
        ending.told += f"; cost {ending.cost:.6g}, best {best:.6g}, a step promises {promised:.3g}"
        if promised <= SAME_COST * ending.cost + negligible:
            ending.kind = "another minimum"
        else:
            ending.kind = "slow" if "function_tolerance" in ending.told else "unexplained"

    def _promise(self, ending: Ending, enough: float) -> float:
        place = self._place_of(ending)
        if place not in self._promises:
            lowest = self._places[place]
            assert lowest.state is not None
            for difference in DIFFERENCES:
                promised = promised_decrease(lowest.state, self._loss, lowest.scale, difference)
                self._promises[place] = min(promised, self._promises.get(place, np.inf))
                if self._promises[place] <= enough:
                    break
        return self._promises[place]


def endings_of(scene: str, model: str) -> list[Ending]:
    """All combinations on one scene with one camera model."""
    start = start_of(scene, model)
    ways = [dict(zip(WAYS, chosen, strict=True)) for chosen in product(*(CHOICES[name] for name in WAYS))]
    endings = [ending_of(start, way) for way in ways]
    for loss in CHOICES["loss"]:
        with_loss = [ending for ending in endings if ending.way["loss"] == loss]
        judge = Judge(with_loss, loss)
        for ending in with_loss:
            if ending.kind == "converged":
                judge.judge(ending)
    for ending in endings:
        ending.state = None
    return endings


class Results:
    """What was found so far, by scene and camera model; a line of a file for each, if there is a file."""

    def __init__(self, path: Path | None) -> None:
        self._path = path
        lines = path.read_text().splitlines() if path and path.exists() else []
        self._known = {(line["scene"], line["model"]): line["endings"] for line in map(json.loads, lines)}

    def knows(self, case: tuple[str, str]) -> bool:
        """Whether a scene was tried with a camera model."""
        return case in self._known

    def endings(self, case: tuple[str, str]) -> list[Ending]:
        """What was found."""
        return [Ending(*found) for found in self._known[case]]

    def add(self, case: tuple[str, str], endings: list[Ending]) -> None:
        """Keep what was found."""
        found = [
            [ending.way, ending.kind, "" if ending.kind == "best" else ending.told] for ending in endings
        ]
        self._known[case] = found
        if self._path:
            with self._path.open("a") as file:
                file.write(json.dumps({"scene": case[0], "model": case[1], "endings": found}) + "\n")


def main(scenes: list[str], processes: int, results: Results) -> int:
    """Print the tables; 1 if there is a fault."""
    cases = list(product(scenes, sfmcpp.CAMERA_MODELS))
    everything: list[Ending] = []
    print(row_of("scene", "cameras", ENDS))
    with ProcessPoolExecutor(processes) as pool:
        begun = {case: pool.submit(endings_of, *case) for case in cases if not results.knows(case)}
        for case in cases:
            if case in begun:
                results.add(case, begun[case].result())
            endings = results.endings(case)
            everything += endings
            print(row_of(*case, counts_of(endings)), flush=True)
            for ending in endings:
                if ending.kind in FAULTS:
                    print(f"  {', '.join(ending.way.values())}: {ending.kind}: {ending.told}")
    print(row_of("all", str(len(everything)), counts_of(everything)))
    for kind in ("another minimum", "slow", "not converged"):
        print_by_method([ending for ending in everything if ending.kind == kind], kind)
    return int(any(ending.kind in FAULTS for ending in everything))


def counts_of(endings: list[Ending]) -> list[int]:
    """How many ended in each way."""
    counts = Counter(ending.kind for ending in endings)
    return [counts[kind] for kind in ENDS]


def print_by_method(endings: list[Ending], title: str) -> None:
    """A table of how many there are, by method and line search."""
    counts = Counter((ending.way["method"], ending.way["line_search"]) for ending in endings)
    print("\n" + row_of(title, "", CHOICES["line_search"]))
    for method in CHOICES["method"]:
        print(row_of(method, "", [counts[method, search] for search in CHOICES["line_search"]]))


def row_of(name: str, second: str, cells: Iterable[object]) -> str:
    """A line of a table."""
    return f"{name:<20}{second:<13}" + "".join(f"{cell:>16}" for cell in cells)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--results", type=Path)
    given = parser.parse_args()
    sys.exit(main(given.scenes, given.processes, Results(given.results)))
