"""Observations moved to where photos agree: against the true images of points, and what must stay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry import fit_similarity
from sfmcpp.map import Map
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.photos import Photo
from sfmcpp.sfm import subpixel
from sfmcpp.sfm.adjustment import FINE, adjust_all
from sfmcpp.sfm.refinement import refine_models
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.sfm.subpixel import SubpixelSettings, refine_tracks
from textured_planes import NOISE_PX, cameras, images_of, noisy_map, on_planes, write_photos

for extra in ("cv2", "PIL"):
    pytest.importorskip(extra, reason=f"{extra} is not installed: pip install 'sfmcpp[vision]'")

POSES = cameras(5)


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> list[Photo]:
    return write_photos(tmp_path_factory.mktemp("planes"), POSES)


def errors_px(world: Map, still: BoolArray) -> FloatArray:
    """Errors of the keypoints that have moved, from the true image of what the one that stayed shows."""
    errors = []
    for point in range(len(world.points)):
        rows = world.observations_of([point])
        stayed = rows[still[rows]]
        if len(stayed) != 1:
            continue
        image = world.keypoint_images[stayed[0]]
        meant, _ = on_planes(POSES[image], world.keypoints[stayed])
        for row in rows[~still[rows]]:
            true = images_of(POSES[world.keypoint_images[row]], meant)[0]
            errors.append(world.keypoints[row] - true)
    return np.array(errors)


def test_errors_fall_to_a_fifth_on_planes(photos: list[Photo]) -> None:
    world = noisy_map(POSES)
    before = world.keypoints.copy()
    outcome = refine_tracks(world, photos)
    still = (world.keypoints == before).all(axis=1)
    assert outcome.refined == np.count_nonzero(~still)
    assert outcome.refined > 0.7 * (outcome.observations - outcome.points)
    errors = errors_px(world, still)
    assert len(errors) > 1000
    assert np.sqrt(np.mean(errors**2)) < NOISE_PX / 5
    world.keypoints[:] = before
    assert np.sqrt(np.mean(errors_px(world, still) ** 2)) > NOISE_PX


def test_coarse_keypoints_are_refined_in_smaller_copies_of_the_photos(photos: list[Photo]) -> None:
    world = noisy_map(POSES, scale=4.5)
    before = world.keypoints.copy()
    refine_tracks(world, photos)
    errors = errors_px(world, (world.keypoints == before).all(axis=1))
    assert len(errors) > 500
    assert np.sqrt(np.mean(errors**2)) < NOISE_PX / 2


@pytest.mark.parametrize("covariances", [False, True])
def test_the_accuracy_of_what_was_aligned_is_told(photos: list[Photo], covariances: bool) -> None:
    world = noisy_map(POSES)
    before = world.keypoints.copy()
    refine_tracks(world, photos, SubpixelSettings(sigma_px=0.02, covariances=covariances))
    moved = (world.keypoints != before).any(axis=1)
    variances = world.keypoint_covariances[:, [0, 2]]
    referred_to = (variances == 0.02**2).all(axis=1) & ~moved
    assert np.count_nonzero(referred_to) == len(np.unique(world.keypoint_points[moved]))
    assert np.isnan(variances[~moved & ~referred_to]).all()
    if not covariances:
        assert (variances[moved] == 0.02**2).all()
        return
    assert (variances[moved] > 0.02**2).all()
    assert 0.5 < np.mean(errors_px(world, ~moved) ** 2) / np.mean(variances[moved]) < 2


def test_the_adjustment_that_follows_is_nearer_to_the_true_poses(photos: list[Photo]) -> None:
    def worst_centre(world: Map) -> float:
        centres = world.poses[:, :, 3]
        away = fit_similarity(centres, POSES[:, :, 3]).apply(centres) - POSES[:, :, 3]
        return float(np.linalg.norm(away, axis=1).max())

    plain, refined, settings = noisy_map(POSES), noisy_map(POSES), IncrementalSettings()
    adjust_all(plain, settings, **FINE)
    adjust_all(refined, settings, **FINE)
    done = refine_models([refined], photos, settings)
    assert len(done.outcomes) == 1
    assert not done.warnings
    assert not done.interrupted
    assert worst_centre(refined) < worst_centre(plain) / 2


def test_threads_and_portions_do_not_change_a_bit(
    photos: list[Photo], monkeypatch: pytest.MonkeyPatch
) -> None:
    worlds = [noisy_map(POSES, num_points=200) for _ in range(3)]
    settings = SubpixelSettings(covariances=True)
    refine_tracks(worlds[0], photos, settings, threads=1)
    refine_tracks(worlds[1], photos, settings, threads=4)
    monkeypatch.setattr(subpixel, "_POINTS_AT_ONCE", 37)
    refine_tracks(worlds[2], photos, settings, threads=2)
    for world in worlds[1:]:
        assert world.keypoints.tobytes() == worlds[0].keypoints.tobytes()
        assert world.keypoint_covariances.tobytes() == worlds[0].keypoint_covariances.tobytes()


def test_observations_in_a_photo_of_something_else_stay(photos: list[Photo]) -> None:
    mixed = [*photos[:-1], replace(photos[0], name=photos[-1].name)]
    world = noisy_map(POSES, num_points=300)
    before = world.keypoints.copy()
    refine_tracks(world, mixed)
    moved = (world.keypoints != before).any(axis=1)
    counts = np.bincount(world.keypoint_images[moved], minlength=len(POSES))
    assert counts[-1] < 0.1 * counts[1]


def test_photos_without_files_are_left_out(photos: list[Photo]) -> None:
    known_by_tracks = [Photo(photo.name) for photo in photos]
    world = noisy_map(POSES, num_points=100)
    before = world.keypoints.copy()
    outcome = refine_tracks(world, known_by_tracks)
    assert outcome.refined == outcome.points == 0
    assert np.isnan(outcome.median_shift_px)
    assert np.isnan(world.keypoint_covariances).all()
    assert not refine_models([world], known_by_tracks, IncrementalSettings()).outcomes
    refine_tracks(world, [*photos[:2], *known_by_tracks[2:]])
    moved = (world.keypoints != before).any(axis=1)
    assert set(world.keypoint_images[moved].tolist()) <= {0, 1}


def test_stopped_or_without_a_photo_nothing_is_changed(photos: list[Photo], tmp_path: Path) -> None:
    world, settings = noisy_map(POSES, num_points=100), IncrementalSettings()
    before, poses = world.keypoints.copy(), world.poses.copy()
    stages: list[tuple[str, int, int]] = []

    def stop_late(stage: str, done: int, total: int) -> bool:
        stages.append((stage, done, total))
        return done == total - 1

    with pytest.raises(KeyboardInterrupt):
        refine_tracks(world, photos, progress=stop_late)
    assert stages[0] == ("refining", 0, 2 * len(photos))
    assert refine_models([world], photos, settings, progress=stop_late).interrupted
    gone = [*photos[:-1], replace(photos[-1], path=tmp_path / "gone.png")]
    with pytest.raises(DatasetError, match=r"gone\.png"):
        refine_tracks(world, gone)
    (warning,) = refine_models([world], gone, settings).warnings
    assert "gone.png" in warning
    assert (world.keypoints == before).all()
    assert (world.poses == poses).all()


def test_a_model_without_points_stays(photos: list[Photo]) -> None:
    world = noisy_map(POSES, num_points=20)
    world.points[:] = np.nan
    assert refine_tracks(world, photos).observations == 0


@pytest.mark.parametrize("wrong", [{"radius": 1}, {"max_shift": 0.0}, {"min_correlation": 1.5}])
def test_settings_that_break_a_rule_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InvalidArgument, match=next(iter(wrong))):
        SubpixelSettings(**wrong)  # type: ignore[arg-type]
