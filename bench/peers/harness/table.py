"""Rows as a Markdown table."""

from __future__ import annotations

import math

from harness.protocol import Objective
from harness.summary import ACCURACIES, MEGABYTE, Row

HEADINGS = (
    "solver",
    *(f"s to {eps:g}" for eps in ACCURACIES),
    "ms / iteration",
    "iterations (to 1e-3)",
    "final cost",
    "peak MB above: start",
    "imports",
    "inputs",
)


def markdown_table(rows: list[Row]) -> str:
    """The rows sorted by time to 1e-3, with the best of each peer marked; times are median (min)."""
    ordered = sorted(rows, key=lambda row: row.rank)
    cells = [list(HEADINGS), *(_cells(row, is_best_of_peer(row, rows)) for row in ordered)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(HEADINGS))]
    lines = ["| " + " | ".join(map(str.ljust, line, widths)) + " |" for line in cells]
    rule = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
    return "\n".join([lines[0], rule, *lines[1:]])


def is_best_of_peer(row: Row, rows: list[Row]) -> bool:
    """Whether the row is the first of several of its peer."""
    family = [other for other in rows if other.peer == row.peer]
    return len(family) > 1 and row is min(family, key=lambda other: other.rank)


def display_title(row: Row, is_best: bool) -> str:
    """`Ceres (dense)` becomes `Ceres (best: dense)`; a dagger marks the objective that leaves points out."""
    title = row.title.replace("(", "(best: ", 1) if is_best else row.title
    return title + (" †" if row.objective is Objective.IN_FRONT else "")


def notes(rows: list[Row]) -> list[str]:
    """What has to be said about single rows: their settings, other objectives, unconfirmed costs."""
    lines = [f"{row.title}: {row.settings}; stopped by: {row.message}" for row in rows]
    lines += [
        f"† {row.title} gives observations behind their camera no residual: its targets are relative to the "
        f"lowest such cost here, {row.best_cost:.7g}. Over all observations ({row.observations_behind} of "
        f"them behind) its final cost is {row.checked_cost_all:.7g}"
        for row in rows
        if row.objective is Objective.IN_FRONT
    ]
    lines += [
        f"UNCONFIRMED: {row.title} claims {row.own_cost:.9g}, NumPy finds {row.checked_cost:.9g}"
        for row in rows
        if not row.cost_is_confirmed
    ]
    return lines


def _cells(row: Row, is_best: bool) -> list[str]:
    times = [_times(row, f"{eps:g}") for eps in ACCURACIES]
    to_target = row.iterations_to["0.001"]
    return [
        display_title(row, is_best),
        *times,
        f"{1e3 * row.seconds_per_iteration:.2f} ({1e3 * row.seconds_per_iteration_min:.2f})",
        f"{row.iterations} ({'—' if to_target is None else to_target})",
        f"{row.own_cost:.2f}{'' if row.cost_is_confirmed else ' ?'}",
        *(_megabytes(value) for value in (row.above_start, row.above_imports, row.above_inputs)),
    ]


def _times(row: Row, accuracy: str) -> str:
    middle, least = row.seconds_to_median[accuracy], row.seconds_to_min[accuracy]
    return f"{middle:.4f} ({least:.4f})" if math.isfinite(middle) else "—"


def _megabytes(value: int | None) -> str:
    return "—" if value is None else f"{value / MEGABYTE:.1f}"
