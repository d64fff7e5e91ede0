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
