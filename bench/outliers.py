"""Gross errors: how close each robust loss comes to a solution that knows which observations are wrong.

    python bench/outliers.py [--scenes circle …] [--losses auto …] [--shares 0 0.3 0.5] [--seeds 10]
                             [--first-seed 100] [--out FILE]

A share of the observations is replaced by uniformly random pixels, or swapped between points of the same
image. The clean solution is of the right observations alone, from the same start, by least squares. A line
for each scene, share and loss, over the seeds:

    excess      cost of the right observations, over that of the clean solution, less one: median and worst,
                of points with three right observations or more (of fewer nobody can tell which are right)
    excess 2    the same with points of two right observations
    within 1 %  how many runs have an excess of at most 0.01
    told        median share of the wrong observations that the loss gives less than half their weight
    kept        median share of the right observations, of the points of `excess`, that it gives more
    time        seconds over those of least squares on the same observations: median

Losses but `auto` take their scale from the residuals at the start. Seeds below 100 were used for tuning:
circle, street, both BAL problems with real pixels and with normal noise; the geometry and the start of a BAL
problem are the same for every seed. BAL problems are read from $SFMCPP_DATA/bal.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from experiments.text_table import text_table
from numpy.typing import NDArray

import sfmcpp
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray

LOSSES = ("huber", "cauchy", "tukey", "auto")
WITHIN = 0.01
Row = dict[str, Any]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print."""
    args = _parser().parse_args(arguments)
    rows: list[Row] = []
    for scene in args.scenes:
        for share, kind in [(s, k) for s in args.shares for k in (("random", "swapped") if s else ("",))]:
            for seed in range(args.first_seed, args.first_seed + args.seeds):
                rows += runs(scene, share, kind, seed, args.losses)
    print(text_table(COLUMNS, table(rows)))
    if args.out:
        args.out.write_text(json.dumps(rows))


def runs(scene: str, share: float, kind: str, seed: int, losses: Sequence[str]) -> list[Row]:
    """Each loss on a scene with wrong observations."""
    start = SCENES[scene](seed)
    problem, wrong = SPOILED[kind](start, share, np.random.default_rng(seed))
    clean = problem.with_observations(~wrong).copy()
    sfmcpp.solve(clean, max_iterations=300, function_tolerance=1e-9)
    squared_s = _solve(problem.copy(), "squared")[1]
    found = []
    for loss in losses:
        moved = problem.copy()
        summary, seconds = _solve(moved, loss)
        weights = sfmcpp.linearize(moved, loss=loss, loss_scale_px=summary.loss_scale_px).observation_weights
        views = np.bincount(clean.point_index, minlength=clean.num_points)[problem.point_index]
        row = {"scene": scene, "share": share, "kind": kind, "seed": seed, "loss": loss}
        row |= {f"excess {least}": _excess(moved, clean, ~wrong, views >= least) for least in (2, 3)}
        row["told"] = float(np.mean(weights[wrong] < 0.5)) if wrong.any() else None
        row["kept"] = float(np.mean(weights[~wrong & (views >= 3)] >= 0.5))
        found.append(row | {"time": seconds / squared_s, "scale": summary.loss_scale_px})
    return found


def _solve(problem: Problem, loss: str) -> tuple[sfmcpp.Summary, float]:
    start = time.perf_counter()
    scale: Any = 1.0 if loss in ("auto", "squared") else "auto"
    summary = sfmcpp.solve(problem, loss=loss, loss_scale_px=scale, max_iterations=300)
    return summary, time.perf_counter() - start


def _excess(moved: Problem, clean: Problem, right: BoolArray, counted: BoolArray) -> float:
    """Of the cost of the right observations that are counted, over that of the clean solution."""
    ours = _squares(moved.with_observations(right & counted))
    return float(ours / _squares(clean.with_observations(counted[right])) - 1.0)


def _squares(problem: Problem) -> float:
    return float((sfmcpp.linearize(problem).residuals ** 2).sum())


def _circle(seed: int) -> Problem:
    return _perturbed(sfmcpp.circle_scene(20, 300, pixel_sigma_px=0.5, seed=seed), seed)


def _street(seed: int) -> Problem:
    return _perturbed(sfmcpp.city_blocks_scene(30, seed=seed), seed)


def _perturbed(scene: Problem, seed: int) -> Problem:
    return sfmcpp.perturb(scene, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=seed)


def _bal(name: str) -> Callable[[int], Problem]:
    return lambda _: sfmcpp.read(Path(os.environ["SFMCPP_DATA"]) / "bal" / name)


def _bal_with_normal_noise(name: str) -> Callable[[int], Problem]:
    """A problem with the pixels that its solution predicts, and noise of half a pixel."""

    def scene(seed: int) -> Problem:
        start = _bal(name)(seed)
        solved = start.copy()
        sfmcpp.solve(solved, max_iterations=100)
        noise = np.random.default_rng(seed).normal(0.0, 0.5, start.pixels.shape)
        return replace(start, pixels=start.pixels - sfmcpp.linearize(solved).residuals + noise)

    return scene


_BAL = {"bal-1800": "ladybug-49-shrink-1800.txt", "bal-7776": "problem-49-7776-pre.txt.bz2"}
SCENES: dict[str, Callable[[int], Problem]] = {
    "circle": _circle,
    "street": _street,
    **{name: _bal(file) for name, file in _BAL.items()},
    **{f"{name}-normal": _bal_with_normal_noise(file) for name, file in _BAL.items()},
}

Spoiled = Callable[[Problem, float, np.random.Generator], tuple[Problem, BoolArray]]


def _random(problem: Problem, share: float, rng: np.random.Generator) -> tuple[Problem, BoolArray]:
    """Pixels anywhere in the rectangle that the observations take up."""
    wrong = _chosen(problem.num_observations, share, rng)
    corners = problem.pixels.min(axis=0), problem.pixels.max(axis=0)
    return _with_pixels(problem, wrong, rng.uniform(*corners, (int(wrong.sum()), 2))), wrong


def _swapped(problem: Problem, share: float, rng: np.random.Generator) -> tuple[Problem, BoolArray]:
    """Of each image, the pixels of some points, passed on from one to the next."""
    wrong = np.zeros(problem.num_observations, dtype=np.bool_)
    source = np.arange(problem.num_observations)
    for camera in range(problem.num_cameras):
        rows = np.flatnonzero(problem.camera_index == camera)
        rows = rng.permutation(rows[_chosen(len(rows), share, rng)])
        if len(rows) > 1:
            source[rows], wrong[rows] = np.roll(rows, 1), True
    return _with_pixels(problem, wrong, problem.pixels[source[wrong]]), wrong


SPOILED: dict[str, Spoiled] = {"": _random, "random": _random, "swapped": _swapped}


def _chosen(count: int, share: float, rng: np.random.Generator) -> BoolArray:
    chosen = np.zeros(count, dtype=np.bool_)
    chosen[rng.permutation(count)[: round(share * count)]] = True
    return chosen


def _with_pixels(problem: Problem, rows: BoolArray, pixels: FloatArray) -> Problem:
    result = problem.copy()
    result.pixels[rows] = pixels
    return result


COLUMNS = (
    *("scene", "share", "kind", "loss", "excess", "worst", "excess 2", "worst 2", "within 1 %"),
    *("told", "kept", "time"),
)


def table(rows: Sequence[Row]) -> list[Row]:
    """A line for each scene, share, kind and loss."""
    names = ("scene", "share", "kind", "loss")
    cases = dict.fromkeys(tuple(row[name] for name in names) for row in rows)
    return [
        {
            **dict(zip(names, case, strict=True)),
            **_line([r for r in rows if tuple(r[n] for n in names) == case]),
        }
        for case in cases
    ]


def _line(rows: Sequence[Row]) -> Row:
    of = lambda name: np.array([row[name] for row in rows if row[name] is not None])  # noqa: E731
    within = int(np.sum(of("excess 3") <= WITHIN))
    line: Row = {"excess": _median(of("excess 3")), "worst": float(of("excess 3").max())}
    line |= {"excess 2": _median(of("excess 2")), "worst 2": float(of("excess 2").max())}
    line |= {name: _median(of(name)) for name in ("told", "kept", "time")}
    return line | {"within 1 %": f"{within} of {len(rows)}"}


def _median(values: NDArray[np.float64]) -> float | None:
    return float(np.median(values)) if len(values) else None


def _parser() -> argparse.ArgumentParser:
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--losses", nargs="+", default=list(LOSSES), choices=sfmcpp.ba.LOSSES)
    parser.add_argument("--shares", nargs="+", type=float, default=[0.0, 0.3, 0.5])
    parser.add_argument("--seeds", type=int, default=10, help="runs of each")
    parser.add_argument("--first-seed", type=int, default=100)
    parser.add_argument("--out", type=Path, help="JSON file of all runs")
    return parser


if __name__ == "__main__":
    main()
