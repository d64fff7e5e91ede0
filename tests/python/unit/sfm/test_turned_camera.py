"""A camera of unknown focal length that only turns gives a model whose depths mean nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sfmcpp
from sfm_scenes import SIZE, match_graph
from sfmcpp.geometry import so3
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sfm import MatchGraph, Pair, SfmRun, reconstruct
from sfmcpp.sfm.cameras import cameras_of
from sfmcpp.sfm.turned_cameras import with_turned_cameras
from sfmcpp.study import SfmReport

FOCAL_PX = 560.0


def wall(step: float, k1: float = 0.0) -> sfmcpp.Problem:
    """Three views, `step` apart, of a plane 10 away that they look straight at."""
    points = np.random.default_rng(3).uniform([-10, -6, 10], [14, 6, 10], (2000, 3))
    cameras = np.tile(np.eye(3, 4), (3, 1, 1))
    cameras[:, 0, 3] = step * np.arange(3)
    return seen_from(cameras, points, k1)


def panorama(baseline: float, k1: float = 0.0) -> sfmcpp.Problem:
    """Six views of points 3 to 9 away, turned by 10° each, from centres `baseline` apart."""
    points = np.random.default_rng(3).uniform([-9, -3, -1], [9, 3, 9], (4000, 3))
    points = points[(np.linalg.norm(points, axis=1) > 3) & (points[:, 2] > 0.5)]
    cameras = np.zeros((6, 3, 4))
    for k in range(6):
        cameras[k] = np.column_stack([so3.exp([0, np.radians(10 * k - 25), 0]), [baseline * k, 0, 0]])
    return seen_from(cameras, points, k1)


def seen_from(cameras: np.ndarray, points: np.ndarray, k1: float) -> sfmcpp.Problem:
    """Images by a lens with k1, as pixels of cameras that know nothing of it."""
    rows = []
    for k, camera in enumerate(cameras):
        seen = (points - camera[:, 3]) @ camera[:, :3]
        rays = seen[:, :2] / seen[:, 2:]
        squared = (rays**2).sum(axis=1)
        pixels = FOCAL_PX * rays * (1 + k1 * squared)[:, None] + np.divide(SIZE, 2)
        inside = (seen[:, 2] > 0) & (1 + 3 * k1 * squared > 0)
        inside &= (pixels > 0).all(axis=1) & (pixels < SIZE).all(axis=1)
        rows += [(k, p, *pixels[p]) for p in np.flatnonzero(inside)]
    table = np.array(rows)
    camera_index, point_index = table[:, :2].astype(np.int32).T
    intrinsics = np.tile([FOCAL_PX, 1.0, SIZE[0] / 2, SIZE[1] / 2, 0.0], (len(cameras), 1))
    return sfmcpp.Problem(
        "calibrated",
        cameras,
        intrinsics,
        points,
        camera_index,
        point_index,
        np.ascontiguousarray(table[:, 2:]),
    )


def run_of(baseline: float, k1: float = 0.0) -> SfmRun:
    return reconstruct(match_graph(panorama(baseline, k1), sigma_px=0.3, known=False))


@pytest.mark.parametrize("k1", [0.0, -0.05, -0.15, -0.3, 0.1])
def test_a_camera_of_unknown_focal_length_that_only_turned_gives_no_model(k1: float) -> None:
    turned = run_of(0.0, k1)
    assert turned.model is None
    assert (
        SfmReport(turned)
        .verdict()
        .endswith("; the camera only turned, or the photos are identical; move the camera between photos")
    )


@pytest.mark.parametrize("k1", [0.0, -0.15])
def test_one_that_moved_gives_one(k1: float) -> None:
    assert run_of(0.3, k1).num_registered == 6


@pytest.mark.parametrize("k1", [0.0, -0.15])
@pytest.mark.parametrize("step", [0.3, 2.0])
def test_one_that_moves_along_a_plane_is_not_taken_for_one_that_turned(step: float, k1: float) -> None:
    """Before a plane all pairs are homographies, too, but for what the lens bends."""
    graph = match_graph(wall(step, k1), sigma_px=0.3, known=False)
    kinds = {pair.geometry.kind for pair in graph.pairs}
    assert k1 or kinds == {"planar"}
    assert "rotation" not in kinds
    guessed = cameras_of(graph.photos)
    assert guessed.guessed.all()
    assert {pair.geometry.kind for pair in with_turned_cameras(graph, guessed).pairs} == kinds


def test_of_many_pairs_a_sample_tells_that_the_camera_moved(monkeypatch: pytest.MonkeyPatch) -> None:
    graph = match_graph(panorama(0.3), sigma_px=0.3, known=False)
    many = replace(graph, pairs=graph.pairs * (3000 // len(graph.pairs)))
    tried: list[Pair] = []

    def noted(graph: MatchGraph, pair: Pair, row: FloatArray) -> Pair:
        tried.append(pair)
        return pair

    monkeypatch.setattr("sfmcpp.sfm.turned_cameras._verified_again", noted)
    assert with_turned_cameras(many, cameras_of(graph.photos)).pairs == many.pairs
    assert len(tried) < 150  # of two lenses; a tenth of the pairs would be 600


def test_pairs_of_each_camera_are_found_in_one_go() -> None:
    graph = match_graph(panorama(0.3), sigma_px=0.3, known=False)
    of_image = np.array([0, 2, 0, 2, 2, 1])
    expected = {
        camera: [n for n, p in enumerate(graph.pairs) if of_image[p.first] == of_image[p.second] == camera]
        for camera in range(3)
    }
    found = graph.pairs_by_camera(of_image)
    assert {camera: found[camera] for camera in range(3)} == expected
