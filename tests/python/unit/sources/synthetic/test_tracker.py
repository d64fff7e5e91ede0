"""Tracks begin at their corners, drift as a random walk, break off as often as told, and have no holes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.sources.synthetic import Tracker
from sfmcpp.sources.synthetic.image_geometry import ImageGeometry
from sfmcpp.sources.synthetic.sight import Sight
from sfmcpp.sources.synthetic.tracker import Tracks, track

Array = NDArray[np.float64]
GEOMETRY = ImageGeometry("calibrated", 500.0, (640, 480))
QUIET = {"sigma_px": 0.0, "drift_px": 0.0, "loss": 0.0, "sliding": 0.0}


def cloud(count: int = 400, seed: int = 0) -> Array:
    return np.random.default_rng(seed).uniform([-3, -2, 8], [3, 2, 12], (count, 3))


def sideways(frames: int, step_m: float = 0.0) -> Array:
    """Cameras that look along z and move along x."""
    cameras = np.tile(np.eye(3, 4), (frames, 1, 1))
    cameras[:, 0, 3] = step_m * np.arange(frames)
    return cameras


def exact(tracks: Tracks, cameras: Array, points: Array) -> Array:
    inside = points[tracks.point_index[tracks.track_index]] - cameras[tracks.frame_index, :, 3]
    return 500 * inside[:, :2] / inside[:, 2:] + [320, 240]


def followed(
    tracker: Tracker, frames: int, step_m: float = 0.0, seed: int = 1
) -> tuple[Tracks, Array, Array]:
    """Tracks, their errors [px], and how many frames ago each began."""
    cameras, points = sideways(frames, step_m), cloud()
    found = track(GEOMETRY, cameras, points, tracker, np.random.default_rng(seed), Sight(20.0))
    first = np.full(len(found.point_index), frames)
    np.minimum.at(first, found.track_index, found.frame_index)
    return found, found.pixels - exact(found, cameras, points), found.frame_index - first[found.track_index]


def test_without_noise_pixels_are_the_projections() -> None:
    _, error, _ = followed(Tracker(150, **QUIET), 30, 0.1)
    assert np.abs(error).max() < 1e-9


def test_errors_grow_as_a_random_walk_from_none_at_the_corner() -> None:
    _, error, age = followed(Tracker(400, sigma_px=0.2, drift_px=0.1, loss=0.0, sliding=0.0), 60)
    assert np.abs(error[age == 0]).max() < 1e-9
    for frames in (1, 10, 50):
        at = error[age == frames]
        expected = np.sqrt(0.2**2 + frames * 0.1**2)
        np.testing.assert_allclose(at.std(), expected, rtol=4 / np.sqrt(2 * at.size))


def test_so_many_tracks_slide_and_evenly() -> None:
    tracker = Tracker(400, sigma_px=0.0, drift_px=0.0, loss=0.0, sliding=0.25, slide_px=0.3)
    found, error, age = followed(tracker, 20)
    slides = np.abs(error[age == 10]).max(axis=1) > 1e-9
    assert abs(slides.mean() - 0.25) < 4 * np.sqrt(0.25 * 0.75 / len(slides))
    at_ten = dict(zip(found.track_index[age == 10], error[age == 10], strict=True))
    for k, e in zip(found.track_index[age == 5], error[age == 5], strict=True):
        np.testing.assert_allclose(at_ten[k], 2 * e, atol=1e-9)


def test_tracks_are_lost_as_often_as_told() -> None:
    found, _, age = followed(Tracker(300, sigma_px=0.0, drift_px=0.0, loss=0.1, sliding=0.0), 200)
    survived = np.count_nonzero(age > 0) / np.count_nonzero(found.frame_index < 199)
    assert abs(survived - 0.9) < 4 * np.sqrt(0.09 / len(age))


def test_tracks_have_no_holes_and_no_more_are_alive_than_told() -> None:
    found, _, _ = followed(Tracker(120), 80, 0.05)
    counts = np.bincount(found.frame_index)
    assert (counts <= 120).all()
    assert (counts[1:] > 100).all()
    order = np.lexsort((found.frame_index, found.track_index))
    same = np.diff(found.track_index[order]) == 0
    assert (np.diff(found.frame_index[order])[same] == 1).all()
    assert len(np.unique(np.stack([found.frame_index, found.track_index]), axis=1).T) == len(found.pixels)


def test_a_point_lost_and_found_again_is_another_track() -> None:
    found, error, age = followed(Tracker(400, sigma_px=0.0, drift_px=0.5, loss=0.2, sliding=0.0), 40)
    assert np.bincount(found.point_index).max() > 2
    assert np.abs(error[age == 0]).max() < 1e-9


def test_the_seed_decides_everything() -> None:
    one, same, other = (followed(Tracker(), 30, 0.05, seed)[0].pixels for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert one.shape != other.shape or not np.array_equal(one, other)


@pytest.mark.parametrize(
    ("name", "value"),
    [("max_tracks", 0), ("sigma_px", -1.0), ("drift_px", np.nan), ("loss", 1.5), ("sliding", -0.1)],
)
def test_what_no_tracker_does_is_refused(name: str, value: float) -> None:
    with pytest.raises(InvalidArgument, match=name):
        Tracker(**{name: value})  # type: ignore[arg-type]
