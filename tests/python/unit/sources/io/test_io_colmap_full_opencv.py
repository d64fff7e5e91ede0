"""COLMAP's FULL_OPENCV: the perspective model holds it while its radial factor is no fraction."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp import residuals
from sfmcpp.errors import DatasetError
from sfmcpp.sources.io import read, write

pycolmap = pytest.importorskip("pycolmap")

LENS = [700.0, 710.0, 320.0, 240.0, -0.11, 0.03, 0.001, -0.002, 0.004, 0.0, 0.0, 0.0]


def model_of_colmap() -> pycolmap.Reconstruction:
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, 4
    options.num_points3D = 40
    options.camera_model_id = pycolmap.Camera(model="FULL_OPENCV", width=640, height=480, params=LENS).model
    options.camera_params, options.camera_width, options.camera_height = LENS, 640, 480
    return pycolmap.synthesize_dataset(options)


@pytest.mark.parametrize("format", ["colmap-text", "colmap-binary"])
def test_a_lens_without_a_divisor_is_read_and_written(tmp_path: Path, format: str) -> None:
    save = "write_text" if format == "colmap-text" else "write_binary"
    getattr(model_of_colmap(), save)(str(tmp_path))
    problem = read(tmp_path)
    assert np.abs(residuals(problem)).max() < 1e-6
    held = zip(problem.intrinsic_names, problem.fixed_intrinsics[0], strict=True)
    assert {name for name, fixed in held if not fixed} == {"f", "aspect", "k1", "k2", "k3", "p1", "p2"}
    write(problem, tmp_path / "again", format=format)
    (again,) = pycolmap.Reconstruction(str(tmp_path / "again")).cameras.values()
    assert again.model.name == "FULL_OPENCV"
    np.testing.assert_allclose(again.params, LENS, rtol=1e-12)


@pytest.mark.parametrize("place", [9, 10, 11])
def test_a_lens_with_a_divisor_is_refused(tmp_path: Path, place: int) -> None:
    model = model_of_colmap()
    (camera,) = model.cameras.values()
    params = list(LENS)
    params[place] = 0.5
    camera.params = params
    model.write_binary(str(tmp_path))
    with pytest.raises(DatasetError, match=r"divides by 1 .*: k4, k5 and k6 must be 0; .*image_undistorter"):
        read(tmp_path)
