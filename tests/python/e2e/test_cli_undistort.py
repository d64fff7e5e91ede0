"""`sfmcpp undistort`: photos and model for programs that know no lens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import is_one_error_line, run_here
from sfmcpp.sources.synthetic.photos import render_photos

pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")
pytest.importorskip("PIL.Image", reason="Pillow is not installed: pip install 'sfmcpp[vision]'")


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with photos of a lens that distorts, and their model."""
    folder = tmp_path_factory.mktemp("rendered")
    lens = {"image_size": (160, 120), "distortion": (-0.2, 0.02)}
    truth = render_photos("courtyard", folder / "photos", num_images=3, **lens)
    sfmcpp.write(truth, folder / "model", format="colmap-text")
    return folder


def test_images_and_model_are_written_and_told(rendered: Path, tmp_path: Path) -> None:
    result = run_here("undistort", rendered / "model", rendered / "photos", "-o", tmp_path / "flat")
    assert (result.returncode, result.stderr) == (0, "")
    made = sfmcpp.read(tmp_path / "flat/sparse/0")
    width, height = np.asarray(made.metadata.image_sizes)[0]
    assert f"3 images of {width}×{height} px without distortion" in result.stdout
    names = sorted(path.name for path in (tmp_path / "flat/images").iterdir())
    assert names == sorted(made.metadata.image_names)


def test_a_folder_without_the_photos_is_refused_and_nothing_is_left(rendered: Path, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    out = tmp_path / "out"
    result = run_here("undistort", rendered / "model", tmp_path / "empty", "-o", out)
    assert result.returncode == 2
    assert is_one_error_line(result)
    assert not out.exists()
