"""Images that differ by a zoom alone make a model of depths that mean nothing, and it is said."""

from __future__ import annotations

import re

import numpy as np
import pytest

from sfmcpp import sfm
from sfmcpp.geometry.so3 import rotation_from_angle_axis

pytest.importorskip("poselib", reason="PoseLib is not installed: pip install 'sfmcpp[vision]'")

SIZE = np.array([1200, 800])
FOCAL_PX, NOISE_PX = 1100.0, 0.3
AHEAD, SIDEWAYS = np.array([0.0, 0.0, 1.5]), np.array([1.5, 0.2, 0.3])
NO_TURN = np.zeros(3)


def scene(depth_m: float, slope: float = 0.0) -> np.ndarray:
    """Points (400, 3) in front of a camera, about five metres away."""
    rng = np.random.default_rng(0)
    rays = rng.uniform(-1, 1, (400, 2)) * SIZE / FOCAL_PX / 3
    depth = (5.0 + rng.uniform(-depth_m, depth_m, 400)) / (1 - slope * rays[:, 0])
    return np.column_stack([rays, np.ones(400)]) * depth[:, None]


def seen(points: np.ndarray, turn_deg: np.ndarray, centre: np.ndarray, zoom: float, seed: int) -> np.ndarray:
    turned = (points - centre) @ rotation_from_angle_axis(np.radians([turn_deg]))[0]
    pixels = FOCAL_PX * zoom * turned[:, :2] / turned[:, 2:] + SIZE / 2
    return np.asarray(pixels + np.random.default_rng(seed).normal(scale=NOISE_PX, size=pixels.shape))


def warnings_of(views: list[np.ndarray]) -> list[str]:
    """Of the model of images that show the same points."""
    count = len(views)
    inside = np.all([(view > 0).all(axis=1) & (view < SIZE).all(axis=1) for view in views], axis=0)
    same = np.repeat(np.arange(np.count_nonzero(inside))[:, None], 2, axis=1)
    matches = {(i, j): same for j in range(count) for i in range(j)}
    keypoints = [view[inside] for view in views]
    run = sfm.reconstruct(sfm.match_graph_of_arrays(keypoints, matches, [SIZE] * count, list("abc")[:count]))
    assert run.num_registered == count
    return [told for told in run.warnings if "zoom" in told]


@pytest.mark.parametrize("turn_deg", [NO_TURN, np.array([3.0, -5.0, 20.0])], ids=["straight", "turned"])
@pytest.mark.parametrize(("zoom", "larger"), [(1.4, "b.*a"), (0.6, "a.*b")])
def test_a_zoom_is_named(turn_deg: np.ndarray, zoom: float, larger: str) -> None:
    points = scene(2.0)
    views = [seen(points, NO_TURN, NO_TURN, 1.0, 1), seen(points, turn_deg, NO_TURN, zoom, 2)]
    (told,) = warnings_of(views)
    assert re.match(larger, told)
    factor = re.search(r"\((\S+) times\)", told)
    assert factor is not None
    assert float(factor[1]) == pytest.approx(max(zoom, 1 / zoom), rel=0.02)


def test_all_images_of_a_zoom_lens_on_one_place_are_told_once() -> None:
    points = scene(2.0)
    views = [seen(points, NO_TURN, NO_TURN, zoom, seed) for seed, zoom in enumerate((1.0, 1.3, 1.7))]
    (told,) = warnings_of(views)
    assert "c shows what a shows" in told
    assert "(1.70 times)" in told


def test_a_flat_scene_that_comes_nearer_straight_on_looks_the_same() -> None:
    points = scene(0.0)
    views = [seen(points, NO_TURN, NO_TURN, 1.0, 1), seen(points, NO_TURN, AHEAD, 1.0, 2)]
    assert "of a flat scene that the camera came nearer to" in warnings_of(views)[0]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("centre", [AHEAD, SIDEWAYS], ids=["ahead", "sideways"])
@pytest.mark.parametrize(("depth_m", "slope"), [(1.0, 0.0), (0.0, 0.8)], ids=["deep", "slanted"])
def test_cameras_that_moved_are_not_doubted(
    centre: np.ndarray, depth_m: float, slope: float, seed: int
) -> None:
    points = scene(depth_m, slope)
    turned = np.array([1.0, -8.0, 2.0]) if centre is SIDEWAYS else NO_TURN
    views = [seen(points, NO_TURN, NO_TURN, 1.0, seed), seen(points, turned, centre, 1.0, seed + 10)]
    assert warnings_of(views) == []
