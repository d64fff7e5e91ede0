"""Real problems with and without line searches, as files and factorisation leave them (thesis table 4.7)."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.factorised import factorised_starts
from experiments.measures import steps_tried
from experiments.pictures import line_style
from experiments.report import Report
from experiments.runs import Run, solve_in_turn
from experiments.starts import Start, real_starts
from sfmcpp.study.plotting.style import new_figure, style_axes

TOLERATED = 1e-4
NOTES = (
    "above: largest final cost of a line search over that of its method without one, minus one.",
    f"A violation is a line search that ends more than {TOLERATED:g} above.",
    "rms: sqrt(Σ‖r‖² / 2M) in pixels. iterations, seconds: until the stopping rule, one thread, in turn;",
    "  without, G-ALS, T-ALS, and for ours exact, soft and backtracking search; from factorisation then",
    "  G-ALS and T-ALS where the unit step is rejected, and both where λ > 1e-4.",
)
COLUMNS = (
    "problem",
    "camera_model",
    "method",
    "cameras",
    "points",
    "rms_initial",
    "rms_final",
    "above",
    "iterations",
    "seconds",
)


def real_problems(experiment: Experiment) -> Report:
    """Solve every real problem by every method."""
    methods = experiment.solve_options()
    usual = {label: options for label, options in methods.items() if not _is_triggered(options)}
    starts, poor = list(real_starts(experiment)), list(factorised_starts(experiment))
    runs = solve_in_turn(starts, usual) + solve_in_turn(poor, methods)
    starts += poor
    rows = [_row(run, _reference(run, runs), _start(run, starts)) for run in runs]
    for row in rows:
        row["start"] = "factorisation" if row["problem"] in {start.name for start in poor} else "file"
    rows.sort(key=lambda row: (row["problem"], row["camera_model"], experiment.methods.index(row["label"])))
    notes = (*NOTES, *violations(rows))
    return Report(
        notes,
        ("problem", "camera_model", "method"),
        COLUMNS,
        rows,
        _picture(rows, experiment),
        _in_short(rows),
    )


def _is_triggered(options: Row) -> bool:
    return "line_search_on_rejection" in options or "line_search_damping" in options


def _in_short(rows: list[Row]) -> list[Row]:
    """One row for each problem and method, with a list for its line searches."""
    groups: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["problem"], row["camera_model"], row["method"]), []).append(row)
    return [
        {
            **group[0],
            "above": max(row["above"] for row in group),
            "iterations": [row["iterations"] for row in group],
            "seconds": [row["seconds"] for row in group],
        }
        for group in groups.values()
    ]


def violations(rows: list[Row]) -> list[str]:
    """Count the violations on problems from files and name each; a line for the others."""
    searched = [row for row in rows if row["line_search"] != "none"]
    of_files = [row for row in searched if row["start"] == "file"]
    found = [row for row in of_files if row["above"] > TOLERATED]
    notes = [
        f"{len(found)} violations in {len(of_files)} solves from files with a line search.",
        *(f"  {r['problem']} {r['camera_model']} {r['label']}: {r['above']:.3g} above" for r in found),
    ]
    others = [row["above"] for row in searched if row["start"] != "file"]
    if others:
        above, below = (sum(sign * value > TOLERATED for value in others) for sign in (1, -1))
        notes.append(f"From factorisation, of {len(others)} {above} end above and {below} below.")
    return notes


def _reference(run: Run, runs: list[Run]) -> Run:
    """The run of the same method without line search from the same start."""
    method = run.label.partition("+")[0]
    return next(other for other in runs if other.start == run.start and other.label == method)


def _start(run: Run, starts: list[Start]) -> Start:
    return next(s for s in starts if (s.name, s.problem.camera_model) == run.start[:2])


def _row(run: Run, reference: Run, start: Start) -> Row:
    summary = run.summary
    return {
        "problem": start.name,
        "camera_model": run.camera_model,
        "cameras": start.problem.num_cameras,
        "points": start.problem.num_points,
        "observations": start.problem.num_observations,
        "label": run.label,
        "method": summary.method,
        "line_search": summary.line_search,
        "rms_initial": summary.initial_rms_px,
        "rms_final": summary.final_rms_px,
        "final_cost": summary.final_cost,
        "above": summary.final_cost / reference.summary.final_cost - 1,
        "iterations": steps_tried(run),
        "termination": summary.termination,
        "seconds": summary.seconds_total,
    }


def _picture(rows: list[Row], experiment: Experiment) -> Figure:
    """Iterations on each problem, the methods side by side."""
    problems = list(dict.fromkeys(_title(row) for row in rows))
    methods = list(dict.fromkeys(row["method"] for row in rows))
    figure = new_figure(5.2 * len(methods), 1.5 + 0.36 * len(problems))
    panels = figure.subplots(1, len(methods), sharey=True, squeeze=False)[0]
    for axes, method in zip(panels, methods, strict=True):
        searches = [label for label in experiment.methods if _method(experiment, label) == method]
        for number, label in enumerate(searches):
            shift = min(0.13, 0.8 / len(searches)) * (number - (len(searches) - 1) / 2)
            _draw(axes, [row for row in rows if row["label"] == label], problems, shift)
        _finish(axes, method)
    panels[0].set_yticks(range(len(problems)), problems)
    panels[0].invert_yaxis()
    return figure


def _title(row: Row) -> str:
    return f"{row['problem']}, {row['camera_model']}"


def _method(experiment: Experiment, label: str) -> str:
    method: str = experiment.solve_options()[label]["method"]
    return method


def _draw(axes: Axes, rows: list[Row], problems: list[str], shift: float) -> None:
    at = [problems.index(_title(row)) + shift for row in rows]
    style = line_style(rows[0]["label"]) | {"linestyle": "none"}
    axes.plot([row["iterations"] for row in rows], at, markersize=4, **style)


def _finish(axes: Axes, method: str) -> None:
    style_axes(axes)
    axes.set_xscale("log")
    axes.set_xticks([5, 10, 20, 50, 100], ["5", "10", "20", "50", "100"])
    axes.minorticks_off()
    axes.set_xlabel(f"iterations of {method} until the stopping rule")
    axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0, 1), ncols=2, frameon=False)
