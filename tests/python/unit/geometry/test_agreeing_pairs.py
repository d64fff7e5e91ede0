"""Pairs of points that agree on one similarity, among others that do not."""

from __future__ import annotations

import sys
from itertools import combinations

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import Similarity, agreeing_pairs, fit_similarity, so3
from sfmcpp.geometry.agreeing_pairs import _distances_under_samples
from sfmcpp.model.arrays import FloatArray

MOVE = Similarity(2.5, so3.exp(np.array([0.3, -1.1, 0.4])), np.array([4.0, -2.0, 9.0]))


def pairs(count: int, wrong: int, sigma: float, seed: int) -> tuple[FloatArray, FloatArray]:
    """Pairs (count, 3) of which the first ones lie far off, the others by `sigma`."""
    random = np.random.default_rng(seed)
    source = random.uniform(-1, 1, (count, 3))
    target = MOVE.apply(source) + random.normal(0, sigma, (count, 3))
    target[:wrong] += random.uniform(1, 3, (wrong, 3)) * random.choice([-1, 1], (wrong, 3))
    return source, target


@pytest.mark.parametrize(("count", "wrong"), [(8, 2), (9, 3), (20, 8), (200, 90)])
@pytest.mark.parametrize("seed", range(3))
def test_the_wrong_pairs_are_left_out_and_nearly_all_others_kept(count: int, wrong: int, seed: int) -> None:
    good = agreeing_pairs(*pairs(count, wrong, 0.01, seed))
    assert not good[:wrong].any()
    assert good[wrong:].mean() >= 0.95


@pytest.mark.parametrize("with_scale", [True, False])
def test_of_five_right_pairs_none_is_left_out_but_by_rare_chance(with_scale: bool) -> None:
    def kept(seed: int) -> int:
        random = np.random.default_rng(seed)
        source = random.normal(0, 1.0, (5, 3))
        target = source + random.normal(0, 0.01, source.shape)
        return int(agreeing_pairs(source, target, with_scale=with_scale).sum())

    all_kept = sum(kept(seed) == 5 for seed in range(100))
    assert all_kept >= 95  # three of the five, which fit by chance, left two out in a quarter of all draws


@pytest.mark.parametrize("wrong", [1, 2])
@pytest.mark.parametrize("seed", range(10))
def test_of_five_pairs_the_wrong_ones_are_left_out_where_they_are_far_off(wrong: int, seed: int) -> None:
    good = agreeing_pairs(*pairs(5, wrong, 0.0005, seed))
    assert good.tolist() == [False] * wrong + [True] * (5 - wrong)


def test_exact_pairs_all_agree() -> None:
    assert agreeing_pairs(*pairs(30, 0, 0.0, 0)).all()


def test_without_a_scale_pairs_of_another_scale_do_not_agree() -> None:
    source, target = pairs(20, 0, 0.0, 1)
    unscaled = target / MOVE.scale
    unscaled[:8] = target[:8]
    good = agreeing_pairs(source, unscaled, with_scale=False)
    assert good.tolist() == [False] * 8 + [True] * 12


def test_few_pairs_and_those_on_a_line_are_all_kept() -> None:
    assert agreeing_pairs(*pairs(4, 1, 0.0, 0)).all()
    line = np.outer(np.arange(8.0), [1.0, 2.0, 3.0])
    assert agreeing_pairs(line, line).all()


def test_the_same_pairs_for_the_same_seed() -> None:
    source, target = pairs(60, 25, 0.2, 2)
    assert np.array_equal(agreeing_pairs(source, target, seed=4), agreeing_pairs(source, target, seed=4))


@pytest.mark.parametrize("with_scale", [True, False])
def test_fits_to_all_samples_at_once_are_those_of_each(with_scale: bool) -> None:
    source, target = pairs(9, 2, 0.1, 5)
    source[2] = 0.5 * (source[0] + source[1])  # on their line
    target[4] = target[3]
    rows = np.array(list(combinations(range(9), 3)))
    found = _distances_under_samples(source, target, rows, with_scale)
    for some, distances in zip(rows, found, strict=True):
        try:
            moved = fit_similarity(source[some], target[some], with_scale=with_scale).apply(source)
        except InvalidArgument:
            assert np.isinf(distances).all()
        else:
            np.testing.assert_allclose(distances, np.linalg.norm(moved - target, axis=1), rtol=1e-9)
    assert 0 < np.isinf(found).any(axis=1).sum() < 10


def test_pairs_too_many_for_all_samples_at_once_are_taken_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    source, target = pairs(40, 15, 0.1, 6)
    at_once = agreeing_pairs(source, target)
    monkeypatch.setattr(sys.modules[agreeing_pairs.__module__], "_MOST_DISTANCES", 999)
    assert np.array_equal(agreeing_pairs(source, target), at_once)
