"""Projective reconstruction from tracks alone: as good as the adjustment that starts from the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sfmcpp
from batch_scenes import share_of_noise, tracks_of, turntable
from sfmcpp import Problem
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.image_tracks import image_tracks
from sfmcpp.sfm.batch.projective import ProjectiveReconstruction, reconstruct_projective
from sfmcpp.sources.synthetic import hide_observations

pytest.importorskip("poselib", reason="fundamental matrices need the extra 'vision'")


def scene_of(kind: str) -> Problem:
    if kind == "corridor":
        return sfmcpp.corridor_scene(12, 700, length_m=6, pixel_sigma_px=1.0)
    scene = turntable(12, 350, sigma_px=1.0)
    pattern = kind.partition(" ")[2]
    return hide_observations(scene, 0.6 if pattern == "runs" else 0.5, pattern=pattern, seed=0)


@pytest.mark.parametrize("kind", ["corridor", "turntable runs", "turntable scattered"])
def test_wrong_and_missing_observations_do_no_harm(kind: str) -> None:
    truth = scene_of(kind)
    seen, is_wrong = sfmcpp.add_outliers(truth, 0.3, seed=0)
    found = reconstruct_projective(tracks_of(seen))
    assert found.images.tolist() == list(range(12))
    kept = is_wrong[found.observations]
    assert np.count_nonzero(~kept) > 0.85 * np.count_nonzero(~is_wrong)
    assert kept.mean() < 0.02
    assert found.sigma_px == pytest.approx(1.0, abs=0.15)
    assert share_of_noise(found, truth, is_wrong) < 1.3


def test_the_linear_solution_is_a_start_for_an_adjustment() -> None:
    truth = hide_observations(turntable(10, 200, sigma_px=0.5), 0.4, seed=0)
    found = reconstruct_projective(tracks_of(truth), adjusted=False)
    none = np.zeros(truth.num_observations, np.bool_)
    assert 1.0 < share_of_noise(found, truth, none) < 10.0
    assert len(found.observations) > 0.99 * truth.num_observations


def test_what_is_kept_is_told_by_its_place_in_the_input() -> None:
    truth = turntable(8, 120, sigma_px=0.5)
    tracks = tracks_of(truth)
    found = reconstruct_projective(tracks)
    problem = _problem(found)
    rows = found.observations
    np.testing.assert_array_equal(found.images[problem.camera_index], tracks.image_index[rows])
    np.testing.assert_array_equal(found.tracks[problem.point_index], tracks.track_index[rows])
    np.testing.assert_array_equal(problem.pixels, tracks.pixels[rows])
    assert problem.metadata.image_names == tracks.names
    np.testing.assert_array_equal(problem.metadata.image_sizes, tracks.sizes)


def test_neither_the_order_of_observations_nor_threads_change_a_bit() -> None:
    tracks = tracks_of(turntable(8, 120, sigma_px=0.5))
    order = np.random.default_rng(0).permutation(len(tracks))
    shuffled = replace(
        tracks,
        image_index=tracks.image_index[order],
        track_index=tracks.track_index[order],
        pixels=tracks.pixels[order],
    )
    one, other = reconstruct_projective(tracks, threads=1), reconstruct_projective(shuffled, threads=2)
    np.testing.assert_array_equal(_problem(one).cameras, _problem(other).cameras)
    np.testing.assert_array_equal(_problem(one).points, _problem(other).points)
    np.testing.assert_array_equal(one.observations, order[other.observations])


def test_images_apart_from_the_others_are_left_out_with_a_reason() -> None:
    truth = turntable(9, 200, sigma_px=0.5)
    # The last three images see other tracks, each its own.
    apart = truth.camera_index >= 6
    track = np.where(apart, 1000 * truth.camera_index + truth.point_index, truth.point_index)
    found = reconstruct_projective(image_tracks(truth.camera_index, track, truth.pixels))
    assert found.images.tolist() == [0, 1, 2, 3, 4, 5]
    assert sorted(found.left_out) == [6, 7, 8]
    assert "is consistent with another image" in found.left_out[7]


def test_an_image_without_block_is_resected() -> None:
    truth = turntable(9, 200, sigma_px=0.5)
    # Of image 8 a dozen observations: too few for an epipolar geometry among wrong ones, enough for a camera.
    rows = np.flatnonzero(truth.camera_index == 8)
    keep = np.ones(truth.num_observations, np.bool_)
    keep[rows[11:]] = False
    tracks = image_tracks(truth.camera_index[keep], truth.point_index[keep], truth.pixels[keep])
    found = reconstruct_projective(tracks)
    assert found.images.tolist() == list(range(9))


@pytest.mark.parametrize(
    ("images", "points", "reason"),
    [(6, 8, "no two images share enough"), (2, 100, "no three images share enough")],
)
def test_too_little_is_a_message(images: int, points: int, reason: str) -> None:
    found = reconstruct_projective(tracks_of(turntable(images, points, sigma_px=0.5)))
    assert found.problem is None
    assert reason in found.message
    assert sorted(found.left_out) == list(range(images))


def test_observations_without_sense_are_a_message() -> None:
    rng = np.random.default_rng(0)
    image, track = np.divmod(np.arange(6 * 60), 60)
    found = reconstruct_projective(image_tracks(image, track, rng.uniform(0, 500, (len(image), 2))))
    assert found.problem is None
    assert found.message


def test_arguments_are_checked() -> None:
    tracks = tracks_of(turntable(4, 30))
    with pytest.raises(InvalidArgument, match="max_error_px"):
        reconstruct_projective(tracks, max_error_px=0.0)
    with pytest.raises(InvalidArgument, match="seed"):
        reconstruct_projective(tracks, seed=-1)


def _problem(found: ProjectiveReconstruction) -> Problem:
    assert found.problem is not None
    return found.problem
