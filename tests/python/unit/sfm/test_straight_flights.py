"""Positions near a line leave a model free to turn about it: by how much is told."""

from __future__ import annotations

import numpy as np
import pytest

from flights import flight, in_a_frame_of_its_own
from sfmcpp.geometry.so3 import exp
from sfmcpp.sfm import georeference
from sfmcpp.sfm.turns_about_lines import turn_sigmas_deg


def warnings_of(off_m: float, sigma_m: float) -> str:
    """What is told of a flight along x whose lines are `off_m` on either side of the middle."""
    places = np.array([[12.0 * k, off_m * (-1) ** k] for k in range(12)])
    truth = flight(places, seed=2)
    random = np.random.default_rng([2, 7])
    positions = truth.centres + random.normal(0, sigma_m, truth.centres.shape)
    return " ".join(georeference(in_a_frame_of_its_own(truth, 2), positions).outcome.warnings)


@pytest.mark.parametrize("seed", range(3))
def test_sigma_is_how_repeated_positions_turn_a_model(seed: int) -> None:
    random = np.random.default_rng(seed)
    centres = np.array([200.0, 4.0, 2.0]) * random.normal(size=(25, 3))
    around = centres - centres.mean(axis=0)
    weights = np.array([1.0, 1.0, 0.25]) * np.ones((25, 1))
    sigma_m = 0.3
    lever = np.column_stack([np.zeros(25), -around[:, 2], around[:, 1]])  # of a turn about x
    turns = []
    for _ in range(2_000):
        noise = sigma_m / np.sqrt(weights) * random.normal(size=(25, 3))
        turns.append(np.sum(weights * lever * noise) / np.sum(weights * lever**2))
    assert turn_sigmas_deg(centres, weights, sigma_m)[0] == pytest.approx(np.degrees(np.std(turns)), rel=0.1)
    turned = centres @ exp(np.array([0.3, -0.2, 0.9])).T
    alike = [turn_sigmas_deg(c, np.ones((25, 3)), sigma_m) for c in (centres, turned)]
    np.testing.assert_allclose(alike[0], alike[1], rtol=1e-9)


def test_cameras_exactly_on_a_line_may_be_turned_by_any_angle() -> None:
    line = np.outer(np.arange(6.0), [1.0, 0.0, 0.0])
    turns = turn_sigmas_deg(line, np.ones((6, 3)), 0.01)
    assert turns[0] == np.inf
    assert turns[2] < 1.0


def test_a_straight_flight_whose_positions_scatter_is_warned_of() -> None:
    told = warnings_of(0.0, 1.0)
    assert "the model may be turned about that line by any angle" in told
    assert "swapped" not in told


def test_a_little_off_the_line_the_angle_is_told() -> None:
    assert "the model may be turned about that line by ±" in warnings_of(3.0, 1.0)


@pytest.mark.parametrize(("off_m", "sigma_m"), [(3.0, 0.03), (20.0, 1.0), (20.0, 4.0)])
def test_what_holds_a_model_is_not(off_m: float, sigma_m: float) -> None:
    assert "turned about" not in warnings_of(off_m, sigma_m)
