"""Solves whose loss has let go of nearly everything say so."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp

TOLD = "beyond the scale of the loss"


def start(shift_m: float) -> sfmcpp.Problem:
    scene = sfmcpp.circle_scene(6, 60, pixel_sigma_px=0.3, seed=1)
    return sfmcpp.perturb(scene, point_sigma_m=shift_m, position_sigma_m=shift_m, seed=2)


@pytest.mark.parametrize("loss", ["tukey", "truncated"])
def test_a_loss_that_has_let_go_of_most_observations_is_told(loss: str) -> None:
    problem = start(0.5)
    summary = sfmcpp.solve(problem, loss=loss)
    assert summary.final_rms_px > 0.9 * summary.initial_rms_px
    told = [warning for warning in summary.warnings if TOLD in warning]
    assert len(told) == 1
    assert int(told[0].split("%")[0]) >= 99
    assert told[0].endswith('or loss "auto"')


@pytest.mark.parametrize(
    "loss", ["squared", "huber", "cauchy", "tukey", "geman-mcclure", "truncated", "auto"]
)
def test_a_good_end_is_not(loss: str) -> None:
    problem, _ = sfmcpp.add_outliers(start(0.0), 0.3, seed=3)
    assert not any(TOLD in warning for warning in sfmcpp.solve(problem, loss=loss).warnings)


def test_the_share_is_that_of_observations_with_less_than_a_tenth_of_their_weight() -> None:
    problem, wrong = sfmcpp.add_outliers(start(0.0), 0.6, seed=3)
    summary = sfmcpp.solve(problem, loss="truncated", max_iterations=0)
    assert any(warning.startswith(f"{wrong.mean():.0%} of the") for warning in summary.warnings)


def test_of_a_loss_that_is_a_function_the_weights_count_not_its_scale() -> None:
    narrow = sfmcpp.LossFunction(
        lambda s: (1 - np.maximum(1 - 100 * s, 0) ** 3) / 300, lambda s: np.maximum(1 - 100 * s, 0) ** 2
    )
    summaries = [
        sfmcpp.solve(start(0.0), loss=narrow),
        sfmcpp.solve(start(0.0), loss="tukey", loss_scale_px=0.1),
    ]
    own, named = ([w.split("%")[0] for w in summary.warnings if TOLD in w] for summary in summaries)
    assert own == named
    assert len(own) == 1
