"""Images that share a guessed focal length by default are warned of where they were taken with several."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sfmcpp import circle_scene
from sfmcpp.ba import residuals_px
from sfmcpp.model.image_tracks import ImageTracks, image_tracks
from sfmcpp.sfm import SfmRun, reconstruct
from sfmcpp.sfm.differing_focals import _set_apart

SAYS = "seem to differ in focal length"


def tracks(zoom: list[float], seed: int) -> ImageTracks:
    """What cameras with zooms by turns see of a cloud."""
    problem = circle_scene(
        12, 250, radius_m=9.0, pixel_sigma_px=0.0, focal_px=700.0, camera_model="perspective", seed=seed
    )
    problem.intrinsics[:, 0] *= np.resize(zoom, 12)
    pixels = problem.pixels - residuals_px(problem)
    pixels += np.random.default_rng(seed).normal(0, 0.3, pixels.shape)
    inside = ((pixels > 0) & (pixels < [640, 480])).all(axis=1)
    image, point = problem.camera_index[inside], problem.point_index[inside]
    return image_tracks(image, point, pixels[inside], sizes=[np.array([640, 480])] * 12)


def warned(run: SfmRun) -> bool:
    return any(SAYS in warning for warning in run.warnings)


@pytest.mark.parametrize("seed", [11, 12])
def test_photos_of_several_zooms_that_share_a_focal_length_are_warned_of(seed: int) -> None:
    assert warned(reconstruct(tracks([1.0, 1.4, 0.8], seed)))


def test_a_quarter_of_a_set_that_is_zoomed_by_a_fifth_is_named() -> None:
    """All pairs agree with the model, which is bent."""
    said = "3 photos seem to differ in focal length from others"
    assert any(said in text for text in reconstruct(tracks([1.0, 1.0, 1.0, 1.2], 11)).warnings)


@pytest.mark.parametrize("seed", [11, 12])
def test_photos_of_one_focal_length_are_not(seed: int) -> None:
    assert not warned(reconstruct(tracks([1.0], seed)))


def test_photos_that_do_not_share_by_default_are_not() -> None:
    assert not warned(reconstruct(tracks([1.0, 1.4, 0.8], 11), shared_camera="each"))


@pytest.mark.parametrize("camera", ["auto", 700.0])
def test_a_few_photos_of_another_focal_length_are_named(camera: str | float) -> None:
    said = "2 photos seem to differ in focal length from others"
    warnings = reconstruct(tracks([1.0] * 5 + [1.6], 11), camera=camera).warnings
    assert any(said in text and "image_000005" in text and "image_000011" in text for text in warnings)


@pytest.mark.parametrize("seed", [11, 12])
def test_cameras_of_different_sizes_are_not_compared(seed: int) -> None:
    some = tracks([1.0, 1.4], seed)
    sizes = np.where(np.arange(12)[:, None] % 2, [[640, 480]], [[640, 482]])
    assert not warned(reconstruct(replace(some, sizes=sizes)))


@pytest.mark.parametrize(
    ("shares", "sigma", "expected"),
    [
        ([1.0, 0.99, 1.23, 0.98, 1.2, 1.0, 1.21], 0.007, [2, 4, 6]),
        ([1.0, 0.8, 1.01, 0.99, 0.81], 0.007, [1, 4]),
        ([1.0, 0.99, 1.01, 1.23], 0.007, []),  # a single one may be a lens that breathes
        ([1.0, 0.99, 1.23, 1.2, 1.01], 0.05, []),
        ([0.97, 1.0, 1.04, 1.08, 1.12, 1.16], 0.007, []),  # a flight
        ([1.0], 0.007, []),
    ],
)
def test_several_of_another_focal_length_are_set_apart(
    shares: list[float], sigma: float, expected: list[int]
) -> None:
    found = _set_apart(np.log(shares), np.full(len(shares), sigma))
    assert np.flatnonzero(found).tolist() == expected
