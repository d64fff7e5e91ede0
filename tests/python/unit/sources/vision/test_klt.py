"""Tracks follow a texture that is moved by a known amount, cover the image, and are the same every time."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from sfmcpp.errors import InvalidArgument
from sfmcpp.sources.vision import CORNERS, KltSettings, follow_features

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


class FeatureTracks:
    """What all frames see, by frame and then by track."""

    def __init__(self, images: Iterable[np.ndarray], settings: KltSettings | None = None) -> None:
        views = list(follow_features(images, settings))
        self.num_frames = len(views)
        self.frame_index = np.repeat(np.arange(len(views)), [len(view.tracks) for view in views])
        self.track_index = np.concatenate([np.empty(0, np.int32), *(view.tracks for view in views)])
        self.pixels = np.concatenate([np.empty((0, 2)), *(view.pixels for view in views)])


def track(tracks: FeatureTracks, number: int) -> tuple[np.ndarray, np.ndarray]:
    mask = tracks.track_index == number
    return tracks.frame_index[mask], tracks.pixels[mask]


@pytest.mark.parametrize("corners", CORNERS)
@pytest.mark.parametrize("step_px", [(0.3, -0.45), (2.7, 1.15), (-11.6, 7.2), (0.0, 0.0)])
def test_tracks_follow_a_known_motion_to_a_tenth_of_a_pixel(
    step_px: tuple[float, float], corners: str
) -> None:
    found = FeatureTracks(moved(step_px, 4), replace(SETTINGS, corners=corners))
    errors = []
    for number in range(found.track_index.max() + 1):
        frames, pixels = track(found, number)
        errors.append((pixels - pixels[0]) - np.outer(frames - frames[0], step_px))
    distance = np.linalg.norm(np.concatenate(errors), axis=1)
    assert np.percentile(distance, 99) < 0.1
    in_all = np.bincount(found.track_index) == 4
    assert in_all.sum() > 0.5 * SETTINGS.columns * SETTINGS.rows * SETTINGS.per_cell


@pytest.mark.parametrize("gains", [(1.0, 0.6, 1.0, 0.6), (1.0, 1.3, 1.6, 1.0), (0.3, 1.0, 0.3, 1.0)])
def test_tracks_are_followed_as_well_where_the_exposure_changes(gains: tuple[float, ...]) -> None:
    steady = moved((2.7, 1.15), 4)
    images = [
        np.minimum(image * gain, 255).astype(np.uint8) for image, gain in zip(steady, gains, strict=True)
    ]
    found, reference = FeatureTracks(images, SETTINGS), FeatureTracks(steady, SETTINGS)
    in_all, of_reference = (np.count_nonzero(np.bincount(f.track_index) == 4) for f in (found, reference))
    assert in_all > 0.8 * of_reference
    errors = []
    for number in np.unique(found.track_index):
        frames, pixels = track(found, number)
        errors.append((pixels - pixels[0]) - np.outer(frames - frames[0], (2.7, 1.15)))
    assert np.percentile(np.linalg.norm(np.concatenate(errors), axis=1), 90) < 0.1


@pytest.mark.parametrize("corners", CORNERS)
def test_corners_are_the_strongest_around_in_the_half_image_by_their_own_measure(corners: str) -> None:
    settings = replace(SETTINGS, corners=corners, quality=0.2)
    image = texture((0, 0))
    response = corner_responses(cv2.pyrDown(image))[corners]
    columns, rows = (FeatureTracks([image], settings).pixels / 2).astype(int).T
    border = settings.window_px // 4 + 1
    inner = response[border:-border, border:-border]
    least = {"shi-tomasi": 0.2, "harris": 0.2**2}[corners] * inner.max()
    assert len(rows) > 10
    assert response[rows, columns].min() >= least * (1 - 1e-5)
    strongest_beside = ndimage.maximum_filter(response, 3)[rows, columns]
    np.testing.assert_allclose(response[rows, columns], strongest_beside, rtol=1e-5)


def corner_responses(image: np.ndarray) -> dict[str, np.ndarray]:
    """Both measures of a corner, from the structure tensor over squares of three pixels."""
    gradients = [ndimage.sobel(image.astype(np.float64), axis, mode="mirror") for axis in (1, 0)]
    xx, xy, yy = (ndimage.uniform_filter(gradients[a] * gradients[b], 3) for a, b in ((0, 0), (0, 1), (1, 1)))
    trace, determinant = xx + yy, xx * yy - xy**2
    smaller = trace / 2 - np.sqrt(np.maximum((trace / 2) ** 2 - determinant, 0))
    return {"shi-tomasi": smaller, "harris": determinant - 0.04 * trace**2}


def test_the_two_kinds_of_corners_differ() -> None:
    one, other = (FeatureTracks([texture((0, 0))], replace(SETTINGS, corners=c)).pixels for c in CORNERS)
    assert len(one) != len(other) or (one != other).any()


def test_features_come_frame_by_frame_and_no_older_image_is_kept() -> None:
    images: list[weakref.ref[np.ndarray]] = []

    def taken() -> Iterator[np.ndarray]:
        for k in range(4):
            image = texture((3.0 * k, 0.0))
            images.append(weakref.ref(image))
            yield image
            del image

    stream = follow_features(taken(), SETTINGS)
    for number, features in enumerate(stream):
        assert len(images) == number + 1
        assert [image() is not None for image in images[:-2]] == [False] * (number - 1)
        assert (np.diff(features.tracks) > 0).all()
        assert features.pixels.shape == (len(features.tracks), 2)


def test_a_track_ends_where_its_square_leaves_the_image() -> None:
    found = FeatureTracks(moved((-15.0, 0.0), 8), SETTINGS)
    border = SETTINGS.window_px // 2
    assert found.pixels[:, 0].min() >= border
    assert found.pixels[:, 0].max() <= WIDTH - 1 - border
    for number in found.track_index[found.frame_index == 0]:
        frames, pixels = track(found, number)
        if frames[-1] < 7:
            assert pixels[-1, 0] - 15 < border + 0.5


def test_every_cell_is_filled_in_every_frame_and_no_more_than_asked_for_at_the_start() -> None:
    settings = replace(SETTINGS, min_distance_px=6, quality=1e-3)
    found = FeatureTracks(moved((3.0, 1.0), 6), settings)
    cells = np.floor(found.pixels / [WIDTH, HEIGHT] * [settings.columns, settings.rows]).astype(int)
    counts = np.zeros((6, settings.columns, settings.rows), dtype=int)
    np.add.at(counts, (found.frame_index, cells[:, 0], cells[:, 1]), 1)
    assert counts.min() >= settings.per_cell
    assert counts[0].max() == settings.per_cell


def test_new_corners_keep_their_distance_from_all_others() -> None:
    found = FeatureTracks([texture((0, 0))], SETTINGS)
    difference = np.linalg.norm(found.pixels[:, None] - found.pixels[None], axis=2)
    np.fill_diagonal(difference, np.inf)
    assert difference.min() >= SETTINGS.min_distance_px


def test_a_track_sees_consecutive_frames_and_its_number_is_never_used_again() -> None:
    scenes = [*moved((-6.0, 4.0), 4), *(texture((0, 0), seed=2) for _ in range(3))]
    found = FeatureTracks(scenes, SETTINGS)
    for number in range(found.track_index.max() + 1):
        frames, _ = track(found, number)
        np.testing.assert_array_equal(frames, np.arange(frames[0], frames[0] + len(frames)))


def test_another_picture_ends_nearly_all_tracks() -> None:
    found = FeatureTracks([texture((0, 0)), texture((0, 0), seed=2)], SETTINGS)
    first, second = (found.track_index[found.frame_index == k] for k in range(2))
    assert len(np.intersect1d(first, second)) < 0.1 * len(first)


@pytest.mark.parametrize("blanks", [1, 5])
def test_corners_before_blank_images_are_followed_to_those_after_them(blanks: int) -> None:
    blank = np.full((HEIGHT, WIDTH), 90, np.uint8)
    first, last = moved((7.4, -5.2), 2)
    found = FeatureTracks([first, *[blank] * blanks, last], SETTINGS)
    assert set(found.frame_index) == {0, blanks + 1}
    motions = [np.diff(track(found, k)[1], axis=0) for k in range(found.track_index.max() + 1)]
    followed = np.concatenate(motions)
    assert len(followed) > 0.7 * np.count_nonzero(found.frame_index == 0)
    assert np.median(np.abs(followed - [7.4, -5.2])) < 0.05
    assert (np.diff(found.track_index[found.frame_index == blanks + 1]) > 0).all()


def test_after_many_blank_images_all_tracks_are_new() -> None:
    blank = np.full((HEIGHT, WIDTH), 90, np.uint8)
    found = FeatureTracks([texture((0, 0)), *[blank] * 6, texture((0, 0))], SETTINGS)
    first, last = (found.track_index[found.frame_index == k] for k in (0, 7))
    assert last.min() > first.max()


def test_corners_that_come_back_are_not_followed_twice() -> None:
    scene, spoilt = texture((0, 0)), texture((0, 0), seed=2)
    # A shadow of the scene: its corners are found in the spoilt image, too.
    spoilt = (0.75 * spoilt + 0.25 * scene).astype(np.uint8)
    found = FeatureTracks([scene, spoilt, scene], SETTINGS)
    last = found.pixels[found.frame_index == 2]
    difference = np.linalg.norm(last[:, None] - last[None], axis=2)
    np.fill_diagonal(difference, np.inf)
    assert difference.min() >= SETTINGS.min_distance_px - 1


@pytest.mark.parametrize("threads", [1, 4])
def test_the_same_images_give_the_same_tracks_whatever_the_threads(threads: int) -> None:
    images, before = moved((4.3, -2.2), 4), cv2.getNumThreads()
    reference = FeatureTracks(images, SETTINGS)
    try:
        cv2.setNumThreads(threads)
        again = FeatureTracks(images, SETTINGS)
    finally:
        cv2.setNumThreads(before)
    for name in ("frame_index", "track_index", "pixels"):
        np.testing.assert_array_equal(getattr(again, name), getattr(reference, name))


def test_no_frame_and_frames_smaller_than_the_window_have_no_tracks() -> None:
    assert FeatureTracks([]).num_frames == 0
    tiny = FeatureTracks([np.eye(9, dtype=np.uint8) * 255] * 2, SETTINGS)
    assert (tiny.num_frames, len(tiny.pixels)) == (2, 0)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("columns", 0),
        ("columns", 1.5),
        ("per_cell", 2.0),
        ("window_px", 20),
        ("window_px", 21.0),
        ("levels", -1),
        ("levels", 1.5),
        ("forward_backward_px", 0.0),
        ("quality", 1.0),
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(InvalidArgument, match=f"^{name} = {value}: must (be|lie)"):
        KltSettings(**{name: value})


def test_unknown_corners_are_refused_by_name() -> None:
    with pytest.raises(InvalidArgument, match=r"^corners = 'fast': must be one of shi-tomasi, harris"):
        KltSettings(corners="fast")


def test_frames_of_another_kind_or_size_are_refused() -> None:
    with pytest.raises(InvalidArgument, match=r"frames\[0\] is float64"):
        FeatureTracks([np.zeros((20, 30))])
    with pytest.raises(InvalidArgument, match=r"frames\[1\] has shape \(20, 31\)"):
        FeatureTracks([np.zeros((20, 30), np.uint8), np.zeros((20, 31), np.uint8)])
    with pytest.raises(InvalidArgument, match=r"frames\[0\] has shape \(0, 30\): must have pixels"):
        FeatureTracks([np.zeros((0, 30), np.uint8)])


def test_nothing_is_followed_where_the_mask_is_black() -> None:
    mask = np.ones((HEIGHT, WIDTH), bool)
    mask[120:, 40:] = False
    views = list(follow_features(moved((6.0, 5.0), 5), SETTINGS, mask))
    for view in views:
        columns, rows = np.rint(view.pixels).astype(int).T
        assert mask[rows, columns].all()
    # Corners that are not masked are followed as without a mask.
    assert len(np.intersect1d(views[0].tracks, views[-1].tracks)) > 20
    with pytest.raises(
        InvalidArgument, match=r"mask has shape \(20, 30\): must be \(200, 320\) as frames\[0\]"
    ):
        list(follow_features(moved((0, 0), 1), SETTINGS, np.ones((20, 30))))


def test_a_camera_may_give_each_image_in_the_same_array() -> None:
    images = moved((2.7, 1.15), 4)
    buffer = np.empty_like(images[0])

    def from_camera() -> Iterator[np.ndarray]:
        for image in images:
            buffer[:] = image
            yield buffer

    found, reference = FeatureTracks(from_camera(), SETTINGS), FeatureTracks(images, SETTINGS)
    np.testing.assert_array_equal(found.pixels, reference.pixels)
