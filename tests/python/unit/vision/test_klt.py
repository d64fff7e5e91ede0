"""Tracks follow a texture that is moved by a known amount, cover the image, and are the same every time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.vision import FeatureTracks, KltSettings, track_features

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")

WIDTH, HEIGHT = 320, 200
SETTINGS = KltSettings(columns=6, rows=4, per_cell=4)
# Spread over the frequencies that an image of this size holds well below its sampling limit.
NUM_WAVES, LONGEST_PX, SHORTEST_PX = 300, 60.0, 6.0


def texture(shift_px: tuple[float, float], seed: int = 1) -> np.ndarray:
    """Waves in all directions, sampled where the image is after it moved: exact at any part of a pixel."""
    rng = np.random.default_rng(seed)
    direction, phase = rng.uniform(0, 2 * np.pi, (2, NUM_WAVES))
    frequency = 2 * np.pi / rng.uniform(SHORTEST_PX, LONGEST_PX, NUM_WAVES)
    x, y = np.arange(WIDTH) - shift_px[0], np.arange(HEIGHT) - shift_px[1]
    along_x = np.exp(1j * (np.outer(x, frequency * np.cos(direction)) + phase))
    along_y = np.exp(1j * np.outer(y, frequency * np.sin(direction)))
    grey = (along_y @ along_x.T).real
    return np.clip(128 + 40 * grey / grey.std(), 0, 255).round().astype(np.uint8)


def moved(step_px: tuple[float, float], count: int) -> list[np.ndarray]:
    return [texture((k * step_px[0], k * step_px[1])) for k in range(count)]


def track(tracks: FeatureTracks, number: int) -> tuple[np.ndarray, np.ndarray]:
    mask = tracks.track_index == number
    return tracks.frame_index[mask], tracks.pixels[mask]


@pytest.mark.parametrize("step_px", [(0.3, -0.45), (2.7, 1.15), (-11.6, 7.2), (0.0, 0.0)])
def test_tracks_follow_a_known_motion_to_a_tenth_of_a_pixel(step_px: tuple[float, float]) -> None:
    found = track_features(moved(step_px, 4), SETTINGS)
    errors = []
    for number in range(found.track_index.max() + 1):
        frames, pixels = track(found, number)
        errors.append((pixels - pixels[0]) - np.outer(frames - frames[0], step_px))
    distance = np.linalg.norm(np.concatenate(errors), axis=1)
    assert np.percentile(distance, 99) < 0.1
    in_all = np.bincount(found.track_index) == 4
    assert in_all.sum() > 0.5 * SETTINGS.columns * SETTINGS.rows * SETTINGS.per_cell


def test_a_track_ends_where_its_square_leaves_the_image() -> None:
    found = track_features(moved((-15.0, 0.0), 8), SETTINGS)
    border = SETTINGS.window_px // 2
    assert found.pixels[:, 0].min() >= border
    assert found.pixels[:, 0].max() <= WIDTH - 1 - border
    for number in found.track_index[found.frame_index == 0]:
        frames, pixels = track(found, number)
        if frames[-1] < 7:
            assert pixels[-1, 0] - 15 < border + 0.5


def test_every_cell_is_filled_in_every_frame_and_no_more_than_asked_for_at_the_start() -> None:
    settings = replace(SETTINGS, min_distance_px=6, quality=1e-3)
    found = track_features(moved((3.0, 1.0), 6), settings)
    cells = np.floor(found.pixels / [WIDTH, HEIGHT] * [settings.columns, settings.rows]).astype(int)
    counts = np.zeros((6, settings.columns, settings.rows), dtype=int)
    np.add.at(counts, (found.frame_index, cells[:, 0], cells[:, 1]), 1)
    assert counts.min() >= settings.per_cell
    assert counts[0].max() == settings.per_cell


def test_new_corners_keep_their_distance_from_all_others() -> None:
    found = track_features([texture((0, 0))], SETTINGS)
    difference = np.linalg.norm(found.pixels[:, None] - found.pixels[None], axis=2)
    np.fill_diagonal(difference, np.inf)
    assert difference.min() >= SETTINGS.min_distance_px


def test_a_track_sees_consecutive_frames_and_its_number_is_never_used_again() -> None:
    scenes = [*moved((-6.0, 4.0), 4), *(texture((0, 0), seed=2) for _ in range(3))]
    found = track_features(scenes, SETTINGS)
    for number in range(found.track_index.max() + 1):
        frames, _ = track(found, number)
        np.testing.assert_array_equal(frames, np.arange(frames[0], frames[0] + len(frames)))


def test_another_picture_ends_nearly_all_tracks() -> None:
    found = track_features([texture((0, 0)), texture((0, 0), seed=2)], SETTINGS)
    first, second = (found.track_index[found.frame_index == k] for k in range(2))
    assert len(np.intersect1d(first, second)) < 0.1 * len(first)


def test_a_blank_image_has_no_tracks_and_those_after_it_are_new() -> None:
    blank = np.full((HEIGHT, WIDTH), 90, np.uint8)
    found = track_features([texture((0, 0)), blank, texture((0, 0))], SETTINGS)
    first, none, last = (found.track_index[found.frame_index == k] for k in range(3))
    assert len(none) == 0
    assert last.min() > first.max()


@pytest.mark.parametrize("threads", [1, 4])
def test_the_same_images_give_the_same_tracks_whatever_the_threads(threads: int) -> None:
    images, before = moved((4.3, -2.2), 4), cv2.getNumThreads()
    reference = track_features(images, SETTINGS)
    try:
        cv2.setNumThreads(threads)
        again = track_features(images, SETTINGS)
    finally:
        cv2.setNumThreads(before)
    for name in ("frame_index", "track_index", "pixels"):
        np.testing.assert_array_equal(getattr(again, name), getattr(reference, name))


def test_no_frame_and_frames_smaller_than_the_window_have_no_tracks() -> None:
    assert track_features([]).num_frames == 0
    tiny = track_features([np.eye(9, dtype=np.uint8) * 255] * 2, SETTINGS)
    assert (tiny.num_frames, len(tiny.pixels)) == (2, 0)


@pytest.mark.parametrize(
    ("name", "value"),
    [("columns", 0), ("window_px", 20), ("levels", -1), ("forward_backward_px", 0.0), ("quality", 1.0)],
)
def test_settings_that_cannot_be_are_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(InvalidArgument, match=rf"^{name} = {value}: must be"):
        KltSettings(**{name: value})


def test_frames_of_another_kind_or_size_are_refused() -> None:
    with pytest.raises(InvalidArgument, match=r"frames\[0\] is float64"):
        track_features([np.zeros((20, 30))])
    with pytest.raises(InvalidArgument, match=r"frames\[1\] has shape \(20, 31\)"):
        track_features([np.zeros((20, 30), np.uint8), np.zeros((20, 31), np.uint8)])
