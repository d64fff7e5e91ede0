"""Options: every one takes effect, and a wrong one is refused by name."""

from __future__ import annotations

import inspect
import pickle

import numpy as np
import pytest

import sfmcpp
from sfmcpp import InvalidArgument, Problem
from sfmcpp.ba import explore_step


@pytest.fixture
def problem() -> Problem:
    truth = sfmcpp.circle_scene(6, 40, seed=2)
    return sfmcpp.perturb(truth, point_sigma_m=0.3, position_sigma_m=0.3, rotation_sigma_deg=3.0, seed=3)


def test_unknown_keyword_is_refused(problem: Problem) -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'max_iteration'"):
        sfmcpp.solve(problem, max_iteration=3)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("method", "newton", "method = 'newton': must be one of lm, lm-nielsen, dog-leg, "),
        ("linear_solver", "qr", "linear_solver = 'qr': must be one of auto, dense, sparse, iterative"),
        (
            "loss",
            "l1",
            "must be one of squared, huber, cauchy, tukey, geman-mcclure, truncated, auto",
        ),
        ("gauge", "none", "gauge = 'none': must be one of auto, free, fixed"),
        ("max_iterations", -1, "max_iterations = -1: must be at least 0"),
        ("function_tolerance", -1e-3, "function_tolerance = -0.001: must be at least 0"),
        ("loss_scale_px", 0.0, "loss_scale_px = 0: must be positive and finite"),
        ("loss_scale_px", 1e-320, "positive and finite, and its square too"),
        ("loss_scale_px", "wide", "loss_scale_px = 'wide': must be a number of pixels or 'auto'"),
        ("max_seconds", 0.0, "max_seconds = 0: must be positive"),
        ("max_iterations", "many", "max_iterations = 'many': wrong type str"),
        ("threads", 2**40, f"threads = {2**40}: must have 32 bits"),
        ("threads", -2, r"threads = -2: must be in \[0, 1024\]"),
        ("pcg_tolerance", 2.0, r"pcg_tolerance = 2: must be in \(0, 1\)"),
    ],
)
def test_value_out_of_range_is_refused_by_name(
    problem: Problem, name: str, value: object, message: str
) -> None:
    with pytest.raises(InvalidArgument, match=message):
        sfmcpp.solve(problem, **{name: value})


def test_all_violations_are_named_at_once(problem: Problem) -> None:
    with pytest.raises(InvalidArgument, match=r"max_iterations = -1.*; threads = -2"):
        sfmcpp.solve(problem, max_iterations=-1, threads=-2)


def test_gauss_newton_refuses_a_free_gauge(problem: Problem) -> None:
    with pytest.raises(InvalidArgument, match="gauge = 'free' with method = 'gauss-newton'"):
        sfmcpp.solve(problem, method="gauss-newton", gauge="free")


@pytest.mark.parametrize("line_search", ["none", "exact"])
def test_a_test_of_backtracking_is_refused_without_it(problem: Problem, line_search: str) -> None:
    with pytest.raises(InvalidArgument, match="backtracking_test = 'goldstein' with line_search = "):
        sfmcpp.solve(problem, backtracking_test="goldstein", line_search=line_search)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"algebraic_weights": "inverse-depth"},
            "algebraic_weights = 'inverse-depth' with line_search = 'none'",
        ),
        (
            {"algebraic_weights": "inverse-depth", "line_search": "soft"},
            "only 'g-als' and 't-als' have an algebraic cost",
        ),
        ({"pcg_tolerance": 0.1, "pcg_forcing": 0.1}, "pcg_forcing with a pcg_tolerance"),
        (
            {"method": "gauss-newton", "damping_matrix": "identity"},
            "damping_matrix = 'identity' with method = 'gauss-newton'",
        ),
        (
            {"method": "conjugate-gradient", "damping_matrix": "identity"},
            "damping_matrix = 'identity' with method = 'conjugate-gradient'",
        ),
        (
            {"method": "gradient-descent", "max_memory_bytes": 1e4},
            "max_memory_bytes = 10000: the solve would need",
        ),
    ],
    ids=str,
)
def test_what_cannot_have_an_effect_is_refused(
    problem: Problem, options: dict[str, object], message: str
) -> None:
    with pytest.raises(InvalidArgument, match=message):
        sfmcpp.solve(problem, **options)


@pytest.mark.parametrize(
    ("taken", "of_another"),
    [
        ({}, {"loss_scale_px": 2.0, "line_search_iterations": 3}),
        ({"linear_solver": "dense"}, {"pcg_tolerance": 0.1, "preconditioner": "schur-jacobi"}),
        ({"method": "alternation"}, {"pcg_max_iterations": 9}),
    ],
    ids=str,
)
def test_who_compares_losses_searches_or_solvers_keeps_their_numbers(
    problem: Problem, taken: dict[str, object], of_another: dict[str, object]
) -> None:
    plain, also = (
        sfmcpp.solve(problem.copy(), **taken, **others, max_iterations=3) for others in ({}, of_another)
    )
    assert [step.cost for step in also.iterations] == [step.cost for step in plain.iterations]


def without_blocks() -> Problem:
    """A problem for which `auto` takes the iterative solver, without blocks of S."""
    return sfmcpp.perturb(sfmcpp.circle_scene(60, 100, seed=2), point_sigma_m=0.1, seed=3)


def test_what_the_solver_that_auto_takes_cannot_do_is_told() -> None:
    summary = sfmcpp.solve(
        without_blocks(), acceleration="geodesic", preconditioner="clusters", max_iterations=2
    )
    assert summary.linear_solver == "iterative"
    straight, replaced = summary.warnings
    assert straight.startswith("acceleration = 'geodesic': the linear solver chosen, 'iterative', keeps no")
    assert replaced.startswith("preconditioner = 'clusters': 'schur-jacobi' is taken")
    assert not any(iteration.accelerated for iteration in summary.iterations)
    assert sfmcpp.solve(without_blocks(), max_iterations=2).warnings == []


@pytest.mark.parametrize("preconditioner", ["clusters", "two-levels"])
def test_a_preconditioner_that_is_asked_for_is_used(preconditioner: str) -> None:
    def iterations(wanted: str) -> list[int]:
        options = {"linear_solver": "iterative", "pcg_tolerance": 1e-6, "max_iterations": 2}
        summary = sfmcpp.solve(without_blocks(), preconditioner=wanted, **options)
        assert summary.warnings == []
        return [iteration.linear_solver_iterations for iteration in summary.iterations]

    assert iterations(preconditioner) != iterations("schur-jacobi")


@pytest.mark.parametrize("method", ["gradient-descent", "alternation", "dog-leg"])
def test_a_damping_matrix_has_an_effect_on_other_methods(problem: Problem, method: str) -> None:
    def costs(**options: object) -> list[float]:
        summary = sfmcpp.solve(problem.copy(), method=method, max_iterations=3, **options)
        return [iteration.cost for iteration in summary.iterations]

    assert costs(damping_matrix="identity") != costs()


def test_a_squared_loss_has_no_scale_to_hand_on(problem: Problem) -> None:
    summary = sfmcpp.solve(problem, loss_scale_px="auto")
    assert summary.loss_scale_px == 1.0
    assert sfmcpp.cost(problem, loss_scale_px=summary.loss_scale_px) == pytest.approx(summary.final_cost)


def test_weights_of_the_algebraic_cost_are_explored_without_a_search(problem: Problem) -> None:
    plain, weighted = (
        explore_step(problem, [(1.0, 1.0)], algebraic_weights=weights)
        for weights in ("uniform", "inverse-depth")
    )
    assert not np.array_equal(plain.algebraic, weighted.algebraic)
    np.testing.assert_array_equal(plain.geometric, weighted.geometric)


@pytest.mark.parametrize(
    "change",
    [
        {"method": "lm"},
        {"method": "gauss-newton"},
        {"linear_solver": "iterative"},
        {"loss": "huber"},
        {"gauge": "fixed"},
        {"initial_damping": 1.0},
        {"damping_matrix": "identity"},
        {"max_iterations": 2},
        {"function_tolerance": 0.5},
        {"gradient_tolerance": 1e9},
        {"parameter_tolerance": 1.0},
        {"max_seconds": 1e-9},
    ],
    ids=str,
)
def test_every_option_changes_the_run(problem: Problem, change: dict[str, object]) -> None:
    def trace(**options: object) -> list[tuple[float, float]]:
        summary = sfmcpp.solve(problem.copy(), **options)
        return [(i.cost, i.damping) for i in summary.iterations]

    assert trace(**change) != trace()


def test_loss_scale_and_pcg_options_change_the_run(problem: Problem) -> None:
    def final(**options: object) -> float:
        return sfmcpp.solve(problem.copy(), **options).final_cost

    assert final(loss="huber", loss_scale_px=0.5) != final(loss="huber", loss_scale_px=2.0)
    tight = {"linear_solver": "iterative", "max_iterations": 3}
    assert final(**tight, pcg_tolerance=1e-9) != final(**tight, pcg_tolerance=0.5)
    assert final(**tight, pcg_max_iterations=1) != final(**tight)


def test_automatic_loss_scale_is_reported(problem: Problem) -> None:
    truth = sfmcpp.circle_scene(10, 300, pixel_sigma_px=1.5, seed=6)
    summary = sfmcpp.solve(truth, loss="tukey", loss_scale_px="auto")
    assert summary.loss_scale_px == pytest.approx(4.6851 * 1.5, rel=0.1)


def test_options_are_values() -> None:
    options = sfmcpp.SolveOptions(method="lm", loss="huber", loss_scale_px="auto", max_seconds=3.5)
    assert options != sfmcpp.SolveOptions()
    assert sfmcpp.SolveOptions.from_dict(options.to_dict()) == options
    assert pickle.loads(pickle.dumps(options)) == options
    assert "loss='huber'" in repr(options)
    assert eval(repr(options), {"SolveOptions": sfmcpp.SolveOptions}) == options


def test_defaults_of_solve_are_those_of_the_core() -> None:
    defaults = sfmcpp.SolveOptions().to_dict()
    parameters = inspect.signature(sfmcpp.solve).parameters
    given = {name: p.default for name, p in parameters.items() if name in defaults}
    assert given == {name: defaults[name] for name in given}
    assert len(given) == len(defaults) > 20


def test_options_read_back_what_was_set() -> None:
    options = sfmcpp.SolveOptions()
    assert options.method == "lm-nielsen"
    options.loss_scale_px = "auto"
    assert options.loss_scale_px == "auto"
    options.loss_scale_px = 2.5
    assert options.loss_scale_px == 2.5
    assert options.max_seconds is None


@pytest.mark.parametrize("loss", ["squared", "huber"])
def test_a_cost_refuses_the_scales_that_a_solve_refuses(problem: Problem, loss: str) -> None:
    for scale in (0.0, -1.0, float("nan")):
        with pytest.raises(InvalidArgument, match=r"loss_scale_px = .*: must be positive and finite"):
            sfmcpp.cost(problem, loss=loss, loss_scale_px=scale)


def test_an_option_that_there_is_not_is_refused_where_it_is_set() -> None:
    options = sfmcpp.SolveOptions()
    with pytest.raises(AttributeError, match="no option 'max_iteration'; did you mean 'max_iterations'"):
        options.max_iteration = 3  # type: ignore[attr-defined]
