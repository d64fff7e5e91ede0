"""The convergence figure shows the history it is given, and leaves the rest of the process alone."""

from __future__ import annotations

import os
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sfmcpp import InvalidArgument, Iteration, Summary, solve
from sfmcpp.sources.synthetic import circle_scene, perturb
from sfmcpp.study.plotting import plot_convergence, save_figure


def history(costs: list[float], accepted: list[bool]) -> list[Iteration]:
    return [
        Iteration(k, cost, 0.5 * k, taken, 1e-3, 1.0, 1.0, (1.0, 1.0), 0)
        for k, (cost, taken) in enumerate(zip(costs, accepted, strict=True))
    ]


RUN = history([100.0, 10.0, 10.0, 2.0], [True, True, False, True])


def points_of(axes: Axes, marker: str) -> list[tuple[float, float]]:
    """All points drawn on the axes with that marker; "None" is the curve itself."""
    lines = [np.asarray(line.get_xydata(), dtype=float) for line in axes.lines if line.get_marker() == marker]
    return [(x, y) for line in lines for x, y in line.tolist()]


def legend_of(figure: Figure) -> list[str]:
    legend = figure.axes[0].get_legend()
    return [] if legend is None else [text.get_text() for text in legend.get_texts()]


@pytest.mark.parametrize("count", [2, 20])
def test_no_two_of_many_runs_look_alike_and_a_long_legend_hides_none(count: int) -> None:
    figure = plot_convergence({f"run {k}": RUN for k in range(count)})
    by_iteration, by_seconds = figure.axes
    curves = [line for line in by_iteration.lines if line.get_marker() == "None"]
    assert len({(line.get_color(), line.get_linestyle()) for line in curves}) == count
    legends = [axes.get_legend() is not None for axes in (by_iteration, by_seconds)]
    assert legends == [count == 2, count == 20]
    if count == 20:
        figure.canvas.draw()
        assert by_seconds.get_legend().get_window_extent().x0 >= by_seconds.get_window_extent().x1
        assert by_seconds.get_legend().get_window_extent().x1 <= figure.bbox.x1


def test_cost_above_the_lowest_is_drawn_against_iterations_and_against_seconds() -> None:
    by_iteration, by_seconds = plot_convergence(RUN).axes
    assert points_of(by_iteration, "None") == [(0, 49), (1, 4), (2, 4), (3, 0.3 * 4)]
    assert points_of(by_seconds, "None") == [(0, 49), (0.5, 4), (1.0, 4), (1.5, 0.3 * 4)]
    assert by_iteration.get_ylabel() == "(cost − 2) / 2"
    assert (by_iteration.get_xlabel(), by_seconds.get_xlabel()) == ("iteration", "time [s]")
    assert by_iteration.get_yscale() == by_seconds.get_yscale() == "log"


def test_accepted_steps_are_dots_and_rejected_ones_crosses() -> None:
    figure = plot_convergence(RUN)
    assert points_of(figure.axes[0], "o") == [(0, 49), (1, 4), (3, 0.3 * 4)]
    assert points_of(figure.axes[0], "x") == [(2, 4)]
    assert legend_of(figure) == ["accepted step", "rejected step", "within 1e-09 of the lowest"]


def test_costs_whose_height_is_not_drawn_to_scale_are_open_dots() -> None:
    figure = plot_convergence(history([100.0, 2.0 + 1e-11, 2.0], [True] * 3))
    dots = [line for line in figure.axes[0].lines if line.get_marker() == "o"]
    open_dots = [line for line in dots if line.get_markerfacecolor() == "white"]
    assert [np.asarray(line.get_xdata()).tolist() for line in open_dots] == [[1, 2]]
    exact = plot_convergence(history([100.0, 4.0], [True] * 2), best_cost=2.0)
    assert not any(
        len(np.asarray(line.get_xdata()))
        for line in exact.axes[0].lines
        if line.get_markerfacecolor() == "white"
    )


def test_without_matplotlib_the_extra_is_named() -> None:
    code = "import sys; sys.modules['matplotlib'] = None; import sfmcpp.study.plotting"
    failed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "figures need matplotlib: pip install 'sfmcpp[plot]'" in failed.stderr


def test_several_runs_are_named_and_told_apart_by_colour() -> None:
    figure = plot_convergence({"first": RUN, "second": history([50.0, 1.0], [True, True])})
    assert legend_of(figure)[:2] == ["first", "second"]
    curves = [line for line in figure.axes[0].lines if line.get_marker() == "None"]
    assert [np.asarray(curve.get_xydata()).shape for curve in curves] == [(4, 2), (2, 2)]
    assert curves[0].get_color() != curves[1].get_color()


def test_a_summary_is_drawn_as_its_iterations() -> None:
    summary: Summary = solve(perturb(circle_scene(5, 40), point_sigma_m=0.1, seed=0))
    *drawn, _ = points_of(plot_convergence(summary).axes[1], "None")
    costs = np.array([i.cost for i in summary.iterations[:-1]])
    np.testing.assert_allclose(
        [seconds for seconds, _ in drawn], [i.seconds for i in summary.iterations[:-1]]
    )
    np.testing.assert_allclose([gap for _, gap in drawn], costs / summary.final_cost - 1, rtol=1e-6)


def test_the_title_says_from_where_to_where_or_what_it_is_told() -> None:
    title = [plot_convergence(RUN).get_suptitle(), plot_convergence(RUN, title="mine").get_suptitle()]
    assert title == ["cost 100 → 2 in 3 iterations", "mine"]
    assert plot_convergence(RUN[:2]).get_suptitle().endswith("in 1 iteration")
    assert "over the lowest cost" in plot_convergence({"a": RUN, "b": RUN}).get_suptitle()


def test_the_lowest_of_all_runs_is_the_reference_of_each() -> None:
    figure = plot_convergence({"first": RUN, "second": history([5.0, 1.0], [True, True])})
    heights = [y for _, y in points_of(figure.axes[0], "None")]
    np.testing.assert_allclose(heights, [99, 9, 9, 1, 4, 0.3 * 1])


def test_with_a_best_cost_the_relative_distance_to_it_is_drawn() -> None:
    figure = plot_convergence(RUN, best_cost=2.0)
    heights = [y for _, y in points_of(figure.axes[0], "None")]
    np.testing.assert_allclose(heights, [49.0, 4.0, 4.0, 1e-9])


def test_costs_that_are_not_finite_leave_gaps() -> None:
    figure = plot_convergence(history([4.0, float("inf"), float("nan"), 1.0], [True] * 4))
    heights = [y for _, y in points_of(figure.axes[0], "None")]
    np.testing.assert_allclose(heights, [3.0, np.nan, np.nan, 0.3 * 3.0])


def test_costs_of_zero_are_drawn_on_a_linear_scale() -> None:
    figure = plot_convergence(history([0.0, 0.0], [True, True]))
    figure.draw_without_rendering()
    assert figure.axes[0].get_yscale() == "linear"


def test_no_global_state_of_matplotlib_is_touched() -> None:
    # Reading the backend's setting would choose a backend, hence leave it out.
    code = """
import io, sys, matplotlib
settings = lambda: {name: matplotlib.rcParams[name] for name in matplotlib.rcParams if name != "backend"}
before = settings()
from sfmcpp import Iteration
from sfmcpp.study.plotting import plot_convergence
plot_convergence([Iteration(0, 1.0, 0.0, True, 0, 0, 0, (1, 1), 0)]).savefig(io.BytesIO())
assert "matplotlib.pyplot" not in sys.modules
assert settings() == before
"""
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("best_cost", [0.0, -1.0, float("nan"), float("inf")])
def test_a_best_cost_without_a_logarithm_is_refused(best_cost: float) -> None:
    with pytest.raises(InvalidArgument, match=f"best_cost = {best_cost}"):
        plot_convergence(RUN, best_cost=best_cost)


def test_nothing_to_draw_is_refused_by_name() -> None:
    with pytest.raises(InvalidArgument, match="at least one run"):
        plot_convergence({})
    with pytest.raises(InvalidArgument, match=r"runs\['empty'\]"):
        plot_convergence({"full": RUN, "empty": []})


def test_times_of_many_digits_have_few_ticks() -> None:
    costs = [100.0, 10.0, 2.0]
    run = [Iteration(k, c, 0.0098 * k, True, 1e-3, 1.0, 1.0, (1.0, 1.0), 0) for k, c in enumerate(costs)]
    axes = plot_convergence(run).axes[1]
    left, right = axes.get_xlim()
    assert 3 <= sum(left <= at <= right for at in axes.get_xticks()) <= 6


@pytest.mark.parametrize("name", ["$^{$.txt", "a$x$b.txt", os.fsdecode(b"bad\xff.txt"), "写真.txt"])
@pytest.mark.parametrize("suffix", [".png", ".svg"])
def test_names_of_files_are_drawn_whatever_is_in_them(tmp_path: Path, name: str, suffix: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for runs in ({name: RUN}, {name: RUN, "other": RUN}):
            save_figure(plot_convergence(runs), tmp_path / f"plot{suffix}")
    assert (tmp_path / f"plot{suffix}").stat().st_size > 0
