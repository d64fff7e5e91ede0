"""Positions of images: the model in their world, and wrong ones."""

from __future__ import annotations

import json
import re
from copy import deepcopy
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

import sfmcpp
from flights import flight, in_a_frame_of_its_own, tilt_deg
from sfm_scenes import match_graph
from sfmcpp.errors import InvalidArgument
from sfmcpp.map import Map
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors.gps import east_north_up, geodetic_of
from sfmcpp.sfm.cameras import cameras_of
from sfmcpp.sfm.georeference import georeference, georeference_map
from sfmcpp.sfm.incremental import grow_models
from sfmcpp.sfm.positions import Positions, local_positions, positions_of
from sfmcpp.sfm.scene import Scene
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.sources.io.named_positions import NamedPositions

SETTINGS = IncrementalSettings()


@lru_cache
def truth_of(seed: int) -> Problem:
    return sfmcpp.circle_scene(20, 250, pixel_sigma_px=0.0, radius_m=60.0, cube_m=30.0, seed=seed)


def model_of(seed: int) -> Map:
    """A model of ``truth_of(seed)``, that a test may change."""
    return deepcopy(_grown(seed))


@lru_cache
def _grown(seed: int) -> Map:
    truth = truth_of(seed)
    graph = match_graph(truth, sigma_px=0.5, seed=seed)
    cameras = cameras_of(graph.photos, calibration=np.append(truth.intrinsics[0, :5], np.zeros(7)))
    return grow_models(Scene.of(graph, cameras), SETTINGS, lambda _: False).models[0]


def error_m(world: Map, truth: Problem) -> float:
    return float(np.sqrt(((world.poses[:, :, 3] - truth.centres) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("seed", range(3))
def test_wrong_positions_are_named_and_cost_nothing(seed: int) -> None:
    truth = truth_of(seed)
    random = np.random.default_rng(seed)
    right = truth.centres + random.normal(0, 1.0, truth.centres.shape)
    wrong = np.sort(random.choice(truth.num_cameras, 3, replace=False))
    some_wrong = right.copy()
    directions = random.normal(size=(3, 3))
    some_wrong[wrong] += 20 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    by_hand = right.copy()
    by_hand[wrong] = np.nan
    world, control = model_of(seed), model_of(seed)
    found = georeference_map(world, Positions(some_wrong), SETTINGS)
    georeference_map(control, Positions(by_hand), SETTINGS)
    assert found.outliers == [world.image_names[image] for image in wrong]
    assert error_m(world, truth) <= 1.05 * error_m(control, truth)
    assert found.sigma_m == pytest.approx(1.0, rel=0.35)  # of 51 numbers: 10 % is one standard deviation


def test_the_stated_accuracy_is_that_of_the_model_in_the_world() -> None:
    stated, true = [], []
    for seed in range(4):
        truth = truth_of(seed)
        gps = truth.centres + np.random.default_rng(seed + 9).normal(0, 0.5, truth.centres.shape)
        world = model_of(seed)
        stated.append(georeference_map(world, Positions(gps), SETTINGS).accuracy_m ** 2)
        true.append(error_m(world, truth) ** 2 / 3)
    # Of 28 numbers: a factor of 1.3 is one standard deviation.
    assert 0.4 < np.mean(true) / np.mean(stated) < 2.5


def test_geodetic_positions_are_metres_east_north_up_of_their_median() -> None:
    known = {"a": (46.0, 9.0, 100.0), "b": (46.001, 9.0, 100.0), "unknown": (0.0, 0.0, 0.0)}
    found = positions_of(["a", "b", "c"], NamedPositions(known, geodetic=True))
    assert np.isnan(found.metres[2]).all()
    # A thousandth of a degree of latitude is 111.15 m there.
    assert found.metres[1] - found.metres[0] == pytest.approx([0.0, 111.15, 0.0], abs=0.05)
    assert found.origin == pytest.approx([46.0005, 9.0, 100.0])
    assert east_north_up(found.origin[None], found.origin) == pytest.approx(np.zeros((1, 3)))


def test_too_few_positions_and_those_on_a_line_are_refused() -> None:
    truth = truth_of(0)
    world = model_of(0)
    few = np.full(truth.centres.shape, np.nan)
    few[:4] = truth.centres[:4]
    with pytest.raises(InvalidArgument, match=r"4 images of the model have a position, 5 are needed"):
        georeference_map(world, Positions(few), SETTINGS)
    line = np.outer(np.arange(len(few)), [1.0, 2.0, 0.0])
    with pytest.raises(InvalidArgument, match=r"lie on a line"):
        georeference_map(world, Positions(line), SETTINGS)
    with pytest.raises(InvalidArgument, match=r"none of its names \(x\) is the name of an image \("):
        positions_of(["a"], NamedPositions({"x": (0.0, 0.0, 0.0)}, geodetic=False))


def test_of_cameras_with_one_image_each_focal_length_and_k1_are_adjusted() -> None:
    truth = truth_of(0)
    graph = match_graph(truth, sigma_px=0.5, seed=0)
    cameras = cameras_of(graph.photos, sharing="each", model="simple-radial", focal_px=1020.0)
    (world,) = grow_models(Scene.of(graph, cameras), SETTINGS, lambda _: False).models
    noise = np.random.default_rng(0).normal(0, 0.05, truth.centres.shape)
    focals = world.intrinsics[:, 0].copy()
    georeference_map(world, Positions(truth.centres + noise), SETTINGS)
    assert (world.intrinsics[:, 0] != focals).all()
    assert 0 < np.abs(world.intrinsics[:, 5]).max() < 0.03  # truth: 0; four of its standard deviations
    assert not world.intrinsics[:, 6:].any()


def camera_errors_m(problem: Problem, truth: FloatArray) -> FloatArray:
    return np.linalg.norm(problem.centres - truth, axis=1)


UTM = np.array([691_500.0, 5_334_500.0, 520.0])


def scene(seed: int) -> Problem:
    return sfmcpp.circle_scene(40, 300, pixel_sigma_px=0.5, radius_m=60.0, cube_m=30.0, seed=seed)


@pytest.mark.parametrize("seed", range(3))
def test_a_problem_ends_in_utm_and_one_outlier_among_forty_leaves_sigma(seed: int) -> None:
    truth = scene(seed)
    random = np.random.default_rng(seed)
    gps = truth.centres + UTM + random.normal(0, 0.3, truth.centres.shape)
    gps[7] += 8.0 * random.permutation([1.0, 0.0, 0.0])
    problem = in_a_frame_of_its_own(truth, seed)
    found = georeference(problem, gps)
    assert found.outcome.outliers == ["7"]
    assert found.outcome.sigma_m == pytest.approx(0.3, rel=0.2)  # of 110 numbers: 7 % is one σ
    assert found.outcome.origin.tolist() == [691_000.0, 5_334_000.0, 0.0]
    errors = camera_errors_m(problem, truth.centres + UTM - found.outcome.origin)
    assert np.sqrt((errors**2).mean() / 3) < 3 * found.outcome.accuracy_m < 0.3
    assert sfmcpp.solve(problem.copy(), constraints=[found.group]).final_rms_px == pytest.approx(0.5, rel=0.1)


def test_a_problem_ends_where_latitude_longitude_and_height_say() -> None:
    truth = scene(0)
    origin = np.array([46.5, 9.25, 800.0])
    # Metres to degrees at the origin, to first order, refined by what the first answer misses.
    gps = np.tile(origin, (40, 1))
    for _ in range(5):
        missed = truth.centres - east_north_up(gps, origin)
        gps += missed[:, [1, 0, 2]] * [1 / 111_150, 1 / (111_320 * np.cos(np.deg2rad(46.5))), 1.0]
    gps[[3, 30]] = np.nan
    problem = in_a_frame_of_its_own(truth, 1)
    found = georeference(problem, gps, geodetic=True)
    assert found.outcome.geodetic
    assert found.group.num_members == 38
    assert set(found.outcome.residuals_m) == {str(k) for k in range(40) if k not in (3, 30)}
    middle = east_north_up(found.outcome.origin[None], origin)
    # Planes tangent at places 100 m apart differ by millimetres.
    assert camera_errors_m(problem, truth.centres - middle).max() < 0.1


def test_stated_deviations_count_relative_to_one_another() -> None:
    ratios, gains = [], []
    for seed in range(3):
        truth = scene(seed)
        random = np.random.default_rng(seed)
        sigmas = np.where(random.random((40, 1)) < 0.5, 0.02, 1.0) * [1.0, 1.0, 2.0]
        gps = truth.centres + random.normal(0, 1, (40, 3)) * sigmas
        stated, alike = in_a_frame_of_its_own(truth, seed), in_a_frame_of_its_own(truth, seed)
        found = georeference(stated, gps, sigmas_m=sigmas / 3).outcome
        georeference(alike, gps)
        assert not found.outliers
        ratios.append(found.sigma_m / found.stated_sigma_m)
        gains.append(np.mean([camera_errors_m(p, truth.centres) for p in (alike, stated)], axis=1))
    assert np.mean(ratios) == pytest.approx(3.0, rel=0.2)
    alike_m, stated_m = np.mean(gains, axis=0)
    assert stated_m < 0.5 * alike_m


@pytest.mark.parametrize("stated", [False, True])
def test_of_a_large_problem_sigma_is_found_too(monkeypatch: pytest.MonkeyPatch, stated: bool) -> None:
    truth = scene(3)
    random = np.random.default_rng(3)
    far = random.random((40, 1)) < 0.5
    sigmas = np.where(far, 0.4, 0.1 if stated else 0.4) * np.ones(3)
    gps = truth.centres + random.normal(0, 1, (40, 3)) * sigmas
    gps[7, 1] += 8.0
    small, large = in_a_frame_of_its_own(truth, 3), in_a_frame_of_its_own(truth, 3)
    known = {"sigmas_m": sigmas / 2} if stated else {}
    wanted = georeference(small, gps, **known)
    monkeypatch.setattr("sfmcpp.weighting.statistics.MAX_COLUMNS", 239)
    monkeypatch.setattr("sfmcpp.weighting.statistics._SAMPLED_MEMBERS", 20)  # of 40
    found = georeference(large, gps, **known)
    assert found.outcome.outliers == wanted.outcome.outliers == ["7"]
    assert found.outcome.sigma_m == pytest.approx(wanted.outcome.sigma_m, rel=0.02)
    assert found.group.weight == pytest.approx(wanted.group.weight, rel=0.04)
    assert found.outcome.accuracy_m == pytest.approx(wanted.outcome.accuracy_m, rel=0.02)
    assert np.abs(large.centres - small.centres).max() < 0.1 * found.outcome.accuracy_m


# Six photos of a line of flight, and one aside of it.
LINE_AND_ONE = np.append(np.outer(np.arange(6), [10.0, 10.0]), [[40.0, 5.0]], axis=0)


@pytest.mark.parametrize("seed", [0, 1, 4])
def test_a_position_that_alone_tells_the_roll_is_not_wrong(seed: int) -> None:
    truth = flight(LINE_AND_ONE, seed)
    gps = truth.centres + np.random.default_rng(seed).normal(0, 0.05, truth.centres.shape)
    problem = in_a_frame_of_its_own(truth, seed)
    found = georeference(problem, gps).outcome
    assert not found.outliers
    assert tilt_deg(problem, truth) < 1
    (warning,) = found.warnings
    assert "depends on the position of 6 alone" in warning


@pytest.mark.parametrize("seed", [4, 6, 10])  # three of the five positions of seed 4 fit by chance
def test_of_five_right_positions_none_is_left_out(seed: int) -> None:
    truth = sfmcpp.circle_scene(5, 60, pixel_sigma_px=0.5, radius_m=60.0, cube_m=30.0, seed=seed)
    gps = truth.centres + np.random.default_rng(seed).normal(0, 0.3, truth.centres.shape)
    problem = in_a_frame_of_its_own(truth, seed)
    found = georeference(problem, gps).outcome
    assert not found.outliers
    assert camera_errors_m(problem, truth.centres).max() < 5 * found.accuracy_m


def test_what_no_roll_explains_is_wrong_all_the_same() -> None:
    truth = flight(LINE_AND_ONE, 0)
    gps = truth.centres + np.random.default_rng(0).normal(0, 0.05, truth.centres.shape)
    gps[6] += [500.0, 0.0, 0.0]
    with pytest.raises(InvalidArgument, match=r"but for those that disagree \(6\) lie on a line"):
        georeference(in_a_frame_of_its_own(truth, 0), gps)


GRID = np.stack(np.meshgrid(np.arange(4) * 12.0, np.arange(3) * 20.0), axis=2).reshape(-1, 2)


@pytest.mark.parametrize(
    ("sigma_m", "axes", "told"),
    [
        (0.03, [0, 1, 2], None),
        (0.03, [1, 0, 2], "x and y of the positions may be swapped.*: mirrored, they fit"),
        (2.0, [0, 1, 2], None),
        (2.0, [1, 0, 2], "x and y of the positions may be swapped.*: the cameras look at the sky"),
    ],
)
def test_swapped_axes_are_told_by_the_fit_or_by_where_cameras_look(
    sigma_m: float, axes: list[int], told: str | None
) -> None:
    truth = flight(GRID, 0)
    gps = truth.centres + np.random.default_rng(0).normal(0, sigma_m, truth.centres.shape)
    found = georeference(in_a_frame_of_its_own(truth, 0), gps[:, axes]).outcome
    assert bool(found.warnings) == (told is not None)
    if told is not None:
        assert re.search(told, found.warnings[0])


def test_latitudes_and_longitudes_that_are_swapped_are_named() -> None:
    truth = flight(GRID, 1)
    gps = geodetic_of(truth.centres, [46.5, 9.25, 300.0])
    found = georeference(in_a_frame_of_its_own(truth, 1), gps[:, [1, 0, 2]], geodetic=True).outcome
    assert "latitude and longitude of the positions may be swapped" in found.warnings[0]


def test_a_longitude_of_the_wrong_sign_is_named() -> None:
    truth = flight(GRID, 1)
    gps = geodetic_of(truth.centres, [46.5, -91.99, 300.0]) * [1.0, -1.0, 1.0]
    found = georeference(in_a_frame_of_its_own(truth, 1), gps, geodetic=True).outcome
    assert "or the sign of one be wrong (south and west are negative)" in found.warnings[0]


def test_images_without_a_position_are_named_and_residuals_told_by_axis() -> None:
    truth = flight(GRID, 1)
    gps = truth.centres + np.random.default_rng(1).normal(0, 0.1, truth.centres.shape)
    gps[[2, 7]] = np.nan
    found = georeference(in_a_frame_of_its_own(truth, 1), gps).outcome
    assert found.without_position == ["2", "7"]
    offsets = np.array(list(found.offsets_m.values()))
    assert found.rms_m == pytest.approx(np.sqrt(np.mean(offsets**2, axis=0)))


def test_cameras_on_their_heads_are_named() -> None:
    truth = scene(2)
    gps = truth.centres * [1.0, -1.0, -1.0] + np.random.default_rng(2).normal(0, 0.3, truth.centres.shape)
    (warning,) = georeference(in_a_frame_of_its_own(truth, 2), gps).outcome.warnings
    assert warning.endswith("or z is not up: the cameras are upside down")


def test_what_a_problem_lacks_is_refused() -> None:
    truth = scene(0)
    with pytest.raises(InvalidArgument, match=r"positions: shape \(39, 3\), must be \(40, 3\)"):
        georeference(truth, truth.centres[:39])
    with pytest.raises(InvalidArgument, match="gps: no position is known"):
        georeference(truth, np.full((40, 3), np.nan))
    with pytest.raises(InvalidArgument, match=r"sigmas_m\[0\] = .*: must be positive"):
        georeference(truth, truth.centres, sigmas_m=np.zeros((40, 3)))
    torn = truth.copy()
    torn.cameras = torn.cameras[:, :, None]
    with pytest.raises(InvalidArgument, match=r"cameras: shape \(40, 3, 1, 4\), must be \(any, 3, 4\)"):
        georeference(torn, truth.centres)
    truth.fixed_cameras[0] = True
    with pytest.raises(InvalidArgument, match="1 cameras are fixed"):
        georeference(truth, truth.centres)


def test_too_few_positions_are_refused_before_the_problem_is_changed() -> None:
    problem = sfmcpp.perturb(
        scene(0), point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=0.5, seed=1
    )
    before, few = problem.copy(), np.full((40, 3), np.nan)
    few[:4] = problem.centres[:4]
    with pytest.raises(InvalidArgument, match="4 images of the model have a position, 5 are needed"):
        georeference(problem, few)
    np.testing.assert_array_equal(problem.cameras, before.cameras)
    np.testing.assert_array_equal(problem.points, before.points)


def test_a_fix_at_zero_zero_does_not_move_the_origin() -> None:
    rows = np.array([[46.0, 9.0, 1.0], [46.1, 9.1, 2.0], [0.0, 0.0, 0.0], [46.2, 9.2, 3.0], [46.3, 9.3, 4.0]])
    assert local_positions(rows, geodetic=True).origin.tolist() == [46.1, 9.1, 2.0]
    rows[:, 1] = [179.99, -179.99, 0.0, 180.0, -180.0]
    found = local_positions(rows, geodetic=True)
    assert found.known.tolist() == [True, True, False, True, True]
    assert np.nanmax(np.abs(found.metres[:, 0])) < 2000


@pytest.mark.parametrize("geodetic", [True, False])
def test_a_position_of_no_fix_is_named_and_left_out(geodetic: bool) -> None:
    truth = flight(GRID, 2)
    gps = truth.centres + np.random.default_rng(2).normal(0, 0.1, truth.centres.shape)
    gps = geodetic_of(gps, [46.5, 9.25, 300.0]) if geodetic else gps + UTM
    gps[4] = 0
    found = georeference(in_a_frame_of_its_own(truth, 2), gps, geodetic=geodetic).outcome
    assert found.warnings == ["the position of 4 is at zero: left out, the receiver had no fix"]
    assert not found.outliers
    assert found.sigma_m == pytest.approx(0.1, rel=0.5)


@pytest.mark.parametrize("longitude", [-180.0, 0.0, 9.1])
def test_positions_may_lie_on_both_sides_of_the_date_line_and_of_greenwich(longitude: float) -> None:
    metres = np.random.default_rng(3).uniform(-400, 400, (10, 3))
    metres = np.concatenate([metres, -metres])  # as many on either side
    rows = geodetic_of(metres, [-16.8, longitude, 30.0])
    rows[:, 1] = (rows[:, 1] + 180) % 360 - 180
    found = local_positions(rows, geodetic=True)
    assert abs((found.origin[1] - longitude + 180) % 360 - 180) < 0.01
    assert -180 <= found.origin[1] < 180
    np.testing.assert_allclose(found.metres - found.metres[0], metres - metres[0], atol=0.1)
    rows[0, 1] = 0.5 - 179 * (longitude == 0)  # one that is wrong moves the origin no more than others
    assert abs((local_positions(rows, geodetic=True).origin[1] - longitude + 180) % 360 - 180) < 0.01


def test_zero_is_a_place_where_the_others_are_near() -> None:
    rows = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 1.0], [0.0, 10.0, 1.0]])
    assert local_positions(rows, geodetic=False).known.all()


@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2)])
def test_degrees_under_x_and_y_are_refused_and_small_scenes_are_not(order: tuple[int, ...]) -> None:
    metres = np.random.default_rng(0).uniform(-1, 1, (12, 3))
    degrees = geodetic_of(metres * [300.0, 200.0, 20.0], [46.84, -91.99, 198.0])
    no_fix = np.zeros((1, 3))
    with pytest.raises(InvalidArgument, match="which look like degrees: must be metres"):
        local_positions(np.concatenate([degrees[:, order], no_fix]), geodetic=False)
    for table_top in (0.15 * metres + 2.0, 0.02 * metres + 0.5):
        np.testing.assert_array_equal(local_positions(table_top, geodetic=False).metres, table_top)


def test_a_far_outlier_does_not_put_the_others_on_a_line() -> None:
    truth = flight(GRID, 3)
    gps = truth.centres + np.random.default_rng(3).normal(0, 0.1, truth.centres.shape)
    gps[4] += 1e6
    assert georeference(in_a_frame_of_its_own(truth, 3), gps).outcome.outliers == ["4"]


def test_the_same_bits_for_the_same_seed() -> None:
    truth = truth_of(1)
    gps = truth.centres + np.random.default_rng(0).normal(0, 1, truth.centres.shape)
    a, b = model_of(1), model_of(1)
    one = georeference_map(a, Positions(gps), replace(SETTINGS, seed=3))
    two = georeference_map(b, Positions(gps), replace(SETTINGS, seed=3))
    assert np.array_equal(a.poses, b.poses)
    assert one.sigma_m == two.sigma_m


def test_what_came_out_of_positions_is_told_in_a_line() -> None:
    truth = flight(GRID, 3)
    gps = truth.centres + np.random.default_rng(3).normal(0, 0.1, truth.centres.shape)
    outcome = georeference(in_a_frame_of_its_own(truth, 3), gps).outcome
    assert json.loads(json.dumps(outcome.to_dict()))["rms_m"] == outcome.rms_m  # plain values alone
    told = repr(outcome)
    assert re.match(r"GpsOutcome\(σ \S+ m, the model within \S+ m; left out none of \d+; origin x_m ", told)
    assert "\n" not in told
