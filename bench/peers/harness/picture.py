"""The picture: how far each solver is from the best cost after how many seconds."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from harness.measure import Run
from harness.summary import ACCURACIES, Row
from harness.table import display_title, is_best_of_peer

FLOOR = 2e-6
COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:purple", "tab:brown", "tab:cyan")
OWN_COLOUR = "tab:red"
DASHES = ("-", "--", ":", "-.")


def draw(curves: Sequence[tuple[Row, Run]], heading: str, path: Path) -> None:
    """One curve per solver, log–log: (cost − best) / best of the accepted state against seconds."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 6.2), layout="constrained")
    axes = figure.add_subplot()
    rows = [row for row, _ in curves]
    for (row, run), style in zip(curves, _styles(rows), strict=True):
        seconds, excess = _curve(row, run)
        label = display_title(row, is_best_of_peer(row, rows))
        axes.plot(seconds, excess, label=label, drawstyle="steps-post", marker=".", markersize=5, **style)
    _decorate(axes, heading)
    figure.savefig(path, dpi=130)


def _curve(row: Row, run: Run) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """The start is left out where its time is too small for the logarithm to show."""
    seconds, costs = np.array(run.outcome.trace).T
    excess = np.maximum(costs / row.best_cost - 1.0, FLOOR)
    shown = seconds > 1e-4
    return seconds[shown], excess[shown]


def _styles(rows: list[Row]) -> list[dict[str, Any]]:
    """A colour for each peer; within a peer the best is thick and solid, the others thin and dashed."""
    others = sorted({row.peer for row in rows} - {"sfmcpp"})
    colours = {"sfmcpp": OWN_COLOUR, **dict(zip(others, cycle(COLOURS), strict=False))}
    seen: dict[str, int] = {}
    styles = []
    for row in rows:
        position = seen.get(row.peer, 0)
        seen[row.peer] = position + 1
        style = {"color": colours[row.peer], "linestyle": DASHES[position % len(DASHES)]}
        styles.append({**style, "linewidth": 2.2 if position == 0 else 1.0})
    return styles


def _decorate(axes: Any, heading: str) -> None:
    axes.set(xscale="log", yscale="log", xlabel="seconds since the solve began (reading excluded)")
    axes.set_ylabel("(cost − best) / best")
    axes.set_title(heading, fontsize=11)
    axes.set_ylim(bottom=FLOOR / 1.5)
    for accuracy in ACCURACIES:
        axes.axhline(accuracy, color="0.35", linewidth=0.8, linestyle=(0, (6, 3)))
        axes.annotate(
            f"{accuracy:.0e}",
            (0.004, accuracy),
            xycoords=("axes fraction", "data"),
            va="bottom",
            fontsize=8,
            color="0.35",
        )
    axes.grid(which="major", color="0.9")
    axes.legend(fontsize=8.5, loc="upper right", framealpha=0.95)
