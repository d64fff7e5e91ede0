"""Losses by Python functions: the built-in ones copied, roughness and contradictions named."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import sfmcpp
from constrained import positions, scene
from sfmcpp import InvalidArgument, LossFunction, SolveOptions, _core

Array = NDArray[np.float64]

COPIES: dict[str, LossFunction] = {
    "huber": LossFunction(
        lambda s: np.where(s <= 1, s, 2 * np.sqrt(s) - 1), lambda s: 1 / np.sqrt(np.maximum(s, 1)), "own"
    ),
    "cauchy": LossFunction(np.log1p, lambda s: 1 / (1 + s), "own"),
    "tukey": LossFunction(
        lambda s: (1 - np.maximum(1 - s, 0) ** 3) / 3, lambda s: np.maximum(1 - s, 0) ** 2, "own"
    ),
    "geman-mcclure": LossFunction(lambda s: s / (1 + s), lambda s: 1 / (1 + s) ** 2, "own"),
}


@pytest.mark.parametrize("loss", ["huber", "cauchy", COPIES["tukey"]])
def test_the_cost_of_a_state_is_that_of_a_solve_with_the_loss(loss: str | LossFunction) -> None:
    problem, _ = sfmcpp.add_outliers(sfmcpp.circle_scene(6, 40, pixel_sigma_px=1.0, seed=0), 0.1, seed=1)
    before = sfmcpp.cost(problem, loss=loss, loss_scale_px=2.0)
    summary = sfmcpp.solve(problem, loss=loss, loss_scale_px=2.0)
    assert before == pytest.approx(summary.initial_cost, rel=1e-9)
    after = sfmcpp.cost(problem, loss=loss, loss_scale_px=2.0)
    assert after == pytest.approx(summary.final_cost, rel=1e-9)
    assert after < sfmcpp.cost(problem)


@pytest.mark.parametrize("scale", [1.0, 2.5])
@pytest.mark.parametrize("name", COPIES)
def test_a_copy_of_a_built_in_loss_has_its_values(name: str, scale: float) -> None:
    s = np.concatenate([[0.0], np.geomspace(1e-18, 1e15, 5000), np.linspace(0.01, 20, 4000)])
    expected, found = (_core.loss_terms(loss, scale, s) for loss in (name, COPIES[name]))
    np.testing.assert_allclose(found[0], expected[0], rtol=3e-12, atol=1e-15)
    np.testing.assert_allclose(found[1], expected[1], rtol=1e-10, atol=2e-12)
    np.testing.assert_allclose(found[2], expected[2], rtol=1e-9, atol=1e-9)


def test_a_loss_may_fall_faster_than_any_power() -> None:
    """Where a weight falls from 1e-200 to 1e-300 within a cell, its polynomial swings about zero."""
    welsch = LossFunction(lambda s: -np.expm1(-s), lambda s: np.exp(-s), "welsch")
    s = np.concatenate([[0.0], np.geomspace(1e-9, 1e15, 5000)])
    rho, weight, _ = _core.loss_terms(welsch, 1.0, s)
    np.testing.assert_allclose(rho, -np.expm1(-s), rtol=1e-11)
    np.testing.assert_allclose(weight, np.exp(-s), rtol=1e-10, atol=1e-13)
    assert (weight >= 0).all()


@pytest.mark.parametrize("c", [0.1, 0.7, 1.3, 4.685, 7.3, 33.0])
def test_a_loss_may_have_its_scale_inside_wherever_its_weight_falls_to_zero(c: float) -> None:
    def weight(s: Array) -> Array:
        return np.maximum(1 - s / c**2, 0) ** 2

    own = LossFunction(lambda s: c**2 / 3 * (1 - np.maximum(1 - s / c**2, 0) ** 3), weight)
    s = np.concatenate([[0.0], np.geomspace(1e-9, 1e9, 5000), np.linspace(0.0, 2 * c**2, 4001)])
    expected, found = _core.loss_terms("tukey", c, s), _core.loss_terms(own, 1.0, s)
    np.testing.assert_allclose(found[0], expected[0], rtol=3e-12, atol=1e-12)
    np.testing.assert_allclose(found[1], expected[1], rtol=1e-9, atol=2e-12)


@pytest.mark.parametrize("options", [{}, {"method": "dog-leg"}, {"line_search": "g-als"}])
@pytest.mark.parametrize("name", COPIES)
def test_a_copy_of_a_built_in_loss_takes_the_same_iterations(name: str, options: dict[str, Any]) -> None:
    first, second = scene(), scene()
    options = {"gauge": "fixed", "loss_scale_px": 40.0, "max_iterations": 8, **options}
    expected = sfmcpp.solve(first, loss=name, **options)  # type: ignore[arg-type]
    found = sfmcpp.solve(second, loss=COPIES[name], **options)
    assert len(expected.iterations) > 3
    np.testing.assert_allclose(found.history()["cost"], expected.history()["cost"], rtol=1e-9)
    np.testing.assert_allclose(second.cameras, first.cameras, atol=1e-7)
    assert found.loss_scale_px == 40.0


def test_groups_have_losses_of_their_own() -> None:
    first, second = scene(), scene()
    for problem, loss in ((first, "cauchy"), (second, COPIES["cauchy"])):
        group = positions(scene(), scene(), weight=400.0)
        assert group.values is not None
        group.values[2] += 5.0
        group.loss, group.loss_scale = loss, 1.3
        sfmcpp.solve(problem, constraints=[group], gauge="fixed", function_tolerance=1e-12)
    np.testing.assert_allclose(second.cameras, first.cameras, atol=1e-7)


def test_the_linear_model_and_its_covariances_know_the_loss() -> None:
    problem = scene()
    sfmcpp.solve(problem, loss="cauchy", gauge="fixed")
    expected, found = (
        sfmcpp.linearize(problem, loss=loss, loss_scale_px=2.0)  # type: ignore[arg-type]
        for loss in ("cauchy", COPIES["cauchy"])
    )
    assert found.cost == pytest.approx(expected.cost, rel=1e-11)
    np.testing.assert_allclose(found.observation_weights, expected.observation_weights, rtol=1e-10)


def test_a_loss_that_leaps_lets_outliers_go() -> None:
    truth = sfmcpp.circle_scene(8, 80, pixel_sigma_px=0.5, seed=3)
    problem, _ = sfmcpp.add_outliers(truth, 0.1, seed=4)
    cut = LossFunction(lambda s: np.minimum(s, 1), lambda s: (s < 1) * 1.0, "cut")
    summary = sfmcpp.solve(problem, loss=cut, loss_scale_px=3.0)
    assert summary.loss is cut
    assert np.median(np.linalg.norm(problem.points - truth.points, axis=1)) < 0.01
    assert json.loads(json.dumps(summary.to_dict()))["options"]["loss"] == "cut"


def test_bits_are_the_same_for_every_number_of_threads() -> None:
    states = []
    for threads in (1, 3):
        problem = scene()
        sfmcpp.solve(problem, loss=COPIES["cauchy"], threads=threads)
        states.append(problem.cameras.tobytes())
    assert states[0] == states[1]


def test_options_keep_the_function() -> None:
    options = SolveOptions(loss=LossFunction(np.log1p, lambda s: 1 / (1 + s), "kept"))
    assert isinstance(options.loss, LossFunction)
    assert repr(options.loss) == "LossFunction('kept')"
    assert SolveOptions(**options.to_dict()) == options
    assert SolveOptions(loss="huber").loss == "huber"
    with pytest.raises(InvalidArgument, match="loss = 3: wrong type"):
        SolveOptions(loss=3)  # type: ignore[typeddict-item]


def rho(s: Array) -> Array:
    return np.sqrt(1 + 2 * s) - 1


def slope(s: Array) -> Array:
    return np.asarray(1 / np.sqrt(1 + 2 * s))


def test_a_run_that_is_saved_refuses_losses_that_are_functions(tmp_path: Path) -> None:
    folder = sfmcpp.CheckpointFolder(tmp_path)
    with pytest.raises(InvalidArgument, match=r"loss = LossFunction\('own'\): .* in a run that is saved"):
        sfmcpp.solve(scene(), loss=COPIES["huber"], checkpoint=folder)
    group = positions(scene(), scene(), weight=1.0)
    group.loss = COPIES["huber"]
    with pytest.raises(InvalidArgument, match="must be the name of a loss in a run that is saved"):
        sfmcpp.solve(scene(), constraints=[group], checkpoint=folder)


def test_functions_at_module_level_can_be_pickled() -> None:
    loss = LossFunction(rho, slope, "own")
    again = pickle.loads(pickle.dumps(loss))
    s = np.geomspace(1e-3, 1e3, 50)
    for before, after in zip(*(_core.loss_terms(x, 1.0, s) for x in (loss, again)), strict=True):
        np.testing.assert_array_equal(before, after)


@pytest.mark.parametrize(
    ("functions", "message"),
    [
        ((3, slope), "rho = 3: must be callable"),
        ((rho, 3), "derivative = 3: must be callable"),
        ((rho, slope, 3), "name = 3: must be text"),
        ((rho, lambda s: -slope(s)), r"derivative\(0\) = -1.0: must be finite and not negative"),
        ((np.sqrt, lambda s: 0.5 / np.sqrt(s)), r"derivative\(0\) = inf: must be finite"),
        ((rho, lambda s: 1 / (1 + s)), r"rho\(.*\) = .*: must be the integral of derivative"),
        ((lambda s: rho(s) + 1, slope), r"rho\(0\) = 1.0: must be the integral of derivative, 0"),
        ((rho, lambda s: slope(s)[:1]), r"derivative: shape \(1,\), must be"),
        ((rho, lambda s: np.random.default_rng(0).uniform(size=len(s))), "derivative: too rough"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_functions_that_cannot_be_a_loss_are_named(functions: Any, message: str) -> None:
    with pytest.raises(InvalidArgument, match=message):
        LossFunction(*functions)


def test_functions_may_write_into_the_same_array_each_time() -> None:
    buffer = np.zeros(100_000)

    def weight(s: Array) -> Array:
        buffer[: len(s)] = 1 / (1 + s)
        return buffer[: len(s)]

    s = np.geomspace(1e-3, 1e6, 50)
    found = _core.loss_terms(LossFunction(np.log1p, weight), 1.0, s)[1]
    np.testing.assert_allclose(found, 1 / (1 + s), rtol=1e-10)
