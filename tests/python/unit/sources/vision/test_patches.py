"""Patches of photos: sampled at the right level, aligned from Python, and shapes that are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp import _core
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.photos import Photo
from sfmcpp.sources.vision.patches import align_patches, grey_pyramid, pyramid_of, sample_patches
from textured_photos import blobs, texture, write_photo

for extra in ("cv2", "PIL"):
    pytest.importorskip(extra, reason=f"{extra} is not installed: pip install 'sfmcpp[vision]'")

SCENE = texture(200, 260, seed=3)[:, :, 0]
AHEAD = np.eye(2)[None]


def test_levels_halve_and_keep_every_place(tmp_path: Path) -> None:
    centre = np.array([[70.3, 52.6]])
    path = write_photo(tmp_path / "blob.png", blobs(128, 160, centre, sigma=9.0))
    pyramid = grey_pyramid(Photo("blob.png", path, (160, 128)))
    assert [level.shape for level in pyramid] == [(128, 160), (64, 80), (32, 40)]
    for size in (1.0, 2.0, 4.0):
        (samples,) = sample_patches(pyramid, centre, size * AHEAD, 5).astype(np.float64)
        weight = samples - samples.min()
        y, x = np.mgrid[-5:6, -5:6] * size
        assert abs((x * weight).sum() / weight.sum()) < 0.1
        assert abs((y * weight).sum() / weight.sum()) < 0.1


def test_patches_beyond_the_border_or_nowhere_are_not_a_number() -> None:
    pixels = np.array([[100.0, 100.0], [4.0, 100.0], [np.nan, 100.0], [100.0, 100.0]])
    steps = np.repeat(AHEAD, 4, axis=0)
    steps[3] = np.nan
    samples = sample_patches(pyramid_of(SCENE), pixels, steps, 5)
    assert samples.shape == (4, 11, 11)
    assert np.isfinite(samples[0]).all()
    assert np.isnan(samples[1:]).all()
    found = align_patches(pyramid_of(SCENE), samples, np.arange(4), np.repeat(pixels[:1], 4, axis=0), steps)
    assert found.correlations[0] > 0.999
    assert (found.correlations[1:] == -1).all()


def test_shifted_copies_are_found_where_they_are() -> None:
    pixels = np.random.default_rng(0).uniform([20, 20], [230, 170], (200, 2))
    steps = np.repeat(AHEAD, 200, axis=0)
    templates = sample_patches(pyramid_of(SCENE), pixels, steps, 8)
    shifted = pyramid_of(SCENE[2:, 1:] // 2 + 40)
    start = pixels - [1.0, 2.0] + np.random.default_rng(1).uniform(-0.7, 0.7, (200, 2))
    found = align_patches(shifted, templates, np.arange(200), start, steps)
    assert np.median(found.correlations) > 0.99
    errors = np.linalg.norm(found.pixels - (pixels - [1.0, 2.0]), axis=1)
    assert np.mean(errors < 0.05) > 0.95
    other = align_patches(shifted, templates, np.arange(200)[::-1], start[::-1], steps)
    np.testing.assert_array_equal(other.pixels[::-1], found.pixels)


def test_arrays_of_wrong_shapes_are_refused() -> None:
    pyramid, one = pyramid_of(SCENE), np.full((1, 2), 50.0)
    templates, number = np.zeros((1, 9, 9), dtype=np.float32), np.zeros(1, dtype=np.int32)
    for call, name in (
        (lambda: _core.sample_patches(pyramid, np.zeros((1, 3)), AHEAD, number, 3), "centres"),
        (lambda: _core.sample_patches(pyramid, one, AHEAD[0], number, 3), "steps"),
        (lambda: _core.sample_patches(pyramid, one, AHEAD, number + 9, 3), "level"),
        (lambda: _core.sample_patches(pyramid, one, AHEAD, number, 0), "radius"),
        (lambda: _core.sample_patches([pyramid[0][:1]], one, AHEAD, number, 3), "levels"),
        (lambda: _core.align_patches(pyramid, templates[0], number, one, AHEAD, number), "templates"),
        (lambda: _core.align_patches(pyramid, templates[:, :8, :8], number, one, AHEAD, number), "templates"),
        (lambda: _core.align_patches(pyramid, templates[:, :8], number, one, AHEAD, number), "templates"),
        (lambda: _core.align_patches(pyramid, templates, number + 1, one, AHEAD, number), "which"),
        (lambda: _core.align_patches(pyramid, templates, number - 1, one, AHEAD, number), "which"),
    ):
        with pytest.raises(InvalidArgument, match=name):
            call()
