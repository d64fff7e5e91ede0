"""Incremental reconstruction of synthetic scenes, against the truth."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import sfmcpp
from sfm_scenes import match_graph
from sfmcpp import InvalidArgument
from sfmcpp.geometry import fit_similarity, so3
from sfmcpp.map import Map
from sfmcpp.model import Problem
from sfmcpp.sfm import MatchGraph, reconstruct
from sfmcpp.sfm.cameras import Cameras, cameras_of
from sfmcpp.sfm.contradictions import contradicting_pairs
from sfmcpp.sfm.growth import Growth
from sfmcpp.sfm.incremental import GrownModels, grow_models
from sfmcpp.sfm.outcome import warnings_of
from sfmcpp.sfm.scene import Scene
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.sfm.structure import Sightings

SIGMA_PX = 0.5


def truth_of(cameras: int = 12, points: int = 400) -> Problem:
    return sfmcpp.circle_scene(cameras, points, pixel_sigma_px=0.0, seed=4)


def grown(graph: MatchGraph, cameras: Cameras, **settings: float) -> GrownModels:
    limits = IncrementalSettings(**settings)  # type: ignore[arg-type]
    return grow_models(Scene.of(graph, cameras), limits, lambda _: False)


def known_cameras(graph: MatchGraph, truth: Problem) -> Cameras:
    row = np.concatenate([truth.intrinsics[0, :5], np.zeros(7)])
    return cameras_of(graph.photos, calibration=row)


def centre_errors(world: Map, truth: Problem) -> np.ndarray:
    has = world.registered
    place = fit_similarity(world.poses[has][:, :, 3], truth.centres[has])
    return np.linalg.norm(place.apply(world.poses[has][:, :, 3]) - truth.centres[has], axis=1)


@pytest.mark.parametrize("outliers", [0.0, 0.3])
def test_all_images_get_poses_as_near_the_truth_as_the_noise_allows(outliers: float) -> None:
    truth = truth_of()
    graph = match_graph(truth, sigma_px=SIGMA_PX, outliers=outliers)
    found = grown(graph, known_cameras(graph, truth))
    assert [int(world.registered.sum()) for world in found.models] == [truth.num_cameras]
    world = found.models[0]
    assert centre_errors(world, truth).mean() < 1.05 * best_possible_error(graph, truth)
    assert np.count_nonzero(world.known) >= 0.95 * truth.num_points


def best_possible_error(graph: MatchGraph, truth: Problem) -> float:
    """Mean error of the centres of an adjustment that starts at the truth and knows all tracks."""
    best = truth.copy()
    order = np.lexsort((best.point_index, best.camera_index))
    best.camera_index, best.point_index = best.camera_index[order], best.point_index[order]
    best.pixels = np.concatenate([features.pixels for features in graph.features])
    sfmcpp.solve(best, function_tolerance=1e-10)
    place = fit_similarity(best.centres, truth.centres)
    return float(np.linalg.norm(place.apply(best.centres) - truth.centres, axis=1).mean())


def test_an_unknown_focal_length_is_found_from_a_guess_that_is_off_by_a_fifth() -> None:
    truth = truth_of()
    graph = match_graph(truth, sigma_px=SIGMA_PX, known=False)
    cameras = cameras_of(graph.photos, focal_px=1.2 * truth.intrinsics[0, 0], sharing="one")
    cameras.intrinsics[:, 2:4] = truth.intrinsics[0, 2:4]
    found = grown(graph, cameras)
    world = found.models[0]
    assert world.registered.all()
    assert world.intrinsics[0, 0] == pytest.approx(truth.intrinsics[0, 0], rel=0.01)
    assert abs(world.intrinsics[0, 5]) < 0.02


def test_the_seed_chooses_matches_that_tell_an_unknown_focal_length(monkeypatch: pytest.MonkeyPatch) -> None:
    seeds = []

    def noted(*_: object, seed: int = 0) -> None:
        seeds.append(seed)

    monkeypatch.setattr("sfmcpp.sfm.run.focal_from_pairs", noted)
    graph = match_graph(truth_of(3, 60), known=False)
    reconstruct(graph, seed=7, shared_camera="one")
    assert seeds == [7]


def test_masks_are_refused_where_there_are_no_images() -> None:
    graph = match_graph(truth_of(3, 60))
    with pytest.raises(InvalidArgument, match="masks: the source has no images"):
        reconstruct(graph, masks="masks")


def test_rotations_follow_the_truth() -> None:
    truth = truth_of()
    graph = match_graph(truth, sigma_px=SIGMA_PX)
    world = grown(graph, known_cameras(graph, truth)).models[0]
    place = fit_similarity(world.poses[:, :, 3], truth.centres)
    rotations = place.apply_to_poses(world.poses)[:, :, :3]
    apart = [so3.rotation_angle(a.T @ b) for a, b in zip(rotations, truth.rotations, strict=True)]
    assert np.degrees(np.max(apart)) < 0.2


def test_photos_of_two_places_become_two_models_and_none_is_lost() -> None:
    one, two = truth_of(8), truth_of(5)
    graph = together(match_graph(one, sigma_px=SIGMA_PX), match_graph(two, sigma_px=SIGMA_PX, seed=1))
    found = grown(graph, known_cameras(graph, one))
    counts = [int(world.registered.sum()) for world in found.models]
    assert counts == [8, 5]
    assert (found.models[0].registered ^ found.models[1].registered).all()


def test_maps_after_the_first_are_made_once_and_are_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    graph, made = match_graph(truth_of(3, 60)), []
    scene = Scene.of(graph, known_cameras(graph, truth_of(3, 60)))
    add_images = Map.add_images
    monkeypatch.setattr(Map, "add_images", lambda world, *a, **k: made.append(add_images(world, *a, **k)))
    worlds = [scene.new_map() for _ in range(4)]
    assert len(made) == 2
    for world in worlds[1:]:
        np.testing.assert_array_equal(world.keypoint_points, worlds[0].keypoint_points)
        assert not world.registered.any()
        world.poses[:] = 0.0
        world.forget([0, 1])


def test_sizes_of_many_models_are_told_by_the_largest_and_the_smallest() -> None:
    graph = match_graph(truth_of(4, 60))
    scene = Scene.of(graph, known_cameras(graph, truth_of(4, 60)))

    def warning(counts: list[int]) -> str:
        worlds = [scene.new_map() for _ in counts]
        for world, count in zip(worlds, counts, strict=True):
            world.poses[:count] = np.eye(3, 4)
        settings = IncrementalSettings()
        contradicting = [contradicting_pairs(graph, world, settings) for world in worlds]
        return warnings_of(graph, GrownModels(worlds), contradicting, settings)[-1]

    assert warning([4, 3, 2]) == "the images form 3 separate models of 4, 3, 2 images"
    assert warning([4, *[3] * 9, 2]) == "the images form 11 separate models of 2 to 4 images each"
    assert warning([3] * 11) == "the images form 11 separate models of 3 images each"


def test_images_that_no_model_was_started_with_are_told_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sfmcpp.sfm.incremental._MODELS", 1)
    one, two = truth_of(8), truth_of(5)
    graph = together(match_graph(one, sigma_px=SIGMA_PX), match_graph(two, sigma_px=SIGMA_PX, seed=1))
    why = "1 models were started, which is the most; reconstruct these images by themselves"
    run = reconstruct(graph, camera=1000.0, subpixel=False)
    assert [run.images[photo.name].reason for photo in graph.photos] == [""] * 8 + [why] * 5
    assert f"5 images that fit others are in no model, first other/000.jpg: {why}" in run.warnings


def together(a: MatchGraph, b: MatchGraph) -> MatchGraph:
    from dataclasses import replace

    shift = len(a.photos)
    photos = [*a.photos, *(replace(photo, name=f"other/{photo.name}") for photo in b.photos)]
    moved = [replace(p, first=p.first + shift, second=p.second + shift) for p in b.pairs]
    return MatchGraph(photos, [*a.features, *b.features], [*a.pairs, *moved])


@pytest.mark.parametrize("camera", ["auto", 1000.0])
def test_the_same_bits_for_every_run_and_number_of_threads(camera: str | float) -> None:
    graph = match_graph(truth_of(8, 200), sigma_px=SIGMA_PX, outliers=0.2)
    first, *others = (reconstruct(graph, camera=camera, threads=n).models[0] for n in (1, 1, 3))
    for other in others:
        assert np.array_equal(first.poses, other.poses)
        assert np.array_equal(first.points, other.points, equal_nan=True)


def test_a_listener_that_asks_to_stop_leaves_the_model_so_far() -> None:
    truth = truth_of()
    graph = match_graph(truth, sigma_px=SIGMA_PX)
    scene = Scene.of(graph, known_cameras(graph, truth))
    found = grow_models(scene, IncrementalSettings(), lambda count: count >= 5)
    assert found.interrupted
    assert int(found.models[0].registered.sum()) == 5


def test_an_interruption_while_models_are_joined_leaves_what_there_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one, two = truth_of(4, 150), truth_of(3, 150)
    graph = together(match_graph(one, sigma_px=SIGMA_PX), match_graph(two, sigma_px=SIGMA_PX, seed=1))
    finish, finished = Growth.finish, []

    def finish_or_interrupt(growth: Growth) -> None:
        finished.append(growth)
        if len(finished) > 2:
            raise KeyboardInterrupt
        finish(growth)

    monkeypatch.setattr(Growth, "finish", finish_or_interrupt)
    monkeypatch.setattr("sfmcpp.sfm.incremental.merge_models", lambda *_: True)
    found = grown(graph, known_cameras(graph, one))
    assert found.interrupted
    assert [int(world.registered.sum()) for world in found.models] == [4]


def test_a_first_pair_that_fails_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = truth_of(8, 200)
    graph = match_graph(truth, sigma_px=SIGMA_PX, outliers=0.3)
    scene = Scene.of(graph, known_cameras(graph, truth))
    joined = []

    def join_and_fail(growth: Growth, _: float) -> bool:
        joined.append(growth.structure.join_tracks(np.flatnonzero(growth.world.known)[None, :2]))
        return False

    monkeypatch.setattr(Growth, "_is_good_start", join_and_fail)
    growth = Growth(scene, IncrementalSettings(), np.zeros(8, dtype=np.bool_))
    assert not growth.start()
    assert sum(joined) > 0
    assert np.array_equal(growth.structure.tracks, scene.tracks.track)
    assert np.array_equal(growth.world.keypoint_points, scene.new_map().keypoint_points)
    assert not growth.world.registered.any()


def test_an_image_that_loses_its_points_each_time_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, odd = truth_of(8, 200), 7
    graph = match_graph(truth, sigma_px=SIGMA_PX)
    give_up = Growth._give_up_lost_images

    def lose(growth: Growth) -> None:
        world = growth.world
        rows = world.keypoints_of([odd])
        rows = rows[world.keypoint_points[rows] >= 0]
        seen = world.keypoint_points[rows].copy()
        world.forget(rows)
        give_up(growth)
        world.observe(rows, seen)

    def is_without_end(_: int) -> bool:
        told.append(1)
        return len(told) > 50

    told: list[int] = []
    monkeypatch.setattr(Growth, "_give_up_lost_images", lose)
    scene = Scene.of(graph, known_cameras(graph, truth))
    found = grow_models(scene, IncrementalSettings(), is_without_end)
    assert not found.interrupted
    assert np.flatnonzero(~found.models[0].registered).tolist() == [odd]
    assert found.reasons[odd] == "it lost its points each of the 3 times that it had a pose"


def test_a_model_that_loses_all_its_images_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    def lose_all(growth: Growth) -> None:
        growth.world.poses[:] = np.nan

    truth = truth_of(4)
    graph = match_graph(truth, sigma_px=SIGMA_PX)
    monkeypatch.setattr(Growth, "_give_up_lost_images", lose_all)
    assert grown(graph, known_cameras(graph, truth)).models == []


def test_what_sees_known_points_is_kept_up_to_date() -> None:
    truth, random = truth_of(), np.random.default_rng(0)
    graph = match_graph(truth, sigma_px=SIGMA_PX)
    world = grown(graph, known_cameras(graph, truth)).models[0]
    sightings = Sightings(world)
    for _ in range(4):
        world.points[random.choice(len(world.points), 20, replace=False)] = np.nan
        world.points[random.choice(np.flatnonzero(~world.known), 5)] = 1.0
        world.forget(random.choice(np.flatnonzero(world.keypoint_points >= 0), 50, replace=False))
        world.merge(*random.choice(np.flatnonzero(world.known), 2, replace=False).tolist())
        before = sightings.sees.copy()
        sightings.update()
        sees = (world.keypoint_points >= 0) & world.known[world.keypoint_points]
        assert np.array_equal(sightings.sees, sees)
        assert np.array_equal(
            sightings.counts, np.bincount(world.keypoint_images[sees], minlength=world.num_images)
        )
        assert set(world.keypoint_images[sees != before]) <= set(np.flatnonzero(sightings.changed))


def test_points_need_three_views_where_that_is_asked_for() -> None:
    truth = truth_of(8, 200)
    graph = match_graph(truth, sigma_px=SIGMA_PX)
    world = grown(graph, known_cameras(graph, truth), min_views=3).models[0]
    views = np.bincount(world.keypoint_points[world.keypoint_points >= 0], minlength=len(world.points))
    assert views[world.known].min() >= 3


@pytest.mark.parametrize(
    ("change", "rule"),
    [
        ({"min_angle_deg": float("nan")}, "min_angle_deg = nan: must be finite and not negative"),
        ({"intrinsics_images": 0}, "intrinsics_images = 0: must be at least 1"),
        ({"min_model_images": 0}, "min_model_images = 0: must be at least 1"),
        ({"overlap_images": -1}, "overlap_images = -1: must be at least 0"),
        ({"local_images": 2.5}, "local_images = 2.5: must be a whole number"),
    ],
)
def test_settings_out_of_their_range_are_refused_by_name(change: dict[str, float], rule: str) -> None:
    with pytest.raises(InvalidArgument, match=rule):
        IncrementalSettings(**change)  # type: ignore[arg-type]


def test_how_points_cover_an_image_is_computed_again_only_where_they_have_changed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    truth = truth_of()
    graph = match_graph(truth, sigma_px=SIGMA_PX)
    compute, seen = Growth._cells_with_points, [[np.empty(0, dtype=np.intp)] for _ in graph.photos]

    def counted(growth: Growth, image: int, rows: np.ndarray) -> int:
        seen[image].append(rows)
        return compute(growth, image, rows)

    monkeypatch.setattr(Growth, "_cells_with_points", counted)
    (world,) = grown(graph, known_cameras(graph, truth)).models
    assert world.registered.all()
    for one in seen:
        assert not any(np.array_equal(a, b) for a, b in pairwise(one))
