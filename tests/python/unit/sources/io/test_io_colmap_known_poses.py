"""COLMAP models of poses alone, as its manual has them where points are sought: points3D.txt is empty."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from sfmcpp import DatasetError

CAMERAS = "1 PINHOLE 640 480 500 500 320 240\n"
IMAGES = "1 1 0 0 0 0 0 0 1 a.jpg\n\n2 1 0 0 0 -1 0 0 1 b.jpg\n\n3 1 0 0 0 0 -2 0 1 c.jpg\n\n"


@pytest.fixture
def poses(tmp_path: Path) -> Path:
    for name, content in (("cameras", CAMERAS), ("images", IMAGES), ("points3D", "")):
        (tmp_path / f"{name}.txt").write_text(content)
    return tmp_path


def test_a_model_without_points_is_read(poses: Path) -> None:
    problem = sfmcpp.read(poses)
    assert (problem.num_cameras, problem.num_points, problem.num_observations) == (3, 0, 0)
    np.testing.assert_allclose(problem.centres, [[0, 0, 0], [1, 0, 0], [0, 2, 0]], atol=1e-15)


@pytest.mark.parametrize("name", ["cameras", "images"])
def test_other_empty_files_are_refused(poses: Path, name: str) -> None:
    (poses / f"{name}.txt").write_text("")
    with pytest.raises(DatasetError, match=rf"{name}\.txt: the file is empty"):
        sfmcpp.read(poses)


def test_keypoints_of_points_that_an_empty_file_lacks_are_named(poses: Path) -> None:
    (poses / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.jpg\n320 240 7\n")
    with pytest.raises(DatasetError, match=r"images\.txt:1: keypoint of point 7, which does not list it"):
        sfmcpp.read(poses)


def test_images_without_a_line_of_keypoints_are_told_what_is_missing(poses: Path) -> None:
    (poses / "images.txt").write_text(IMAGES.replace("\n\n", "\n"))
    told = r"images\.txt:2: must hold the keypoints of the image before, not an image: each takes two lines"
    with pytest.raises(DatasetError, match=told):
        sfmcpp.read(poses)
