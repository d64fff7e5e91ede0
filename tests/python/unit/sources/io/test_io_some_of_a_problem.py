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


def keypoints_of(model: Path) -> dict[str, list[list[float]]]:
    pycolmap = pytest.importorskip("pycolmap")
    images = pycolmap.Reconstruction(str(model)).images.values()
    return {image.name: [point.xy.tolist() for point in image.points2D] for image in images}


@pytest.mark.parametrize("format", ["colmap-binary", "colmap-text"])
def test_a_camera_that_is_left_out_is_no_image_of_the_model(tmp_path: Path, format: str) -> None:
    problem, before = colmap_scene(tmp_path), keypoints_of(tmp_path / "model")
    sfmcpp.write(problem.with_cameras([0, 1, 3]), tmp_path / "fewer", format=format)
    gone = problem.metadata.image_names[2]
    assert keypoints_of(tmp_path / "fewer") == {name: xy for name, xy in before.items() if name != gone}


@pytest.mark.parametrize("format", ["colmap-binary", "colmap-text"])
def test_marks_of_new_points_are_further_keypoints(tmp_path: Path, format: str) -> None:
    problem, before = colmap_scene(tmp_path), keypoints_of(tmp_path / "model")
    marks = np.arange(6.0).reshape(3, 2)
    more = problem.with_added_points(np.eye(3)[:2], [1, 3, 1], [0, 0, 1], marks)
    sfmcpp.write(more, tmp_path / "more", format=format)
    names, expected = problem.metadata.image_names, dict(before)
    expected[names[1]] = [*before[names[1]], *marks[[0, 2]].tolist()]
    expected[names[3]] = [*before[names[3]], marks[1].tolist()]
    assert keypoints_of(tmp_path / "more") == expected
    again = sfmcpp.read(tmp_path / "more")
    assert again.num_points == problem.num_points + 2
    assert len(np.unique(again.metadata.extra["colmap_point_ids"])) == again.num_points


def test_shared_intrinsics_are_one_camera_of_the_images_as_they_were(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    problem, before = colmap_scene(tmp_path), keypoints_of(tmp_path / "model")
    problem.metadata.extra["colmap_camera_sizes"][:] = [2000, 1125]
    sfmcpp.write(problem.with_shared_intrinsics(), tmp_path / "shared")
    assert keypoints_of(tmp_path / "shared") == before
    (camera,) = pycolmap.Reconstruction(str(tmp_path / "shared")).cameras.values()
    assert (camera.width, camera.height) == (2000, 1125)


@pytest.mark.parametrize("suffix", [".out", ".nvm", ".g2o", ".npz"])
def test_other_formats_have_the_rows_of_new_points_and_of_fewer_cameras(tmp_path: Path, suffix: str) -> None:
    scene = sfmcpp.circle_scene(4, 30, camera_model="bal", seed=0)
    scene.intrinsics[:, 1:] = 0
    sfmcpp.write(scene, tmp_path / f"first{suffix}")
    problem = sfmcpp.read(tmp_path / f"first{suffix}")
    changed = problem.with_added_points([[0, 0, 1]], [1, 3], [0, 0], [[1, 2], [3, 4]]).with_cameras([0, 1, 3])
    sfmcpp.write(changed, tmp_path / f"second{suffix}")
    again = sfmcpp.read(tmp_path / f"second{suffix}")
    assert (again.num_cameras, again.num_points) == (3, 31)
    assert again.num_observations == changed.num_observations
    assert sfmcpp.cost(again) == pytest.approx(sfmcpp.cost(changed), rel=1e-9)


@pytest.mark.parametrize("cameras", [[0, 1, 2, 3, 4, 5], [0, 2, 4, 6], [1, 2, 3]])
def test_rigs_are_written_without_the_cameras_that_are_left_out(tmp_path: Path, cameras: list[int]) -> None:
    whole = sfmcpp.rig_walk_scene(seed=0)
    sfmcpp.write(whole, tmp_path / "rig")
    problem = sfmcpp.read(tmp_path / "rig")
    sfmcpp.write(problem.with_cameras(cameras), tmp_path / "fewer")
    again = sfmcpp.read(tmp_path / "fewer")
    np.testing.assert_allclose(again.cameras, problem.cameras[cameras], atol=1e-9)
    assert again.metadata.image_names == [problem.metadata.image_names[k] for k in cameras]
