"""Which lengths an algebraic line search proposes, iteration by iteration (thesis tables 4.4–4.6)."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.acceptance import length_is_taken
from experiments.description import Experiment, Row
from experiments.factorised import factorised_starts
from experiments.pictures import figure_legend, line_style
from experiments.report import Report
from experiments.runs import Run, camera_models, solve_in_turn
from experiments.starts import synthetic_starts
from sfmcpp.ba import Iteration
from sfmcpp.study.plotting.style import new_figure, style_axes

NOTES = (
    "proposed: α of G-ALS, αP αQ of T-ALS; all real roots. taken: one of them was, in an accepted step.",
    "G-ALS and T-ALS start alike, and go their own ways from the first length on.",
)
SHOWN = (-1.0, 3.0)
COLUMNS = ("camera_model", "label", "iteration", "proposed", "taken", "cost")


def proposed_lengths(experiment: Experiment) -> Report:
    """Run the algebraic searches from one start and list what they propose."""
    starts = [*synthetic_starts(experiment), *factorised_starts(experiment)]
    runs = solve_in_turn(starts, experiment.solve_options())
    runs.sort(key=lambda run: (run.camera_model, run.label))
    rows = [_row(run, iteration) for run in runs for iteration in run.summary.iterations[1:]]
    return Report(NOTES, ("label", "camera_model", "iteration"), COLUMNS, rows, _picture(runs))


def _row(run: Run, iteration: Iteration) -> Row:
    two_way = run.summary.line_search == "t-als"
    pairs = iteration.proposed_lengths
    return {
        "label": run.label,
        "camera_model": run.camera_model,
        "iteration": iteration.iteration,
        "proposed": [length for pair in pairs for length in (pair if two_way else pair[:1])],
        "taken": length_is_taken(iteration),
        "cost": iteration.cost,
    }


def _picture(runs: list[Run]) -> Figure:
    models = camera_models(runs)
    figure = new_figure(5.2 * len(models), 4.0)
    panels = figure.subplots(1, len(models), squeeze=False)[0]
    for axes, model in zip(panels, models, strict=True):
        for run in (run for run in runs if run.camera_model == model):
            _draw(axes, run)
        _finish(axes, model)
    panels[0].set_ylabel("length proposed (at the edge: beyond it)")
    figure_legend(panels[0], 3)
    return figure


def _draw(axes: Axes, run: Run) -> None:
    color = line_style(run.label)["color"]
    for part, (symbol, marker) in enumerate(_symbols(run)):
        for taken, face in ((True, color), (False, "none")):
            at, lengths = _points(run, part, taken)
            label = f"{run.label} {symbol}, {'taken' if taken else 'not taken'}"
            axes.plot(at, lengths, marker, color=color, markerfacecolor=face, label=label)


def _symbols(run: Run) -> list[tuple[str, str]]:
    return [("αP", "^"), ("αQ", "v")] if run.summary.line_search == "t-als" else [("α", "o")]


def _points(run: Run, part: int, taken: bool) -> tuple[list[int], list[float]]:
    """Iterations and lengths of one part, of the iterations that took a length or did not; cut to `SHOWN`."""
    found = [i for i in run.summary.iterations if length_is_taken(i) is taken]
    pairs = [(i.iteration, pair[part]) for i in found for pair in i.proposed_lengths]
    return [at for at, _ in pairs], [min(max(length, SHOWN[0]), SHOWN[1]) for _, length in pairs]


def _finish(axes: Axes, model: str) -> None:
    style_axes(axes)
    axes.axhline(1, color="0.3", linewidth=0.8)
    axes.set_ylim(SHOWN[0] - 0.2, SHOWN[1] + 0.2)
    axes.set_xlabel("iteration")
    axes.set_title(model, fontsize=10)
