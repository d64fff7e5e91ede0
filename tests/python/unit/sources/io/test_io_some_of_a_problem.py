"""Some of the observations, and some of the points, of a problem: their metadata go with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from sfmcpp import InvalidArgument, Problem


def colmap_scene(folder: Path) -> Problem:
    """A COLMAP model in which some keypoints see no point."""
    scene = sfmcpp.circle_scene(4, 30, camera_model="perspective", seed=0)
    kept = scene.with_observations(np.arange(scene.num_observations) % 5 != 0)
    loose = scene.with_observations(np.arange(scene.num_observations) % 5 == 0)
    counts = np.bincount(kept.camera_index, minlength=4)
    ranks = np.array(
        [np.count_nonzero(loose.camera_index[:i] == c) for i, c in enumerate(loose.camera_index)]
    )
    kept.metadata.extra |= {
        "colmap_loose_image": loose.camera_index,
        "colmap_loose_keypoint_index": counts[loose.camera_index] + ranks,
        "colmap_loose_pixels": loose.pixels,
    }
    sfmcpp.write(kept, folder / "model")
    return sfmcpp.read(folder / "model")


@pytest.mark.parametrize("format", ["colmap-binary", "colmap-text"])
def test_dropped_observations_stay_keypoints_of_colmaps_images(tmp_path: Path, format: str) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    problem = colmap_scene(tmp_path)
    chosen = np.arange(problem.num_observations) % 3 != 0
    sfmcpp.write(problem.with_observations(chosen), tmp_path / "fewer", format=format)
    before, after = (pycolmap.Reconstruction(str(tmp_path / name)) for name in ("model", "fewer"))
    assert after.compute_num_observations() == np.count_nonzero(chosen)
    for number, image in before.images.items():
        xy = [[point.xy.tolist() for point in i.points2D] for i in (image, after.images[number])]
        assert xy[0] == xy[1]
    again = sfmcpp.read(tmp_path / "fewer")
    np.testing.assert_array_equal(again.pixels, problem.pixels[chosen])


def test_some_points_keep_their_identifiers_and_colours(tmp_path: Path) -> None:
    problem = colmap_scene(tmp_path)
    problem.metadata.point_colors = np.arange(90, dtype=np.uint8).reshape(30, 3)
    chosen = np.array([7, 3, 20])
    fewer = problem.with_points(chosen)
    np.testing.assert_array_equal(fewer.points, problem.points[chosen])
    np.testing.assert_array_equal(fewer.metadata.point_colors, problem.metadata.point_colors[chosen])
    np.testing.assert_array_equal(
        fewer.metadata.extra["colmap_point_ids"], problem.metadata.extra["colmap_point_ids"][chosen]
    )
    rows = np.flatnonzero(np.isin(problem.point_index, chosen))
    np.testing.assert_array_equal(chosen[fewer.point_index], problem.point_index[rows])
    np.testing.assert_array_equal(fewer.pixels, problem.pixels[rows])
    sfmcpp.write(fewer, tmp_path / "fewer")
    assert sfmcpp.read(tmp_path / "fewer").num_points == 3


def test_a_point_is_chosen_once(tmp_path: Path) -> None:
    with pytest.raises(InvalidArgument, match="chosen: a point is named twice"):
        colmap_scene(tmp_path).with_points([1, 2, 1])
