"""Problems in normalised coordinates (f = 1), whose errors are far below one unit."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp import circle_scene, diagnose, perturb


@pytest.mark.parametrize("outliers", [False, True])
def test_normalised_coordinates_have_the_findings_of_pixels(outliers: bool) -> None:
    problem = perturb(circle_scene(12, 200, pixel_sigma_px=0.7, seed=3), point_sigma_m=0.02, seed=1)
    rng = np.random.default_rng(0)
    wrong = rng.random(problem.num_observations) < 0.1 * outliers
    problem.pixels[wrong] += rng.normal(0, 60, (np.count_nonzero(wrong), 2))
    problem.metadata.image_sizes = None
    normalised = problem.copy()
    f, _, cx, cy, _ = problem.intrinsics[0]
    normalised.pixels[:] = (problem.pixels - [cx, cy]) / f
    normalised.intrinsics[:] = [1.0, 1.0, 0.0, 0.0, 0.0]
    found, wanted = diagnose(normalised), diagnose(problem)
    assert [finding.code for finding in found.findings] == [finding.code for finding in wanted.findings]
    assert any(finding.code == "outliers" for finding in found.findings) == outliers
