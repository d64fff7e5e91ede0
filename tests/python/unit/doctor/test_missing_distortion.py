"""A radial distortion that is held at zero or at a wrong value is named before focal lengths are blamed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sfmcpp import SCENES, Problem, diagnose, perturb
from sfmcpp.ba import residuals_px

K1 = -0.06


def photographed(scene: str, k1: float, held: float = 0.0) -> Problem:
    """A scene through a lens of distortion `k1` that all cameras share; the problem has it at `held`."""
    cameras, points, seed = {"city-blocks": (60, 2000, 33), "street-loop": (60, 2000, 4)}[scene]
    problem = SCENES[scene](cameras, points, camera_model="perspective", pixel_sigma_px=0.0, seed=seed)
    problem.intrinsics_index[:] = 0
    column = problem.intrinsic_names.index("k1")
    problem.intrinsics[:, column] = k1
    problem.pixels[:] -= residuals_px(problem)
    problem.pixels[:] += np.random.default_rng(seed).normal(0, 0.3, problem.pixels.shape)
    problem.intrinsics[:, column] = held
    problem.fixed_intrinsics[:] = True
    return perturb(problem, point_sigma_m=0.02, position_sigma_m=0.02, rotation_sigma_deg=0.1, seed=seed)


@pytest.mark.parametrize("free", [(), ("f",)])
@pytest.mark.parametrize("scene", ["city-blocks", "street-loop"])
def test_a_lens_that_is_not_modelled_is_named_and_nothing_else_is_blamed(
    scene: str, free: tuple[str, ...]
) -> None:
    problem = photographed(scene, K1)
    problem.set_free_intrinsics(*free)
    diagnosis = diagnose(problem)
    finding = next(f for f in diagnosis.findings if f.code == "missing-distortion")
    assert finding.severity == "warning"
    assert finding.measures["k1"] == pytest.approx(K1, rel=0.15)
    assert not {"wrong-focal", "wrong-principal-point", "calibration-of-another-size"} & set(diagnosis.codes)


@pytest.mark.parametrize(("k1", "held"), [(0.0, K1), (K1, -0.14), (0.05, K1)])
@pytest.mark.parametrize("scene", ["city-blocks", "street-loop"])
def test_a_lens_held_at_a_wrong_value_is_named(scene: str, k1: float, held: float) -> None:
    diagnosis = diagnose(photographed(scene, k1, held))
    finding = next(f for f in diagnosis.findings if f.code == "wrong-distortion")
    assert finding.severity == "warning"
    assert f"k1 is held at {held:.3g}" in finding.what
    assert finding.measures["k1"] == pytest.approx(k1, abs=0.012)
    assert not {"wrong-focal", "wrong-principal-point", "calibration-of-another-size"} & set(diagnosis.codes)


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_wrong_focal_length_is_no_distortion(factor: float) -> None:
    problem = photographed("street-loop", 0.0)
    problem.intrinsics[:, 0] *= factor
    diagnosis = diagnose(problem)
    assert "missing-distortion" not in diagnosis.codes
    assert "wrong-focal" in diagnosis.codes


@pytest.mark.parametrize("scene", ["city-blocks", "street-loop"])
@pytest.mark.parametrize("k1", [0.0, K1])
def test_a_lens_held_at_its_own_distortion_raises_no_alarm(scene: str, k1: float) -> None:
    codes = diagnose(photographed(scene, k1, held=k1)).codes
    assert not {"missing-distortion", "wrong-distortion"} & set(codes)


def test_rows_of_intrinsics_that_nothing_observes_hide_no_distortion() -> None:
    problem = photographed("street-loop", K1)
    unused = {name: np.tile(getattr(problem, name), (300, 1)) for name in ("intrinsics", "fixed_intrinsics")}
    assert "missing-distortion" in diagnose(replace(problem, **unused)).codes
