"""Parts of the experiments that can be wrong by themselves: intervals, flaws, the thesis' unknowns."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Protocol

import numpy as np
import pytest

import sfmcpp
from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.weighting import WeightSweep, weight_grid

pytest.importorskip("matplotlib", reason="experiments draw pictures: needs the extra 'plot'")
pytest.importorskip("poselib", reason="SLAM needs the extra 'slam'")

BENCH = Path(__file__).resolve().parents[3] / "bench"


class Load(Protocol):
    def __call__(self, name: str) -> ModuleType: ...


@pytest.fixture
def load(monkeypatch: pytest.MonkeyPatch) -> Iterator[Load]:
    """A module of the experiments; what it imports is forgotten afterwards."""
    monkeypatch.syspath_prepend(str(BENCH))
    before = set(sys.modules)
    yield lambda name: importlib.import_module(f"experiments.{name}")
    for name in set(sys.modules) - before:
        if name.split(".")[0] == "experiments":
            del sys.modules[name]


def test_medians_leave_out_what_is_missing_and_intervals_hold_the_median(load: Load) -> None:
    summaries = load("summaries")
    rng = np.random.default_rng(0)
    ratios = rng.lognormal(sigma=0.5, size=(9, 3))
    rows = [
        {"drive": f"{d}", "groups": ["all"], "label": "a", "seed": s, "error_m": r, "ratio": r}
        for (d, s), r in np.ndenumerate(ratios)
    ]
    rows[0]["error_m"] = rows[0]["ratio"] = None
    *drives, whole = summaries.summaries(rows, ("error_m", "ratio"), ("ratio",))
    first = ratios[0, 1:]
    assert drives[0]["ratio"] == pytest.approx(first.mean())
    assert drives[0]["[ratio]"] == pytest.approx([first.min(), first.max()])
    expected = np.median([first.mean(), *np.median(ratios[1:], axis=1)])
    assert (whole["drive"], whole["ratio"], whole["failed"]) == ("all, median", pytest.approx(expected), 1)
    low, high = whole["[ratio]"]
    assert ratios.min() < low < expected < high < ratios.max()


def test_an_interval_narrows_with_more_drives_and_not_with_more_runs_of_the_same(load: Load) -> None:
    interval = load("summaries").interval
    values = np.random.default_rng(1).lognormal(size=(40, 1))

    def width(table: np.ndarray) -> float:
        low, high = interval(table)
        return float(high - low)

    assert width(values) < 0.6 * width(values[:6])
    assert width(np.repeat(values[:6], 8, axis=1)) == pytest.approx(width(values[:6]), rel=0.2)


def test_flaws_are_the_size_they_are_said_to_be(load: Load) -> None:
    flaws = load("inputs").Flaws(sigma_deg=(0.1, 2.0), clock_s=0.25, mounting_deg=5.0)
    t_s = np.arange(4000) / 100
    exact = so3.exp(np.outer(t_s, [0.02, -0.03, 0.05]))
    spoilt = flaws.spoil(SensorStream(t_s, so3.log(exact), "orientation"), seed=3)
    assert spoilt.t_s == pytest.approx(t_s + 0.25)
    off = np.swapaxes(exact, 1, 2) @ so3.exp(spoilt.values)
    mounting = so3.nearest_rotation(off[:2000].mean(axis=0))
    assert np.degrees(so3.rotation_angle(mounting)) == pytest.approx(5.0, abs=0.05)
    noise_deg = np.degrees(so3.log(mounting.T @ off))
    assert noise_deg[:2000].std(axis=0) == pytest.approx(0.1, rel=0.1)
    assert noise_deg[2000:].std(axis=0) == pytest.approx(2.0, rel=0.1)


@pytest.fixture
def start() -> sfmcpp.Problem:
    scene = sfmcpp.circle_scene(6, 40, pixel_sigma_px=1.0, seed=2)
    return sfmcpp.perturb(scene, point_sigma_m=0.1, position_sigma_m=0.2, rotation_sigma_deg=1.0, seed=2)


@pytest.mark.parametrize("search", ["LM", "LM+G-ALS", "LM+T-ALS", "LM+exact"])
def test_the_thesis_unknowns_have_the_minimum_of_projective_cameras(
    load: Load, start: sfmcpp.Problem, search: str
) -> None:
    homogeneous = load("homogeneous")
    costs = homogeneous.adjust(*homogeneous.world_of(start), search, 1e-10, 100).costs
    summary = sfmcpp.solve(sfmcpp.as_projective(start), function_tolerance=1e-12)
    assert costs[0] == pytest.approx(2 * summary.initial_cost)
    assert costs[-1] == pytest.approx(2 * summary.final_cost, rel=1e-6)


def test_two_way_lengths_are_stationary_in_the_algebraic_cost(load: Load, start: sfmcpp.Problem) -> None:
    homogeneous = load("homogeneous")
    world, pixels = homogeneous.world_of(start)
    step = homogeneous.damped_step(world, pixels, 1e-3)
    algebraic = homogeneous.Algebraic(pixels)
    found = list(homogeneous.LINE_SEARCHES["LM+T-ALS"](world, step, pixels, algebraic))
    assert found

    def cost(p: float, q: float) -> float:
        moved = world.plus(step, (p, q))
        return float(np.sum(algebraic.residuals(moved.cameras, moved.points) ** 2))

    for p, q in found:
        h = 1e-4
        scale = cost(p + 1, q) + cost(p, q + 1)
        assert abs(cost(p + h, q) - cost(p - h, q)) / (2 * h) < 1e-5 * scale
        assert abs(cost(p, q + h) - cost(p, q - h)) / (2 * h) < 1e-5 * scale


def test_differences_agree_with_exact_derivatives_where_the_curve_is_smooth(load: Load) -> None:
    trade_offs = load("trade_offs")
    weights = weight_grid()
    w2 = weights**2
    # The optima of 1 + a (x − 1)² + λ² x², with ν = x².
    a = 10.0
    x = a / (a + w2)
    slope = 2 * x * -2 * a * w2 / (a + w2) ** 2
    none, count = np.zeros(0), np.full(len(weights), 50, dtype=np.int32)
    sweep = WeightSweep(
        weights, np.zeros((0, 3, 4)), 1 + a * (x - 1) ** 2, np.zeros_like(weights), x**2, slope, none, none,
        count, count > 0,
    )  # fmt: skip
    middle = slice(45, 75)
    for exact, differences in (
        ("l-curve, exact", "l-curve, log λ, differences"),
        ("ltn, log λ, exact", "ltn, log λ, differences"),
        ("ltn, λ, exact", "ltn, λ, differences"),
    ):
        ours, theirs = (trade_offs.CRITERIA[name](sweep)[middle] for name in (exact, differences))
        assert theirs == pytest.approx(ours, rel=0.1, abs=0.02 * np.abs(ours).max())
