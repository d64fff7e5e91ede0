"""The variance of observations, from the residuals of an adjustment."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfmcpp.sfm.fit_statistics import linear_model, pixel_variance
from sfmcpp.sfm.georeference import georeference


def adjusted(seed: int) -> sfmcpp.Problem:
    problem = sfmcpp.circle_scene(5, 12, pixel_sigma_px=1.0, seed=seed)
    sfmcpp.solve(problem, max_iterations=50, function_tolerance=1e-10)
    return problem


def test_of_few_observations_it_is_that_of_their_noise() -> None:
    found = [pixel_variance(linear_model(adjusted(seed), [], {}, 1.0)) for seed in range(60)]
    assert abs(np.mean(found) - 1) < 2.5 * np.std(found) / np.sqrt(len(found))


def test_it_does_not_depend_on_the_gauge() -> None:
    problem = adjusted(0)
    free, fixed = (
        pixel_variance(linear_model(problem, [], {"gauge": gauge}, 1.0)) for gauge in ("free", "fixed")
    )
    assert free == pytest.approx(fixed, rel=1e-12)


@pytest.mark.parametrize("loss", ["auto", "huber", "cauchy"])
def test_outliers_among_observations_change_the_told_accuracy_little(loss: str) -> None:
    truth = sfmcpp.circle_scene(14, 80, pixel_sigma_px=0.0, seed=1)
    random = np.random.default_rng(2)
    clean = truth.copy()
    clean.pixels += random.normal(0, 0.5, truth.pixels.shape)
    gps = truth.centres + random.normal(0, 0.1, truth.centres.shape)
    mixed = clean.copy()
    wrong = random.random(truth.num_observations) < 0.15
    mixed.pixels[wrong] += random.uniform(-60, 60, (np.count_nonzero(wrong), 2))
    without = georeference(clean, gps).outcome.accuracy_m
    scale = 1.0 if loss == "auto" else "auto"
    within = georeference(mixed, gps, loss=loss, loss_scale_px=scale).outcome.accuracy_m
    assert 0.95 < within / without < 1.15


def test_a_camera_without_observations_is_no_gauge() -> None:
    problem = adjusted(0)
    seen = pixel_variance(linear_model(problem, [], {}, 1.0))
    without = problem.with_observations(problem.camera_index != 4)
    alone = pixel_variance(linear_model(without.with_cameras(np.arange(4)), [], {}, 1.0))
    assert alone != seen
    assert pixel_variance(linear_model(without, [], {}, 1.0)) == pytest.approx(alone, rel=1e-12)


def test_images_without_observations_have_no_accuracy() -> None:
    truth = sfmcpp.circle_scene(12, 60, camera_model="perspective", pixel_sigma_px=0.5, seed=4)
    problem = truth.with_shared_intrinsics()
    problem.set_free_intrinsics("f")
    problem = problem.with_observations(problem.camera_index != 0)
    gps = problem.centres + np.random.default_rng(4).normal(0, 0.1, (12, 3))
    outcome = georeference(problem, gps).outcome
    assert sorted(map(int, outcome.sigmas_m)) == list(range(1, 12))
    sigmas = np.array(list(outcome.sigmas_m.values()))
    assert outcome.accuracy_m == pytest.approx(np.sqrt(np.mean(sigmas**2)))
    assert sigmas.min() > 0
    assert outcome.intrinsics_sigmas is not None
    assert outcome.intrinsics_sigmas[0, 0] > 0
