"""What is told of a solved problem: how certain its cameras are."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfmcpp import circle_scene, diagnose, linearize


def test_the_least_certain_camera_scatters_as_told_where_points_are_fixed() -> None:
    """In few observations of known points, redundancy that counted these as unknown told 29 % too much."""
    scene = circle_scene(6, 8, pixel_sigma_px=0.0, seed=5)
    errors, told = [], []
    for seed in range(40):
        problem = scene.copy()
        problem.fixed_points[:] = True
        problem.pixels += np.random.default_rng(seed).normal(0, 2.0, problem.pixels.shape)
        summary = sfmcpp.solve(problem)
        findings = diagnose(problem, summary=summary).findings
        told += [f.measures["worst_sigma"] for f in findings if f.code == "worst-cameras"]
        model = linearize(problem)
        blocks = model.covariance(cameras="all").cameras[:, 3:6, 3:6]
        worst = int(np.argmax(np.trace(blocks, axis1=1, axis2=2)))
        errors.append(np.sum((problem.centres[worst] - scene.centres[worst]) ** 2))
    assert np.mean(told) == pytest.approx(np.sqrt(np.mean(errors)), rel=0.15)
