"""Weights of sensors for a whole adjustment: how well their noise is found, and what that is worth."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

import sfmcpp
from experiments.description import Experiment, Row
from experiments.pictures import grouped_bars
from experiments.report import Report
from experiments.starts import noisy_scene, true_scene
from sfmcpp import ConstraintGroup, Problem, Summary
from sfmcpp.geometry import fit_similarity
from sfmcpp.geometry.so3 import exp
from sfmcpp.study.plotting.style import new_figure, style_axes

NOTES = (
    "sigma: estimated over true standard deviation of each sensor, medians; spread: largest factor by which",
    "any run is off, either way. error: RMS of the camera centres after the best similarity, over that with",
    "the true standard deviations; median and worst run. none: images alone; too large: true weights × 1e4.",
    "disagrees: runs in which a sensor is named. times: seconds over those of one solve.",
)
COLUMNS = ("case", "method", "sigma", "spread", "error", "worst", "disagrees", "times")


def whole_weights(experiment: Experiment) -> Report:
    """Solve every case with every method and the baselines."""
    rows = [row for case in experiment.settings["cases"] for row in _rows(experiment, case)]
    return Report(NOTES, ("case", "method"), COLUMNS, rows, _picture(rows))


def _rows(experiment: Experiment, case: Row) -> list[Row]:
    methods = ["none", "true", "too large", *experiment.settings["methods"]]
    runs = [_run(experiment, case, methods, seed) for seed in experiment.seeds]
    return [
        _row(case, method, [run[method] for run in runs], [run["true"] for run in runs]) for method in methods
    ]


def _run(experiment: Experiment, case: Row, methods: Sequence[str], seed: int) -> dict[str, Row]:
    truth = true_scene(experiment, seed)
    start = noisy_scene(experiment, experiment.noise[0], seed)
    rng = np.random.default_rng([seed, 1])
    groups = [_group(truth, sensor, rng) for sensor in case["sensors"]]
    true = [group.weight for group in groups]
    found = {}
    for method in methods:
        factor = {"none": 0.0, "too large": experiment.settings["too_large"]}.get(method, 1.0)
        for group, weight in zip(groups, true, strict=True):
            group.weight = factor * weight
        chosen = method if method in experiment.settings["methods"] else None
        found[method] = _measured(truth, start, groups, case["sensors"], chosen, experiment.options)
    return found


def _measured(
    truth: Problem,
    start: Problem,
    groups: list[ConstraintGroup],
    sensors: list[Row],
    method: str | None,
    options: Row,
) -> Row:
    problem = start.copy()
    begin = time.perf_counter()
    summary = sfmcpp.solve(problem, constraints=groups, weight=method, **options)
    return {
        "seconds": time.perf_counter() - begin,
        "error": _centre_rms(problem, truth),
        "ratios": _ratios(summary, sensors),
        "disagrees": any(chosen.conflict.conflicting for chosen in summary.group_weights),
    }


def _centre_rms(problem: Problem, truth: Problem) -> float:
    moved = fit_similarity(problem.centres, truth.centres).apply(problem.centres)
    return float(np.sqrt(np.mean(np.sum((moved - truth.centres) ** 2, axis=1))))


def _ratios(summary: Summary, sensors: list[Row]) -> list[float]:
    return [
        c.sensor_sigma / sensor["sigma"] for c, sensor in zip(summary.group_weights, sensors, strict=False)
    ]


def _group(truth: Problem, sensor: Row, rng: np.random.Generator) -> ConstraintGroup:
    """Measurements of a sensor at its true weight, some of them wrong if it is faulty."""
    count, sigma = truth.num_cameras, sensor["sigma"]
    faulty = slice(*sensor.get("members", [0, 0]))
    pairs = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    if sensor["kind"] == "gps":
        positions = truth.centres + rng.normal(0, sigma, (count, 3))
        positions[faulty, 0] += sensor.get("offset_m", 0.0)
        return ConstraintGroup("position", np.arange(count), positions, 3 / sigma**2, name="gps")
    if sensor["kind"] == "odometer":
        steps = np.linalg.norm(np.diff(truth.centres, axis=0), axis=1) + rng.normal(0, sigma, count - 1)
        steps[faulty] *= sensor.get("factor", 1.0)
        return ConstraintGroup("scale", pairs, steps, 1 / sigma**2, name="odometer")
    turns = (
        np.swapaxes(truth.rotations[:-1], 1, 2)
        @ truth.rotations[1:]
        @ exp(rng.normal(0, sigma, (count - 1, 3)))
    )
    return ConstraintGroup("displacement-rotation-log", pairs, turns, 3 / sigma**2, name="gyro")


def _row(case: Row, method: str, runs: list[Row], true: list[Row]) -> Row:
    ratios = np.array([run["ratios"] for run in runs])
    errors = np.array([run["error"] for run in runs]) / [run["error"] for run in true]
    seconds = np.array([run["seconds"] for run in runs]) / [run["seconds"] for run in true]
    return {
        "case": case["label"],
        "method": method,
        "sigma": np.median(ratios, axis=0).tolist() or None,
        "spread": np.exp(np.abs(np.log(ratios)).max(axis=0)).tolist() or None,
        "error": float(np.median(errors)),
        "worst": float(errors.max()),
        "disagrees": sum(run["disagrees"] for run in runs) if ratios.size else None,
        "times": float(np.median(seconds)),
    }


def _picture(rows: list[Row]) -> Figure:
    cases = list(dict.fromkeys(row["case"] for row in rows))
    methods = [m for m in dict.fromkeys(row["method"] for row in rows) if m != "true"]
    figure = new_figure(12, 4.5)
    axes = figure.subplots()
    grouped_bars(axes, {m: [row["error"] for row in rows if row["method"] == m] for m in methods})
    axes.axhline(1, color="0.4", linewidth=1)
    axes.set_yscale("log")
    axes.set_ylabel("error over that with the true σ")
    axes.set_xticks(range(len(cases)), cases, fontsize=6, rotation=15)
    style_axes(axes)
    axes.legend(fontsize=8, frameon=False, ncols=4)
    return figure
