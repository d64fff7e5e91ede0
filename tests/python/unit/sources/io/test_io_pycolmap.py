"""The models we write, as COLMAP's own library reads them, and those it writes, as we read them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from io_helpers import assert_same_problem, residuals
from sfmcpp import Problem
from sfmcpp.sources.io import read, write

pycolmap = pytest.importorskip("pycolmap")
pytestmark = pytest.mark.real

FORMATS = ["colmap-text", "colmap-binary"]
SOURCES = ["kitti_vo/Balbianello.out", "sba_demo/9camsvarK.txt", "sba_demo/9cams.txt"]


def colmap_residuals(model: Any) -> dict[tuple[int, int], np.ndarray]:
    """Projection minus keypoint by image and point, all computed by COLMAP."""
    result = {}
    for image_id, image in model.images.items():
        for keypoint in image.points2D:
            if keypoint.has_point3D():
                projected = image.project_point(model.points3D[keypoint.point3D_id].xyz)
                result[image_id, keypoint.point3D_id] = projected - keypoint.xy
    return result


def assert_colmap_agrees(model: Any, problem: Problem) -> None:
    """Compare residuals, matched by the identifiers that files get where the metadata has none."""
    theirs, ours = colmap_residuals(model), residuals(problem)
    image_ids = problem.metadata.extra.get("colmap_image_ids", np.arange(1, problem.num_cameras + 1))
    point_ids = problem.metadata.extra.get("colmap_point_ids", np.arange(1, problem.num_points + 1))
    keys = zip(image_ids[problem.camera_index].tolist(), point_ids[problem.point_index].tolist(), strict=True)
    assert len(theirs) == problem.num_observations
    np.testing.assert_allclose([theirs[key] for key in keys], ours, rtol=0, atol=1e-8)


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("source", SOURCES)
def test_colmap_computes_the_same_residuals_from_our_files(
    data_dir: Path, tmp_path: Path, source: str, format: str
) -> None:
    problem = read(data_dir / source)
    write(problem, tmp_path / "model", format=format)
    model = pycolmap.Reconstruction(str(tmp_path / "model"))
    assert (model.num_images(), model.num_points3D()) == (problem.num_cameras, problem.num_points)
    assert_colmap_agrees(model, problem)


@pytest.mark.parametrize("format", FORMATS)
@pytest.mark.parametrize("source", SOURCES[:2])
def test_files_written_by_colmap_are_read_as_it_reads_them(
    data_dir: Path, tmp_path: Path, source: str, format: str
) -> None:
    write(read(data_dir / source), tmp_path / "ours")
    model = pycolmap.Reconstruction(str(tmp_path / "ours"))
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    (model.write_text if format == "colmap-text" else model.write_binary)(str(theirs))
    again = read(theirs)
    assert again.metadata.source_format == format
    assert_colmap_agrees(model, again)


def test_shared_intrinsics_stay_shared_in_colmap(data_dir: Path, tmp_path: Path) -> None:
    problem = read(data_dir / SOURCES[2])
    write(problem, tmp_path / "model")
    model = pycolmap.Reconstruction(str(tmp_path / "model"))
    assert model.num_cameras() == 1
    again = read(tmp_path / "model")
    assert again.intrinsics.shape[0] == 1
    np.testing.assert_array_equal(again.intrinsics_index, 0)
    write(again, tmp_path / "again")
    assert_same_problem(read(tmp_path / "again"), again, intrinsics_rtol=4e-16)
