"""The RMS is in pixels only where every observation has a σ of one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sfmcpp


@pytest.mark.parametrize(
    ("sigmas", "unit"),
    [
        ({}, "px"),
        ({"sigma_px": 1.0}, "px"),
        ({"sigma_px": 0.5}, "σ"),
        ({"covariance_px2": 0.25}, "σ"),
    ],
)
def test_what_the_rms_is_in_is_said(sigmas: dict[str, float], unit: str) -> None:
    scene = sfmcpp.circle_scene(6, 30, pixel_sigma_px=0.5, seed=0)
    count = scene.num_observations
    shapes = {"sigma_px": np.ones(count), "covariance_px2": np.tile(np.eye(2), (count, 1, 1))}
    problem = replace(scene, **{name: x * shapes[name] for name, x in sigmas.items()})
    summary = sfmcpp.solve(problem)
    assert summary.rms_unit == unit
    assert f"RMS [{unit}]" in str(summary)
    assert repr(summary).endswith(f" {unit})")
    assert summary.to_dict()["rms_unit"] == unit


@pytest.mark.parametrize(("sigma_px", "unit"), [(1.0, "px"), (0.01, "σ")])
def test_the_scale_of_a_loss_is_in_the_same_unit(sigma_px: float, unit: str) -> None:
    scene = sfmcpp.circle_scene(6, 30, pixel_sigma_px=1.0, seed=0)
    problem = replace(scene, sigma_px=np.full(scene.num_observations, sigma_px))
    scale = 0.05 if unit == "px" else 5.0  # both are a twentieth of the noise in pixels, and let all go
    summary = sfmcpp.solve(problem, loss="tukey", loss_scale_px=scale, max_iterations=1)
    assert f"tukey, {scale:g} {unit}" in str(summary)
    assert f"beyond the scale of the loss ({scale:g} {unit})" in " ".join(summary.warnings)
    squared = (sfmcpp.residuals(problem) ** 2).sum(axis=1) / scale**2  # residuals over σ, as the scale
    cost = scale**2 / 6 * (1 - (1 - np.minimum(squared, 1)) ** 3).sum()
    assert summary.final_cost == pytest.approx(cost)
