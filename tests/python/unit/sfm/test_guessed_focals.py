"""Focal lengths that pairs of images tell, wherever their pixels are counted from."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp.sfm.run as sfm_run
from cloud_views import FOCAL_PX, views_of_cloud
from sfmcpp.geometry import focal_from_pairs
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.image_tracks import ImageTracks, image_tracks
from sfmcpp.sfm import reconstruct

SIZE = np.array([1000, 750])
NOISE_PX = 0.5


def tracks_from(origin: FloatArray) -> ImageTracks:
    """What five cameras at different distances see of a cloud, their pixels counted from `origin` [px]."""
    image, track, pixels = views_of_cloud(SIZE, NOISE_PX)
    centred = bool((origin == SIZE / 2).all())
    return image_tracks(image, track, pixels - origin, sizes=[SIZE] * 5, centred=centred)


@pytest.mark.parametrize("share_of_size", [0.0, 0.5])
def test_a_guess_does_not_depend_on_where_pixels_are_counted_from(
    share_of_size: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    guesses: list[float | None] = []

    def noted(*arguments: object, **options: object) -> float | None:
        guesses.append(focal_from_pairs(*arguments, **options))  # type: ignore[arg-type]
        return guesses[-1]

    monkeypatch.setattr(sfm_run, "focal_from_pairs", noted)
    found = reconstruct(tracks_from(share_of_size * SIZE), shared_camera="one")
    assert found.num_registered == 5
    assert guesses == [pytest.approx(FOCAL_PX, rel=0.02)]


def test_of_many_pairs_the_pixels_of_those_with_most_matches_are_collected(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told: list[int] = []

    def noted(pairs: list[tuple[FloatArray, FloatArray]], *_: object, **__: object) -> None:
        told.extend(len(first) for first, _ in pairs)

    monkeypatch.setattr(sfm_run, "focal_from_pairs", noted)
    monkeypatch.setattr(sfm_run, "MOST_PAIRS", 3)
    found = reconstruct(tracks_from(np.zeros(2)), shared_camera="one")
    general = [len(pair.verified) for pair in found.graph.pairs if pair.geometry.kind == "general"]
    assert told == sorted(general, reverse=True)[:3]


@pytest.mark.parametrize(("count", "is_told"), [(2, True), (3, True), (4, False)])
def test_a_focal_length_that_few_images_tell_is_warned_of(count: int, is_told: bool) -> None:
    image, track, pixels = views_of_cloud(SIZE, NOISE_PX)
    few = image < count
    run = reconstruct(image_tracks(image[few], track[few], pixels[few], sizes=[SIZE] * count, centred=False))
    assert run.num_registered == count
    focal_px = run.models[0].intrinsics[0, 0]
    told = f"one camera is only what pairs of images tell, first {focal_px:.0f} px: too few images to adjust"
    assert any(told in warning for warning in run.warnings) == is_told
