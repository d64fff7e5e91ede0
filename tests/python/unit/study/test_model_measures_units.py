"""Figures of a model are in pixels, whatever weight its observations have."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfmcpp.map import map_of_problem
from sfmcpp.study.sfm_measures import ModelMeasures


def test_errors_are_pixels_and_deviations_follow_the_scatter() -> None:
    world = map_of_problem(sfmcpp.circle_scene(6, 40, camera_model="perspective", seed=2))
    plain = ModelMeasures(world)
    errors, rms, sigmas = plain.errors_px.copy(), plain.rms_px, plain.sigmas
    world.keypoint_covariances[:] = 0.04, 0.0, 0.04
    weighted = ModelMeasures(world)
    np.testing.assert_allclose(weighted.errors_px, errors)
    assert weighted.rms_px == pytest.approx(rms)
    # σ of intrinsics is measured by the scatter of the residuals: a common factor of their weights is none's.
    assert sigmas
    for camera, named in sigmas.items():
        assert weighted.sigmas[camera] == pytest.approx(named, rel=1e-6)
