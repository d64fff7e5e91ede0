"""What an image should show of a neighbour: no points whose depth nearly equal images leave open."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.sfm.contradictions import _ConfirmedFeatures, _num_missing_points, _View

SIZE, FOCAL_PX = np.array([400.0, 300.0]), 325.0
ROW = np.array([FOCAL_PX, 1.0, 200.0, 150.0, 0.0])


def view(centre: list[float], pixels: np.ndarray) -> _View:
    """A camera that looks along z."""
    rays = np.column_stack([(pixels - ROW[2:4]) / FOCAL_PX, np.ones(len(pixels))])
    return _View(np.column_stack([np.eye(3), centre]), pixels, rays, ROW, SIZE)


def sights(depths: np.ndarray, base: float) -> _ConfirmedFeatures:
    """All features, confirmed by image 2, so far from the first one."""
    count = len(depths)
    return _ConfirmedFeatures(
        np.arange(count, dtype=np.int32),
        np.full(count, 2, dtype=np.int32),
        depths,
        np.degrees(base / depths),
        np.full(count, base),
    )


def missing(depth: float, base: float) -> int:
    """Points that image 1, 0.7 to the right, should show: matched is what lies in the left two thirds."""
    x, y = np.meshgrid(np.arange(40.0, 360.0, 8.0), np.arange(30.0, 270.0, 8.0))
    pixels = np.column_stack([x.ravel(), y.ravel()])
    matched = np.flatnonzero(pixels[:, 0] < 250).astype(np.int32)
    one, other = view([0.0, 0.0, 0.0], pixels), view([0.7, 0.0, 0.0], pixels)
    return _num_missing_points(sights(np.full(len(pixels), depth), base), one, other, 1, matched)


@pytest.mark.parametrize("base", [0.5, 1.0])
def test_far_points_that_an_image_does_not_show_are_missing(base: float) -> None:
    assert missing(depth=300.0, base=base) > 100


def test_near_points_that_an_image_does_not_show_are_missing() -> None:
    assert missing(depth=20.0, base=1.0) > 100


def test_points_that_only_a_nearly_equal_photo_confirms_may_be_anywhere() -> None:
    """A burst: 2 mm apart, everything seems far away, and may as well be hidden in the next photo."""
    assert missing(depth=5.0, base=0.002) == 0
