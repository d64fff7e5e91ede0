"""Ground control points against scenes whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sfmcpp
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import Similarity, agreeing_pairs
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sensors import geodetic_of
from sfmcpp.sensors.gps import earth_centred
from sfmcpp.sfm import fit_control_points
from sfmcpp.sources.io.control_points import ControlPoints, Mark

SURVEYED = 8
SIGMA_M = 0.02
UTM = np.array([691_500.0, 5_334_500.0, 520.0])


def scene() -> tuple[sfmcpp.Problem, sfmcpp.Problem, ControlPoints]:
    """The truth, the model in a frame of its own without the surveyed points, and the survey."""
    truth = sfmcpp.circle_scene(30, 200, pixel_sigma_px=0.5, seed=3)
    truth.metadata.image_names = [f"{k:03}.jpg" for k in range(truth.num_cameras)]
    rows = np.flatnonzero(truth.point_index < SURVEYED)
    marks = [
        Mark(
            int(truth.point_index[row]),
            f"{truth.camera_index[row]:03}.jpg",
            (float(truth.pixels[row, 0]), float(truth.pixels[row, 1])),
        )
        for row in rows
    ]
    noise = np.random.default_rng(0).normal(0, SIGMA_M, (SURVEYED, 3))
    surveyed = truth.points[:SURVEYED] + noise + UTM
    control = ControlPoints(
        [f"p{k}" for k in range(SURVEYED)],
        [tuple(row) for row in surveyed.tolist()],
        False,
        marks,
        checks=frozenset({6, 7}),
    )
    model = truth.with_points(np.arange(SURVEYED, truth.num_points))
    Similarity(0.1, truth.rotations[5], np.array([1.0, -2.0, 0.5])).move(model)
    return truth, model, control


def in_world(problem: sfmcpp.Problem, points: np.ndarray) -> np.ndarray:
    origin = WorldOrigin.of(problem.metadata)
    assert origin is not None
    return points + np.asarray(origin.place)


def test_the_model_is_where_the_truth_is_and_check_points_agree() -> None:
    truth, model, control = scene()
    before, errors = model.points.copy(), []
    for seed in range(5):
        noise = np.random.default_rng(seed).normal(0, SIGMA_M, (SURVEYED, 3))
        rows = [tuple(row) for row in (truth.points[:SURVEYED] + UTM + noise).tolist()]
        found = fit_control_points(model, replace(control, positions=rows))
        np.testing.assert_array_equal(model.points, before)
        others = in_world(found.problem, found.problem.points[: model.num_points])
        errors.append(np.linalg.norm(others - truth.points[SURVEYED:] - UTM, axis=1))
    # Six points of 2 cm in each coordinate fix seven numbers; images are good to 4 mm.
    assert np.mean(errors) < 1.5 * SIGMA_M
    outcome = found.outcome
    assert outcome.checks.tolist() == [False] * 6 + [True] * 2
    for checks in (False, True):
        rms = outcome.rms_m(checks=checks)
        assert rms is not None
        assert np.all(rms < 3 * SIGMA_M)
    assert not outcome.warnings
    assert outcome.errors_px.max() < 1.0


def test_a_survey_in_latitudes_gives_the_same_distances() -> None:
    truth, model, control = scene()
    origin = np.array([48.1, 11.5, 520.0])
    local = np.array(control.positions) - UTM
    rows = [tuple(row) for row in geodetic_of(local, origin).tolist()]
    found = fit_control_points(model, replace(control, positions=rows, geodetic=True))
    assert found.outcome.world_origin.geodetic
    centres = found.problem.centres
    np.testing.assert_allclose(
        np.linalg.norm(centres - centres[0], axis=1),
        np.linalg.norm(truth.centres - truth.centres[0], axis=1),
        atol=5 * SIGMA_M,
    )


def test_a_geocentric_survey_is_doubted() -> None:
    _, model, control = scene()
    places = earth_centred(geodetic_of(np.array(control.positions) - UTM, [48.1, 11.5, 520.0]))
    found = fit_control_points(model, replace(control, positions=[tuple(row) for row in places.tolist()]))
    assert any("(geocentric, ECEF)" in warning for warning in found.outcome.warnings)
    found = fit_control_points(model, control)
    assert not any("geocentric" in warning for warning in found.outcome.warnings)


def test_a_survey_in_radians_is_doubted() -> None:
    _, model, control = scene()
    degrees = geodetic_of(np.array(control.positions) - UTM, [48.1, 11.5, 520.0])
    rows = [tuple(row) for row in (degrees * [np.pi / 180, np.pi / 180, 1.0]).tolist()]
    found = fit_control_points(model, replace(control, positions=rows, geodetic=True))
    assert any("seem to be radians" in warning for warning in found.outcome.warnings)


def test_a_wrong_coordinate_is_named() -> None:
    _, model, control = scene()
    wrong = [tuple(row) for row in control.positions]
    wrong[2] = (wrong[2][0], wrong[2][1], wrong[2][2] + 0.5)
    found = fit_control_points(model, replace(control, positions=wrong))
    (told,) = [warning for warning in found.outcome.warnings if "standard" in warning]
    assert "'p2'" in told
    assert "wrong number or mark" in told


def test_right_points_are_not_named() -> None:
    _, model, control = scene()
    alarms = 0
    for seed in range(10):
        noise = np.random.default_rng(seed).normal(0, SIGMA_M, (SURVEYED, 3))
        rows = [tuple(row) for row in (np.array(control.positions) + noise).tolist()]
        found = fit_control_points(model, replace(control, positions=rows, checks=frozenset()), sigma_m=0.03)
        alarms += any("standard" in warning for warning in found.outcome.warnings)
    assert alarms == 0


def test_three_points_leave_a_mistake_unseen_and_a_warning_says_so() -> None:
    _, model, control = scene()
    found = fit_control_points(model, replace(control, checks=frozenset(range(3, SURVEYED))))
    assert any("nothing checks all coordinates" in warning for warning in found.outcome.warnings)


def test_points_seen_once_are_left_out_and_named() -> None:
    _, model, control = scene()
    first = next(k for k, mark in enumerate(control.marks) if mark.point == 0)
    marks = [mark for k, mark in enumerate(control.marks) if mark.point != 0 or k == first]
    found = fit_control_points(model, replace(control, marks=marks))
    assert found.outcome.left_out == ["p0"]
    assert any("p0" in warning for warning in found.outcome.warnings)


def test_the_seed_reaches_the_search_for_points_that_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    _, model, control = scene()
    seeds = []

    def noted(source: np.ndarray, target: np.ndarray, *, seed: int) -> np.ndarray:
        seeds.append(seed)
        return agreeing_pairs(source, target, seed=seed)

    monkeypatch.setattr("sfmcpp.sfm.control_points.agreeing_pairs", noted)
    fit_control_points(model, control, seed=5)
    assert seeds == [5]
    with pytest.raises(InvalidArgument, match="seed = -1: must be an integer"):
        fit_control_points(model, control, seed=-1)


def test_what_cannot_be_used_is_refused() -> None:
    _, model, control = scene()
    with pytest.raises(InvalidArgument, match="2 control points can be used: 3 are needed"):
        fit_control_points(model, replace(control, checks=frozenset(range(2, SURVEYED))))
    marks = [replace(mark, image="other " + mark.image) for mark in control.marks]
    with pytest.raises(InvalidArgument, match="none of the marked images"):
        fit_control_points(model, replace(control, marks=marks))
    line = [(UTM[0] + k, UTM[1], UTM[2]) for k in range(SURVEYED)]
    with pytest.raises(InvalidArgument, match="on a line"):
        fit_control_points(model, replace(control, positions=line))
    degrees = [(48.1 + 1e-6 * k, 11.5 + 1e-6 * k**2, 520.0) for k in range(SURVEYED)]
    with pytest.raises(InvalidArgument, match=r"^control: x and y are 48\.1 and 11\.5 .* degrees"):
        fit_control_points(model, replace(control, positions=degrees))
    twice = model.copy()
    twice.metadata.image_names = [f"{k // 2:03}.{'jpg' if k % 2 else 'dng'}" for k in range(30)]
    marks = [replace(mark, image=mark.image.removesuffix(".jpg")) for mark in control.marks]
    with pytest.raises(InvalidArgument, match=r"^control: the position of 000 may be that of 000\.dng or of"):
        fit_control_points(twice, replace(control, marks=marks))
    with pytest.raises(InvalidArgument, match="sigma_m"):
        fit_control_points(model, control, sigma_m=0.0)
    model.fixed_cameras[0] = True
    with pytest.raises(InvalidArgument, match="fixed"):
        fit_control_points(model, control)
