"""A rolling shutter is told from residuals along the motion; global ones raise no alarm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sfmcpp import (
    Problem,
    add_outliers,
    circle_scene,
    corridor_scene,
    diagnose,
    perturb,
    street_loop_scene,
)
from sfmcpp.ba import residuals_px
from sfmcpp.doctor.rolling_shutter import motion_px
from sfmcpp.geometry import so3

SCENES_FILMED = {
    "corridor": lambda seed: corridor_scene(25, 1200, length_m=25.0, pixel_sigma_px=0.0, seed=seed),
    "street-loop": lambda seed: street_loop_scene(50, 2000, pixel_sigma_px=0.0, seed=seed),
    "circle": lambda seed: circle_scene(20, 300, pixel_sigma_px=0.0, seed=seed),
}


def filmed(scene: str, readout: float, seed: int, share: float = 0.0) -> Problem:
    """A scene of which each row is exposed when the camera has moved on; `readout` in images."""
    problem = SCENES_FILMED[scene](seed)
    rows = problem.pixels[:, 1] / problem.metadata.image_sizes[0, 1] - 0.5
    problem.pixels[:] += (readout * rows)[:, None] * motion_px(problem)
    problem.pixels[:] += np.random.default_rng(seed).normal(0, 0.5, problem.pixels.shape)
    moved = perturb(problem, point_sigma_m=0.02, position_sigma_m=0.02, rotation_sigma_deg=0.1, seed=seed)
    return add_outliers(moved, share, seed=seed)[0]


def readout_of(scene: str, shift_px: float, seed: int) -> float:
    still = SCENES_FILMED[scene](seed)
    return shift_px / float(np.median(np.linalg.norm(motion_px(still), axis=1)))


@pytest.mark.parametrize("seed", [71, 72])
@pytest.mark.parametrize("scene", SCENES_FILMED)
def test_a_readout_that_moves_points_by_three_pixels_is_named(scene: str, seed: int) -> None:
    readout = readout_of(scene, 3.0, seed)
    diagnosis = diagnose(filmed(scene, readout, seed, share=0.01))
    finding = next(f for f in diagnosis.findings if f.severity == "warning")
    assert finding.code == "rolling-shutter"
    assert finding.measures["share"] == pytest.approx(readout, abs=6 * finding.measures["sigma"])
    assert finding.measures["shift_px"] == pytest.approx(3.0, rel=0.6)


@pytest.mark.parametrize("share", [0.0, 0.05])
@pytest.mark.parametrize("scene", SCENES_FILMED)
def test_a_global_shutter_raises_no_alarm(scene: str, share: float) -> None:
    for seed in (73, 74, 75):
        assert "rolling-shutter" not in diagnose(filmed(scene, 0.0, seed, share)).codes


def test_a_state_short_of_the_minimum_raises_no_alarm() -> None:
    """What an adjustment leaves of the gradient is as large as what poses leave of a readout."""
    problem = circle_scene(8, 60, seed=3)
    problem.fixed_cameras[:1] = True
    assert "rolling-shutter" not in diagnose(problem).codes


def test_the_motion_of_an_image_is_that_between_its_neighbours() -> None:
    problem = corridor_scene(9, 300, pixel_sigma_px=0.0, length_m=9.0, seed=1)
    rows = problem.camera_index == 4
    step = problem.centres[5] - problem.centres[3]
    moved = problem.copy()
    moved.centres[4] += 0.5e-4 * step
    moved.rotations[4] = problem.rotations[4] @ so3.exp(
        0.5e-4 * so3.log(problem.rotations[3].T @ problem.rotations[5])
    )
    expected = (residuals_px(problem) - residuals_px(moved))[rows] / 1e-4
    np.testing.assert_allclose(motion_px(problem)[rows], expected, rtol=2e-3, atol=1e-3)


def test_cameras_in_no_order_are_not_examined() -> None:
    problem = filmed("street-loop", readout_of("street-loop", 3.0, 71), 71)
    order = np.random.default_rng(0).permutation(problem.num_cameras)
    back = np.argsort(order).astype(np.int32)
    shuffled = replace(
        problem,
        cameras=problem.cameras[order],
        intrinsics_index=problem.intrinsics_index[order],
        camera_index=back[problem.camera_index],
    )
    assert "rolling-shutter" not in diagnose(shuffled).codes
