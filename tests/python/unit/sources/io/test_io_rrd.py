"""Recordings for rerun: what its own reader finds in them, and without its library."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import sfmcpp
from sfmcpp import DatasetError
from sfmcpp.sources.io.conversion_notes import changed_on_writing

Components = dict[str, NDArray[np.float64]]


def recorded(path: Path) -> dict[str, Components]:
    """Numbers of each entity by component, as the library reads them."""
    chunk = pytest.importorskip("rerun.chunk", reason="rerun-sdk is not installed, or has no reader")
    found: dict[str, Components] = {}
    for part in chunk.RrdReader(path).stream():
        columns = part.to_record_batch().to_pydict()
        found[part.entity_path] = {
            name: np.array(values[0], dtype=np.float64)
            for name, values in columns.items()
            if not name.startswith("rerun.")
        }
    return found


def test_what_rerun_reads_are_the_cameras_and_points(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed (the extra rerun)")
    problem = sfmcpp.circle_scene(3, 4, camera_model="perspective", seed=1)
    problem.metadata.image_names = ["a b.jpg", "left/1.png", "c"]
    problem.metadata.image_sizes = np.tile([640, 480], (3, 1))
    path = tmp_path / "scene.rrd"
    sfmcpp.write(problem, path)
    found = recorded(path)
    assert len(found) == 1 + 2 * 3
    points = found["/world/points"]["Points3D:positions"]
    np.testing.assert_allclose(points, problem.points, rtol=1e-6)
    for i, name in enumerate(("a\\ b.jpg", "left\\/1.png", "c")):
        camera, rotation = found[f"/world/cameras/{name}"], problem.rotations[i]
        np.testing.assert_allclose(camera["Transform3D:mat3x3"], [rotation.T.ravel()], atol=1e-6)
        np.testing.assert_allclose(camera["Transform3D:translation"], [problem.centres[i]], rtol=1e-6)
        f, aspect, cx, cy = problem.intrinsics[problem.intrinsics_index[i], :4]
        wanted = np.array([[f, 0, cx], [0, aspect * f, cy], [0, 0, 1]])
        np.testing.assert_allclose(camera["Pinhole:image_from_camera"], [wanted.T.ravel()], rtol=1e-6)
        np.testing.assert_array_equal(camera["Pinhole:resolution"], [[640, 480]])
        pixels = found[f"/world/cameras/{name}/pixels"]["Points2D:positions"]
        np.testing.assert_allclose(pixels, problem.pixels[problem.camera_index == i], rtol=1e-6)


def test_a_world_far_from_zero_keeps_its_shape(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="rerun-sdk is not installed (the extra rerun)")
    near = sfmcpp.circle_scene(3, 4, camera_model="perspective", seed=1)
    far, place = near.copy(), np.array([4_370_123.4, 497_987.6, 4_604_321.0])  # metres from the geocentre
    far.points += place
    far.cameras[:, :, 3] += place
    sfmcpp.write(far, tmp_path / "far.rrd")
    found = recorded(tmp_path / "far.rrd")
    origin = found["/world"]["origin"]
    np.testing.assert_allclose(found["/world/points"]["Points3D:positions"] + origin, far.points, atol=1e-5)
    for i in range(3):
        centre = found[f"/world/cameras/image_{i + 1:06d}"]["Transform3D:translation"][0]
        np.testing.assert_allclose(centre + origin, far.centres[i], atol=1e-5)
    format = next(known for known in sfmcpp.formats() if known.name == "rerun")
    (told,) = changed_on_writing(far, tmp_path / "far.rrd", format)
    assert told.startswith(f"the world begins at {origin[0]:.10g}, ")
    assert not list(changed_on_writing(near, tmp_path / "near.rrd", format))


def test_without_its_library_the_command_that_installs_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(DatasetError, match=r"recordings need rerun: pip install 'sfmcpp\[rerun\]'"):
        sfmcpp.write(sfmcpp.circle_scene(3, 4), tmp_path / "scene.rrd")
    assert not (tmp_path / "scene.rrd").exists()
