"""Curves of some keyframes of each sensor, with the chosen weights where they are on the curves."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from sfmcpp.slam import KeyframeRecord
from sfmcpp.study.plotting.weights import SHOWN, has_curves, plot_trade_off
from sfmcpp.weighting import ConflictReport, WeightSelection

WEIGHTS = np.array([0.0, 0.1, 1.0, 10.0])
CONFLICT = ConflictReport("", 0.1, "m", 1.0, 1, 1.0, conflicting=False)


def selection(name: str, chosen: int, score: np.ndarray | None = None) -> WeightSelection:
    """A choice among `WEIGHTS`; the images' error grows by a hundredth a step, the constraint's is halved."""
    score = (np.arange(4.0) - chosen) ** 2 if score is None else score
    return WeightSelection(
        name=name,
        unit="m",
        method="loo",
        weight=float(WEIGHTS[chosen]),
        pose=np.eye(3, 4),
        weights=WEIGHTS,
        vision=2.0 * (1 + 0.01 * np.arange(4)),
        constraint_error=0.5 ** np.arange(4),
        score=score,
        admissible=np.ones(4, dtype=np.bool_),
        sensor_sigma=1.0,
        conflict=CONFLICT,
    )


def record(t_s: float, *selections: WeightSelection) -> KeyframeRecord:
    return KeyframeRecord(0, t_s, 0, 0, selections=list(selections))


def lines_of(axes: Axes, marker: str) -> list[list[list[float]]]:
    return [np.asarray(line.get_xydata()).tolist() for line in axes.lines if line.get_marker() == marker]


def legend_of(axes: Axes) -> list[str]:
    legend = axes.get_legend()
    assert legend is not None
    return [text.get_text() for text in legend.get_texts()]


def test_each_sensor_has_a_row_with_the_chosen_weight_on_both_curves() -> None:
    records = [record(10.0), record(12.5, selection("odometer", 2), selection("imu", 1))]
    above, _, errors, scores = plot_trade_off(records).axes
    (dot,), (curve,) = lines_of(errors, "o"), lines_of(errors, "None")
    np.testing.assert_allclose(curve, [[1, 1e-5], [0.5, 0.01], [0.25, 0.02], [0.125, 0.03]])
    np.testing.assert_allclose(dot, [[0.25, 0.02]])
    assert lines_of(scores, "o") == [[[1.0, 0.0]]]
    assert lines_of(scores, "None") == [[[0.1, 0.25], [1.0, 0.0], [10.0, 0.25]]]
    assert legend_of(errors) == ["2.5 s: λ = 1"]
    assert legend_of(above) == ["2.5 s: λ = 0.1"]
    assert "odometer" in errors.get_xlabel()
    assert "imu" in above.get_xlabel()


def test_a_weight_of_zero_is_a_cross_at_the_left_edge() -> None:
    scores = plot_trade_off([record(0.0, selection("odometer", 0))]).axes[1]
    assert lines_of(scores, "o") == []
    assert lines_of(scores, "x") == [[[0.01, 0.0]]]


def test_keyframes_are_spread_over_the_run_from_first_to_last() -> None:
    records = [record(float(k), selection("odometer", 1)) for k in range(101)]
    times = [float(text.split(" s")[0]) for text in legend_of(plot_trade_off(records).axes[0])]
    assert times == [0, 20, 40, 60, 80, 100]
    assert len(times) == SHOWN


def test_where_the_criterion_may_not_choose_there_is_a_gap() -> None:
    score = np.array([np.inf, 3.0, 1.0, np.inf])
    scores = plot_trade_off([record(0.0, selection("odometer", 2, score))]).axes[1]
    (curve,) = lines_of(scores, "None")
    np.testing.assert_array_equal(curve, [[0.1, 1.0], [1.0, 0.0], [10.0, np.nan]])


def test_only_weights_that_were_chosen_have_curves() -> None:
    prescribed = record(0.0, selection("odometer", 3, np.zeros(4)))
    assert not has_curves([record(0.0), prescribed])
    assert has_curves([prescribed, record(1.0, selection("odometer", 1))])
