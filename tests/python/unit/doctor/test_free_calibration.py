"""Faults of calibrations that free focal lengths cover up, and starts that were changed after a solve."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp import SCENES, Problem, circle_scene, diagnose, perturb

# Cameras, points and seed of a scene; thresholds were chosen in view of a flight over a beach.
SIZES = {
    "circle": (20, 300, 3),
    "sphere": (18, 250, 31),
    "corridor": (40, 1500, 5),
    "city-blocks": (60, 2000, 33),
    "street-loop": (60, 2000, 4),
}
FILLED = ("corridor", "city-blocks", "street-loop")


def sound(scene: str) -> Problem:
    """A scene whose cameras share a calibration, of which f and k1 are free."""
    cameras, points, seed = SIZES[scene]
    truth = SCENES[scene](cameras, points, camera_model="perspective", pixel_sigma_px=0.3, seed=seed)
    truth.intrinsics_index[:] = 0
    truth.set_free_intrinsics("f", "k1")
    return perturb(truth, point_sigma_m=0.02, position_sigma_m=0.02, rotation_sigma_deg=0.1, seed=seed)


@pytest.mark.parametrize("scene", SIZES)
def test_a_sound_problem_with_a_free_focal_length_raises_no_alarm(scene: str) -> None:
    diagnosis = diagnose(sound(scene))
    assert diagnosis.is_healthy, str(diagnosis)
    assert "wrong-principal-point" not in diagnosis.codes


@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize("scale", [0.5, 2.0])
@pytest.mark.parametrize("scene", FILLED)
def test_pixels_of_resized_images_are_named_with_their_scale(scene: str, scale: float, fixed: bool) -> None:
    problem = sound(scene)
    problem.pixels *= scale
    problem.fixed_intrinsics[:] |= fixed
    finding = diagnose(problem).findings[0]
    assert finding.code == "pixels-of-another-size"
    assert finding.measures["scale"] == pytest.approx(scale, rel=0.03)


@pytest.mark.parametrize("scene", FILLED)
def test_images_whose_corner_alone_is_seen_are_sound(scene: str) -> None:
    problem = sound(scene)
    sizes = np.asarray(problem.metadata.image_sizes)[problem.camera_index]
    corner = problem.with_observations((problem.pixels < 0.6 * sizes).all(axis=1))
    assert "pixels-of-another-size" not in diagnose(corner).codes


# On a circle seen from its plane, cy and the tilt of all cameras stand in for each other.
@pytest.mark.parametrize(
    ("scene", "shift"), [("circle", (90.0, 0.0)), ("sphere", (90.0, 0.0)), ("sphere", (0.0, -70.0))]
)
def test_a_principal_point_that_a_free_focal_length_covers_up_is_named(
    scene: str, shift: tuple[float, float]
) -> None:
    problem = sound(scene)
    problem.intrinsics[:, 2:4] += shift
    found = {finding.code: finding for finding in diagnose(problem).findings}
    measures = found["wrong-principal-point"].measures
    assert found["wrong-principal-point"].severity == "warning"
    assert [measures["shift_x_px"], measures["shift_y_px"]] == pytest.approx(-np.array(shift), abs=12)


def test_a_start_off_by_tens_of_pixels_is_noted_with_the_cameras() -> None:
    problem = sound("circle")
    assert "far-start" not in diagnose(problem).codes
    problem.centres[4] += [6.0, -4.0, 3.0]
    finding = next(f for f in diagnose(problem).findings if f.code == "far-start")
    assert finding.severity == "note"
    assert finding.cameras[0] == 4
    assert finding.measures["rms_px"] > 20


def test_focal_lengths_that_are_not_positive_are_an_error_by_name() -> None:
    problem = perturb(circle_scene(8, 100, seed=3), point_sigma_m=0.02, seed=3)
    assert diagnose(problem).is_healthy
    problem.intrinsics[:, 0] *= -1
    finding = diagnose(problem).findings[0]
    assert (finding.code, finding.severity) == ("focal-not-positive", "error")
    assert finding.cameras == tuple(range(8))


def test_focal_lengths_in_millimetres_are_an_error_by_name() -> None:
    """Other examinations called the pixels mirrored, and gave errors of inf px."""
    problem = perturb(circle_scene(8, 100, seed=3), point_sigma_m=0.02, seed=3)
    for f in (4.25, 26.0):
        problem.intrinsics[:, 0] = f
        found = diagnose(problem)
        assert [finding.code for finding in found.findings if finding.severity == "error"] == ["short-focal"]
        assert "inf" not in str(found)
