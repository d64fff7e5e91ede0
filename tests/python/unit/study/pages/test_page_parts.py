"""Charts and pictures of pages show their numbers."""

from __future__ import annotations

import io
import re

import numpy as np
import pytest
from matplotlib.image import imread

from sfmcpp.study.pages.charts import arrows, bars, histogram, match_matrix, nice_ticks, top_view
from sfmcpp.study.pages.parts import data_uri, png_bytes
from sfmcpp.study.sfm_measures import ResidualMap

HEIGHT = re.compile(r'<rect class="bar[^>]* height="([\d.]+)"')


@pytest.mark.parametrize("channels", [3, 4])
def test_a_png_holds_its_pixels(channels: int) -> None:
    pixels = np.random.default_rng(0).integers(0, 256, (7, 5, channels), dtype=np.uint8)
    read = np.round(255 * imread(io.BytesIO(png_bytes(pixels)), format="png")).astype(np.uint8)
    np.testing.assert_array_equal(read, pixels)
    assert data_uri("image/png", b"abc") == "data:image/png;base64,YWJj"


@pytest.mark.parametrize("highest", [3e-16, 1e-7, 0.3, 0.999, 1.0, 7.2, 4_000, 123_456.0])
def test_ticks_are_round_and_reach_the_highest(highest: float) -> None:
    ticks = nice_ticks(highest)
    assert ticks[0] == 0
    assert ticks[-1] >= highest * (1 - 1e-9)
    assert ticks[-1] <= 1.5 * highest * (1 + 1e-9)
    np.testing.assert_allclose(np.diff(ticks), ticks[1], rtol=1e-6)
    assert nice_ticks(0.0) == nice_ticks(float("nan")) == [0.0, 1.0]


def test_bars_are_as_high_as_their_values_and_none_is_left_out() -> None:
    text = bars([1.0, None, 4.0, 2.0], ["a", "b", "<c>", "d"], x_label="x", y_label="y")
    heights = np.array([float(height) for height in HEIGHT.findall(text)])
    np.testing.assert_allclose(heights / heights.max(), [0.25, 1.0, 0.5], atol=1e-3)
    assert "<title>&lt;c&gt;</title>" in text


def test_a_histogram_counts_all_values_those_far_out_in_its_last_bar() -> None:
    values = np.array([0.1, 0.1, 0.6, 1.4, 99.0, 1.6])
    text = histogram(values, np.array([0, 0.5, 1, 1.5, 2]), x_label="x", y_label="y")
    counts = [int(count) for count in re.findall(r"<title>[^:]*: ([\d,]+)</title>", text)]
    assert counts == [2, 1, 1, 2]


def test_an_arrow_points_where_the_residual_does_and_as_far_as_the_scale_says() -> None:
    means = np.full((2, 3, 2), np.nan)
    means[0, 0], means[1, 2] = (0.2, 0.0), (0.0, -0.1)
    text, scale = arrows(ResidualMap((300, 200), means, np.array([[9, 0, 0], [0, 0, 8]])))
    cell = 480 / 3
    lines = re.findall(r'd="M([\d.]+) ([\d.]+)L([\d.]+) ([\d.]+)M', text)
    moved = np.array(lines, dtype=float).reshape(-1, 2, 2)
    np.testing.assert_allclose(np.diff(moved, axis=1)[:, 0] * scale / cell, [[0.2, 0], [0, -0.1]], atol=1e-3)


def test_from_above_higher_points_cover_lower_ones_and_cameras_are_dots() -> None:
    low, high = (10, 200, 10), (200, 10, 10)
    points = np.array([[0, 0, 0], [0, 0, 5], [-1, -1, 0], [1, 1, 0]], dtype=float)
    colors = np.array([low, high, low, low], dtype=np.uint8)
    picture = top_view(points, colors, np.array([[0.5, -0.5, 2.0]]), (200, 200))
    assert tuple(picture[100, 100]) == (*high, 255)
    row, column = np.argwhere((picture == (213, 94, 0, 255)).all(axis=2)).mean(axis=0)
    assert row > 100  # y is up in the picture
    assert column > 100
    assert picture[0, 0, 3] == 0


def test_a_model_is_seen_from_above_to_its_edges() -> None:
    """Its middle is not its median, and a few points lie far off."""
    rng = np.random.default_rng(0)
    crowd, rest = rng.normal(0, 0.1, (900, 3)), rng.uniform([0, -10, 0], [1, 0, 1], (100, 3))
    points = np.concatenate([crowd, rest])
    low = (points[:, 1] < np.quantile(points[:, 1], 0.03)) & (points[:, 1] > np.quantile(points[:, 1], 0.012))
    colors = np.where(low[:, None], np.array([250, 0, 0]), 90).astype(np.uint8)
    points[0] = [0, -1000, 0]
    picture = top_view(points, colors, np.array([[0.0, 1.0, 5.0]]), (200, 400))
    shown = (picture == (250, 0, 0, 255)).all(axis=2)
    assert np.count_nonzero(shown) >= 3 * np.count_nonzero(low)  # each is four pixels, where none hides it
    assert picture[:60].any()  # the camera, uppermost


def test_nothing_is_cut_at_the_edges_of_the_picture_from_above() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(0, 1, (3000, 3))
    points[:6] = rng.uniform(100, 200, (6, 3))  # far off
    picture = top_view(points, np.full((3000, 3), 90, np.uint8), np.zeros((1, 3)), (200, 200))
    assert not picture[:8].any()
    assert not picture[-8:].any()
    assert not picture[:, :8].any()
    assert not picture[:, -8:].any()
    rows, columns = picture[:, :, 3].nonzero()
    assert np.ptp(rows) > 120
    assert np.ptp(columns) > 120


def test_the_matrix_is_symmetric_and_darker_where_more_agrees() -> None:
    first, second = np.array([0, 0, 1]), np.array([1, 2, 2])
    picture = match_matrix(3, first, second, np.array([100, 10, 0]))[80::160, 80::160].astype(int)
    np.testing.assert_array_equal(picture, picture.transpose(1, 0, 2))
    assert picture[0, 1, :3].sum() < picture[0, 2, :3].sum()
    assert tuple(picture[1, 2]) == (128, 128, 128, 40)


def test_the_matrix_of_many_images_keeps_every_match() -> None:
    count = 1700
    first = np.array([0, 1699])[:1]
    picture = match_matrix(count, first, np.array([1699]), np.array([30]))
    assert max(picture.shape[:2]) <= 500
    assert picture[0, -1, 3] == picture[-1, 0, 3] == 255
    assert match_matrix(0, *[np.empty(0, dtype=int)] * 3).size > 0
