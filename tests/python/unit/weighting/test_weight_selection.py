"""``solve(..., weight=...)``: what is recovered, what is named, what is refused."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import sfmcpp
from sfmcpp import ConstraintGroup, InvalidArgument, Problem, Summary
from sfmcpp.geometry import fit_similarity
from sfmcpp.weighting import (
    PROBLEM_METHODS,
    WeightSelection,
    l_curve_scores,
    ltn_scores,
    running_median,
    scaled_l_curve_scores,
)
from sfmcpp.weighting import problem as weighting_problem
from weight_helpers import Array, gps, is_recovered, odometer, street


def choose(
    problem: Problem, *groups: ConstraintGroup, weight: str = "auto", **options: object
) -> list[WeightSelection]:
    return sfmcpp.solve(problem.copy(), constraints=groups, weight=weight, **options).group_weights


@pytest.fixture(scope="module")
def drift() -> tuple[Problem, Problem]:
    return street()


@pytest.fixture(scope="module")
def weighed(drift: tuple[Problem, Problem]) -> tuple[Problem, ConstraintGroup, Summary]:
    problem, group = drift[0].copy(), gps(drift[1], 0.1)
    return problem, group, sfmcpp.solve(problem, constraints=[group], weight="auto")


@pytest.mark.parametrize("sigma_m", [0.02, 0.2, 2.0])
def test_the_noise_of_a_gps_is_recovered(drift: tuple[Problem, Problem], sigma_m: float) -> None:
    (chosen,) = choose(drift[0], gps(drift[1], sigma_m))
    assert chosen.method == "variance"
    assert chosen.unit == "m"
    assert is_recovered(chosen, sigma_m)
    assert not chosen.conflict.conflicting


@pytest.mark.parametrize("cameras", [5, 20])
def test_the_variance_is_the_squares_over_one_number_less_than_the_redundancy(cameras: int) -> None:
    truth = sfmcpp.circle_scene(cameras, 60, pixel_sigma_px=1.0, seed=1)
    (chosen,) = choose(truth, gps(truth, 0.05))
    assert chosen.redundancy is not None
    squares = 3 * cameras * chosen.constraint_error[list(chosen.weights).index(chosen.weight)]
    assert squares / (chosen.redundancy - 1) == pytest.approx(chosen.sensor_sigma**2, rel=0.02)


def test_numbers_of_members_have_weights_of_their_own() -> None:
    truth = sfmcpp.circle_scene(20, 200, pixel_sigma_px=1.0, seed=2)
    alike, group = gps(truth, 0.2), gps(truth, 0.2)
    group.member_weights = np.ones((20, 3))
    (one,), (by_number,) = choose(truth, alike), choose(truth, group)
    assert by_number.weight == pytest.approx(one.weight, rel=1e-2)
    np.testing.assert_allclose(by_number.constraint_error[-1], one.constraint_error[-1], rtol=0.02)
    group.values[:, 2] += np.random.default_rng(0).normal(0, 2.0, 20)
    group.member_weights[:, 2] = 0.01
    assert is_recovered(choose(truth, group)[0], 0.2)


def test_the_noises_of_two_sensors_are_recovered_together(drift: tuple[Problem, Problem]) -> None:
    found = choose(drift[0], gps(drift[1], 0.1, seed=1), odometer(drift[1], 0.02, seed=1))
    assert [chosen.name for chosen in found] == ["gps", "odometer"]
    assert is_recovered(found[0], 0.1)
    assert is_recovered(found[1], 0.02)


@pytest.mark.parametrize("method", ["loo-approx", "k-fold"])
def test_cross_validation_finds_the_noise_in_the_median(method: str) -> None:
    ratios = []
    for seed in range(4):
        truth = sfmcpp.circle_scene(12, 80, pixel_sigma_px=1.0, seed=seed)
        (chosen,) = choose(truth, gps(truth, 0.02, seed), weight=method)
        assert chosen.score.min() == chosen.score[list(chosen.weights).index(chosen.weight)]
        ratios.append(chosen.sensor_sigma / 0.02)
    assert 0.6 < np.median(ratios) < 1.6


def test_the_weight_is_worth_nearly_what_the_true_one_is(drift: tuple[Problem, Problem]) -> None:
    start, truth = drift

    def error(weight: float | str) -> float:
        problem, group = start.copy(), gps(truth, 0.1)
        group.weight = 0.0 if isinstance(weight, str) else weight
        sfmcpp.solve(problem, constraints=[group], weight=weight if isinstance(weight, str) else None)
        return float(np.sqrt(((problem.centres - truth.centres) ** 2).sum(axis=1).mean()))

    true = error(3 / 0.1**2)
    assert error("auto") < 1.1 * true
    assert error(1e4 * 3 / 0.1**2) > 1.5 * true


def test_the_group_gets_the_weight_and_the_solve_is_the_one_with_it(
    drift: tuple[Problem, Problem], weighed: tuple[Problem, ConstraintGroup, Summary]
) -> None:
    problem, group, summary = weighed
    assert group.weight == summary.group_weights[0].weight
    again, other = drift[0].copy(), gps(drift[1], 0.1, weight=group.weight)
    sfmcpp.solve(again, constraints=[other])
    np.testing.assert_array_equal(problem.cameras, again.cameras)
    np.testing.assert_array_equal(problem.points, again.points)


def test_the_bits_do_not_depend_on_the_threads(
    drift: tuple[Problem, Problem], weighed: tuple[Problem, ConstraintGroup, Summary]
) -> None:
    again, group = drift[0].copy(), gps(drift[1], 0.1)
    sfmcpp.solve(again, constraints=[group], weight="auto", threads=1)
    assert group.weight == weighed[1].weight
    np.testing.assert_array_equal(weighed[0].cameras, again.cameras)


def test_the_equivalent_sigma_is_that_of_the_weight(
    weighed: tuple[Problem, ConstraintGroup, Summary],
) -> None:
    problem, group, summary = weighed
    squared = (sfmcpp.residuals(problem) ** 2).sum()
    chosen = summary.group_weights[0]
    assert chosen.redundancy is not None
    free = 2 * problem.num_observations + 3 * 40 - 6 * 40 - 3 * len(np.unique(problem.point_index))
    image_sigma = np.sqrt(squared / (free - chosen.redundancy))
    assert chosen.sensor_sigma == pytest.approx(image_sigma * np.sqrt(3 / group.weight), rel=1e-3)


@pytest.mark.parametrize(
    ("method", "criterion"),
    [("l-curve", l_curve_scores), ("l-curve-scaled", scaled_l_curve_scores), ("ltn", ltn_scores)],
)
def test_trade_off_scores_are_those_of_plain_solves(
    drift: tuple[Problem, Problem], method: str, criterion: type[object]
) -> None:
    start, truth = drift
    (chosen,) = choose(start, gps(truth, 0.1), weight=method)
    rest, errors = np.zeros(len(chosen.weights)), np.zeros(len(chosen.weights))
    for i, weight in enumerate(chosen.weights):
        problem, group = truth.copy(), gps(truth, 0.1, weight=weight)
        sfmcpp.solve(problem, constraints=[group], function_tolerance=1e-11, initial_damping=1e-9)
        rest[i] = (sfmcpp.residuals(problem) ** 2).sum() / start.num_observations
        errors[i] = ((problem.centres - group.values) ** 2).mean()
    np.testing.assert_allclose(chosen.vision, rest, rtol=1e-5)
    np.testing.assert_allclose(chosen.constraint_error, errors, rtol=1e-2)
    lambdas = np.sqrt(chosen.weights * 40 / start.num_observations)
    expected = running_median(criterion(lambdas, rest, errors, None), 3)  # type: ignore[call-arg, arg-type]
    known = np.isfinite(expected) & np.isfinite(chosen.score)
    assert known.sum() > 10
    scale = np.abs(expected[known]).max()
    np.testing.assert_allclose(chosen.score[known], expected[known], rtol=0.05, atol=0.01 * scale)


def test_a_choice_at_the_end_of_what_was_tried_says_so() -> None:
    truth = sfmcpp.circle_scene(12, 60, pixel_sigma_px=0.7, seed=3)
    (without_corner,) = choose(truth.copy(), gps(truth, 0.1), weight="ltn")
    group = gps(truth, 0.1)
    told = sfmcpp.solve(truth.copy(), constraints=[group], weight="ltn").warnings
    assert any(
        line.startswith(
            f"constraints[{group.name!r}]: the weight by ltn is at the end of what was tried (σ = "
        )
        for line in told
    )
    finite = without_corner.weights[np.isfinite(without_corner.score)]
    inside, ends = float(finite[len(finite) // 2]), finite[[0, -1]].tolist()
    for weight in ends:
        at_end = replace(without_corner, weight=weight)
        assert at_end.at_end
        assert "at the end of what was tried: no better one inside" in at_end.describe()
        assert not replace(at_end, method="variance").at_end
    for weight in (inside, 0.0):
        assert not replace(without_corner, weight=weight).at_end
        assert "at the end" not in replace(without_corner, weight=weight).describe()


def test_weights_that_cost_a_tenth_of_the_inliers_are_not_taken(drift: tuple[Problem, Problem]) -> None:
    start, truth = drift
    (chosen,) = choose(start, gps(truth, 1.0), weight="l-curve")
    alone = truth.copy()
    sfmcpp.solve(alone, function_tolerance=1e-11)

    def lengths(problem: Problem) -> Array:
        return np.asarray(np.linalg.norm(sfmcpp.residuals(problem), axis=1))

    limit = 2 * np.median(lengths(alone)) / np.sqrt(2 * np.log(2))
    heavy = truth.copy()
    group = gps(truth, 1.0, weight=chosen.weights[-1])
    sfmcpp.solve(heavy, constraints=[group], function_tolerance=1e-11, initial_damping=1e-9)
    assert (lengths(heavy) <= limit).sum() < 0.9 * (lengths(alone) <= limit).sum()
    assert not chosen.admissible[-1]
    assert chosen.admissible[0]
    assert chosen.admissible[list(chosen.weights).index(chosen.weight)]


def test_one_bad_fix_is_named(drift: tuple[Problem, Problem]) -> None:
    group = gps(drift[1], 0.1)
    assert group.values is not None
    group.values[17, 1] += 2.0
    (chosen,) = choose(drift[0], group)
    assert chosen.conflict.conflicting
    assert chosen.conflict.member == 17
    assert chosen.conflict.sigmas > 6
    assert "disagrees with the images: member 17 is" in chosen.describe()


def test_fixes_that_are_off_for_a_while_are_told_by_their_neighbours(drift: tuple[Problem, Problem]) -> None:
    group = gps(drift[1], 0.1)
    assert group.values is not None
    group.values[15:25, 0] += 2.0
    (chosen,) = choose(drift[0], group)
    assert chosen.conflict.conflicting
    assert chosen.conflict.alike_sigmas > 4
    correct = choose(drift[0], gps(drift[1], 0.1))[0]
    assert abs(correct.conflict.alike_sigmas) < 3


def test_a_wrong_scale_of_an_odometer_is_told_by_its_mean(drift: tuple[Problem, Problem]) -> None:
    wrong = odometer(drift[1], 0.02)
    assert wrong.values is not None
    wrong.values *= 1.3
    correct, faulty = choose(drift[0], gps(drift[1], 0.1), wrong)
    assert not correct.conflict.conflicting
    assert is_recovered(correct, 0.1)
    assert faulty.conflict.conflicting
    assert faulty.conflict.bias_sigmas > 4
    assert faulty.sensor_sigma > 10 * 0.02


@pytest.mark.parametrize("loss", ["huber", "cauchy", "tukey"])
@pytest.mark.parametrize("wrong", [1, 8])
def test_wrong_members_have_no_say_in_the_weight_of_a_robust_group(loss: str, wrong: int) -> None:
    truth = sfmcpp.circle_scene(40, 200, pixel_sigma_px=0.5, radius_m=60.0, cube_m=30.0, seed=1)
    group = gps(truth, 0.3)
    group.values[:wrong, 0] += 8.0
    (squares,) = choose(truth, group)
    group.loss = loss
    (robust,) = choose(truth, group)
    assert squares.sensor_sigma > 0.6
    assert is_recovered(robust, 0.3)
    assert group.loss == loss
    assert group.weight == robust.weight
    np.testing.assert_array_equal(group.member_weights, np.ones(40))


@pytest.mark.parametrize("method", ["auto", "loo-approx", "l-curve"])
def test_a_robust_group_of_correct_members_has_the_weight_of_squares(
    drift: tuple[Problem, Problem], method: str
) -> None:
    weights = [
        choose(drift[0], gps(drift[1], 0.2, loss=loss), weight=method)[0].weight
        for loss in ("squared", "huber")
    ]
    assert weights[0] == weights[1]


def test_outliers_of_the_images_do_not_spoil_the_choice_under_a_robust_loss(
    drift: tuple[Problem, Problem],
) -> None:
    spoiled, _ = sfmcpp.add_outliers(drift[0], 0.05, seed=3)
    (chosen,) = choose(spoiled, gps(drift[1], 0.1), loss="tukey", loss_scale_px=5.0)
    assert is_recovered(chosen, 0.1)


def test_a_mapping_weighs_some_groups_and_leaves_the_others(drift: tuple[Problem, Problem]) -> None:
    groups = [gps(drift[1], 0.1, weight=300.0), odometer(drift[1], 0.02, seed=1)]
    summary = sfmcpp.solve(drift[0].copy(), constraints=groups, weight={"odometer": "variance"})
    assert [chosen.name for chosen in summary.group_weights] == ["odometer"]
    assert groups[0].weight == 300.0
    assert is_recovered(summary.group_weights[0], 0.02)


def test_members_on_fixed_cameras_have_no_say(drift: tuple[Problem, Problem]) -> None:
    start = drift[0].copy()
    start.fixed_cameras[:5] = True
    start.cameras[:5] = drift[1].cameras[:5]
    group = gps(drift[1], 0.1)
    assert group.values is not None
    group.values[:5] += 50.0
    (chosen,) = choose(start, group)
    assert is_recovered(chosen, 0.1)


def test_a_summary_with_weights_prints_and_is_plain_json(
    weighed: tuple[Problem, ConstraintGroup, Summary],
) -> None:
    summary = weighed[2]
    (line,) = [line for line in str(summary).splitlines() if line.startswith("weight of 'gps'")]
    assert f"{weighed[1].weight:.3g} by variance (σ = " in line
    content = json.loads(json.dumps(summary.to_dict(), allow_nan=False))
    assert content["group_weights"][0]["weights"] == summary.group_weights[0].weights.tolist()


def test_priors_on_focal_lengths_are_weighed_too() -> None:
    truth = sfmcpp.circle_scene(20, 60, pixel_sigma_px=1.0, camera_model="perspective", seed=1)
    noise = np.random.default_rng(1).normal(0, 0.1, 20)
    group = ConstraintGroup("focal", np.arange(20), truth.intrinsics[:, 0] * np.exp(noise))
    (chosen,) = choose(truth, group)
    assert is_recovered(chosen, np.sqrt((noise**2).mean()))
    assert chosen.unit == "of f"


def test_without_a_method_nothing_is_chosen(drift: tuple[Problem, Problem]) -> None:
    group = gps(drift[1], 0.1, weight=5.0)
    assert sfmcpp.solve(drift[0].copy(), constraints=[group]).group_weights == []
    assert group.weight == 5.0


@pytest.mark.parametrize("weight", ["best", {"gps": "best"}])
def test_an_unknown_method_is_refused_with_the_known_ones(
    drift: tuple[Problem, Problem], weight: str | dict[str, str]
) -> None:
    with pytest.raises(
        InvalidArgument, match="weight = 'best': must be one of " + ", ".join(PROBLEM_METHODS)
    ):
        sfmcpp.solve(drift[0], constraints=[gps(drift[1], 0.1)], weight=weight)


def test_what_leaves_nothing_to_choose_from_is_refused(drift: tuple[Problem, Problem]) -> None:
    start, truth = drift
    before = start.cameras.copy()
    with pytest.raises(InvalidArgument, match="weight = 'auto': there are no constraints to weigh"):
        sfmcpp.solve(start, weight="auto")
    with pytest.raises(InvalidArgument, match=r"weight\['imu'\]: no such group, must be one of gps"):
        sfmcpp.solve(start, constraints=[gps(truth, 0.1)], weight={"imu": "auto"})
    two = ConstraintGroup("position", [0, 5], truth.centres[[0, 5]], name="two", weight=7.0)
    with pytest.raises(InvalidArgument, match=r"constraints\['two'\]: the fit leaves 0.0 of its 6 numbers"):
        sfmcpp.solve(start, constraints=[two], weight="auto")
    none = ConstraintGroup("position", [], np.zeros((0, 3)), name="none")
    with pytest.raises(InvalidArgument, match=r"constraints\['none'\]: the fit leaves 0.0 of its 0 numbers"):
        sfmcpp.solve(start, constraints=[none], weight="auto")
    outside = ConstraintGroup("position", [0, 40], truth.centres[[0, 1]])
    with pytest.raises(InvalidArgument, match=r"constraints\['position'\]\[1\]"):
        sfmcpp.solve(start, constraints=[outside], weight="auto")
    assert two.weight == 7.0
    np.testing.assert_array_equal(start.cameras, before)


def test_ctrl_c_while_choosing_leaves_everything_as_it_was(
    drift: tuple[Problem, Problem], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(weighting_problem, "VarianceSearch", interrupted)
    start, group = drift[0].copy(), gps(drift[1], 0.1, weight=5.0)
    with pytest.raises(KeyboardInterrupt):
        sfmcpp.solve(start, constraints=[group], weight="auto")
    assert group.weight == 5.0
    np.testing.assert_array_equal(start.cameras, drift[0].cameras)


@pytest.mark.parametrize("kind", ["position", "pose"])
def test_positions_in_another_frame_are_refused_with_the_alignment_to_use(
    drift: tuple[Problem, Problem], kind: str
) -> None:
    start, truth = drift[0].copy(), drift[1]
    utm = np.array([4.5e5, 5.4e6, 300.0])
    values = truth.centres if kind == "position" else truth.cameras.copy()
    values = values + (utm if kind == "position" else np.pad(utm[:, None], ((0, 0), (3, 0))))
    group = ConstraintGroup(kind, np.arange(truth.num_cameras), values, name="gps", weight=1e-9)
    before = start.cameras.copy()
    with pytest.raises(
        InvalidArgument, match=r"constraints\['gps'\]: its positions are 5.42e\+06 from"
    ) as told:
        sfmcpp.solve(start, constraints=[group], weight="auto")
    assert "sfmcpp.geometry.fit_similarity(problem.centres[group.cameras], group.values" in str(told.value)
    np.testing.assert_array_equal(start.cameras, before)
    (warning,) = [
        w for w in sfmcpp.solve(start.copy(), constraints=[group], max_iterations=1).warnings if "gps" in w
    ]
    assert "Align first" in warning
    if kind == "pose":
        return
    fit_similarity(start.centres[group.cameras], group.values).move(start)
    noisy = gps(truth, 0.1)
    noisy.values += utm
    (chosen,) = choose(start, noisy)
    assert is_recovered(chosen, 0.1)
