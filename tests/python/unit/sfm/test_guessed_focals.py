"""Focal lengths that pairs of images tell, wherever their pixels are counted from."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp.sfm.run as sfm_run
from sfmcpp.geometry import focal_from_pairs, so3
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.image_tracks import ImageTracks, image_tracks
from sfmcpp.sfm import reconstruct

SIZE = np.array([1000, 750])
FOCAL_PX, NOISE_PX = 900.0, 0.5


def tracks_from(origin: FloatArray) -> ImageTracks:
    """What five cameras at different distances see of a cloud, their pixels counted from `origin` [px]."""
    rng = np.random.default_rng(1)
    points = rng.uniform(-2, 2, (250, 3))
    pixels = []
    for k in range(5):
        about = so3.exp(np.array([0.1 * rng.standard_normal(), 0.26 * (k - 2), 0.1 * rng.standard_normal()]))
        seen = points @ about.T + [*rng.uniform(-0.5, 0.5, 2), 7 * (1 + 0.25 * rng.uniform(-1, 1))]
        pixels.append(FOCAL_PX * seen[:, :2] / seen[:, 2:] + SIZE / 2)
    noisy = np.array(pixels) + NOISE_PX * rng.standard_normal((5, 250, 2))
    image, track = np.nonzero(((noisy > 0) & (noisy < SIZE)).all(axis=2))
    centred = bool((origin == SIZE / 2).all())
    return image_tracks(image, track, noisy[image, track] - origin, sizes=[SIZE] * 5, centred=centred)


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
