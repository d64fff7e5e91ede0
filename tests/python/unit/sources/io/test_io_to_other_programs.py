"""A scene is written for OpenMVG, AliceVision, VisualSFM and g2o, and is the same when it is read again."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import sfmcpp
from io_helpers import assert_same_problem
from other_programs import (
    CENTRE,
    FILES,
    FIRST,
    FOCAL,
    SIZE,
    alicevision,
    openmvg,
    problem_of,
)
from sfmcpp import DatasetError
from sfmcpp.sources.io import read, write


@pytest.mark.parametrize("name", FILES)
def test_what_is_written_for_visualsfm_is_the_scene_without_distortion(tmp_path: Path, name: str) -> None:
    problem = problem_of(tmp_path, name)
    write(problem, tmp_path / "written.nvm")
    again = read(tmp_path / "written.nvm")
    np.testing.assert_allclose(again.cameras, problem.cameras, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(again.points, problem.points)
    by_track = np.lexsort((problem.camera_index, problem.point_index))
    np.testing.assert_array_equal(again.camera_index, problem.camera_index[by_track])
    np.testing.assert_array_equal(again.point_index, problem.point_index[by_track])
    np.testing.assert_allclose(sfmcpp.residuals(again), 0, atol=1e-8)
    assert again.metadata.image_names == problem.metadata.image_names
    if problem.metadata.point_colors is not None:
        np.testing.assert_array_equal(again.metadata.point_colors, problem.metadata.point_colors)


@pytest.mark.parametrize("name", ["sfm_data.json", "cameras.sfm"])
@pytest.mark.parametrize("target", ["again_sfm_data.json", "again.sfm"])
def test_a_scene_is_handed_on_with_lenses_names_and_sizes(tmp_path: Path, name: str, target: str) -> None:
    problem = problem_of(tmp_path, name)
    write(problem, tmp_path / target)
    again = read(tmp_path / target)
    assert_same_problem(again, problem, intrinsics_rtol=1e-15)
    assert again.metadata.image_names == problem.metadata.image_names
    np.testing.assert_array_equal(again.metadata.image_sizes, [SIZE] * 3)
    if name == "cameras.sfm" and target == "again.sfm":
        np.testing.assert_array_equal(again.metadata.point_colors, problem.metadata.point_colors)


_WITH_SIZES = ["a_sfm_data.json", "a.sfm", "transforms.json", "model"]


@pytest.mark.parametrize("target", _WITH_SIZES)
@pytest.mark.parametrize("source", ["image_sizes", "colmap_camera_sizes"])
def test_sizes_of_zero_are_not_known_and_cover_the_observations(
    tmp_path: Path, target: str, source: str
) -> None:
    problem = sfmcpp.circle_scene(3, 30)
    sizes = np.array([[640, 480], [0, 480], [0, 0]])
    if source == "image_sizes":
        problem.metadata.image_sizes = sizes
    else:
        problem.metadata.extra[source] = sizes
    write(problem, tmp_path / target)
    seen = [np.ceil(problem.pixels[problem.camera_index == k].max(axis=0)) for k in (1, 2)]
    found = read(tmp_path / target).metadata.image_sizes
    np.testing.assert_array_equal(found, [[640, 480], *seen])


@pytest.mark.parametrize("target", _WITH_SIZES)
@pytest.mark.parametrize(
    ("sizes", "reason"),
    [
        (np.ones((2, 2), int), r"metadata image_sizes is int64 \(2, 2\): must be integers \(3, 2\)"),
        (np.array([640, 480]), r"metadata image_sizes is int64 \(2,\): must be integers \(3, 2\)"),
        (np.full((3, 2), 640.5), "metadata image_sizes is float64"),
        (np.full((3, 2), -1), "metadata image_sizes has -1: must be from 0 to 2147483647 px"),
    ],
)
def test_sizes_that_are_none_are_refused(
    tmp_path: Path, target: str, sizes: NDArray[Any], reason: str
) -> None:
    problem = sfmcpp.circle_scene(3, 30)
    problem.metadata.image_sizes = sizes
    with pytest.raises(DatasetError, match=reason):
        write(problem, tmp_path / target)
    assert not (tmp_path / target).exists()


@pytest.mark.parametrize("target", _WITH_SIZES)
def test_intrinsics_of_images_of_two_sizes_are_refused(tmp_path: Path, target: str) -> None:
    problem = sfmcpp.circle_scene(3, 30).with_shared_intrinsics()
    problem.metadata.image_sizes = np.array([[0, 0], [640, 480], [320, 240]])
    with pytest.raises(DatasetError, match=r"intrinsics\[0\] have images of 640×480 and 320×240 px"):
        write(problem, tmp_path / target)
    assert not (tmp_path / target).exists()
    problem.metadata.image_sizes[2] = 0  # not known: as that of the others
    write(problem, tmp_path / target)
    np.testing.assert_array_equal(read(tmp_path / target).metadata.image_sizes, [[640, 480]] * 3)


@pytest.mark.parametrize("name", ["sfm_data.json", "cameras.sfm"])
def test_what_is_written_for_g2o_is_the_scene_without_distortion(tmp_path: Path, name: str) -> None:
    problem = problem_of(tmp_path, name)
    write(problem, tmp_path / "written.g2o")
    again = read(tmp_path / "written.g2o")
    np.testing.assert_allclose(again.cameras, problem.cameras, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(again.points, problem.points)
    np.testing.assert_allclose(sfmcpp.residuals(again), 0, atol=1e-8)
    lens = dict(zip(again.intrinsic_names, again.intrinsics[0], strict=True))
    assert (lens["f"], lens["cx"], lens["cy"], lens["k1"]) == (FOCAL, *CENTRE, 0)


def test_what_is_written_for_openmvg_is_packed_as_its_reader_unpacks(tmp_path: Path) -> None:
    problem = sfmcpp.circle_scene(3, 5, camera_model="perspective", seed=0)
    problem.intrinsics[2, problem.intrinsic_names.index("k1")] = 0.1
    write(problem, tmp_path / "sfm_data.json")
    content = json.loads((tmp_path / "sfm_data.json").read_text())
    assert list(content) == list(openmvg())
    packed = [entry["value"] for part in ("views", "intrinsics") for entry in content[part]]
    pointers = [value["ptr_wrapper"]["id"] for value in packed]
    assert pointers == list(range(FIRST + 1, FIRST + 7))
    assert [value["polymorphic_id"] for value in packed] == [*[2**30] * 3, FIRST + 1, 1, FIRST + 2]
    models = [value.get("polymorphic_name") for value in packed[3:]]
    assert models == ["pinhole", None, "pinhole_radial_k1"]
    assert (
        packed[0]["ptr_wrapper"]["data"].keys()
        == openmvg()["views"][0]["value"]["ptr_wrapper"]["data"].keys()
    )


def test_what_is_written_for_alicevision_has_all_that_its_reader_asks_for(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, "cameras.sfm")
    problem.set_free_intrinsics()
    write(problem, tmp_path / "again.sfm")
    (lens,) = json.loads((tmp_path / "again.sfm").read_text())["intrinsics"]
    assert {
        "serialNumber",
        "sensorWidth",
        "sensorHeight",
        "type",
        "locked",
        *alicevision()["intrinsics"][0],
    } <= {*lens}
    assert (lens["type"], lens["locked"]) == ("brown", "1")
    assert read(tmp_path / "again.sfm").fixed_intrinsics.all()


@pytest.mark.parametrize(
    ("target", "names", "told"),
    [
        (
            "sfm_data.json",
            ("aspect",),
            r"intrinsics\[0\]: no supported camera model \(pinhole, .* has .*aspect",
        ),
        ("a.sfm", ("skew",), r"no supported camera model \(pinhole, radial1, .*skew = 0\.5"),
        ("a.sfm", ("k4",), r"k4 = 0\.5"),
        ("a.g2o", ("skew",), r"intrinsics\[0\]: skew = 0\.5 cannot be kept in g2o's files"),
    ],
)
def test_lenses_that_a_file_cannot_hold_are_named_and_nothing_is_left(
    tmp_path: Path, target: str, names: tuple[str, ...], told: str
) -> None:
    problem = sfmcpp.circle_scene(3, 5, camera_model="perspective", seed=0)
    problem.intrinsics[0, [problem.intrinsic_names.index(name) for name in names]] = 0.5
    with pytest.raises(DatasetError, match=told):
        write(problem, tmp_path / target)
    assert not (tmp_path / target).exists()


@pytest.mark.parametrize("target", ["a.sfm", "a.g2o", "a.nvm", "transforms.json"])
@pytest.mark.parametrize(("name", "value"), [("f", -700.0), ("f", 0.0), ("aspect", 0.0)])
def test_focal_lengths_that_no_reader_takes_are_not_written(
    tmp_path: Path, target: str, name: str, value: float
) -> None:
    problem = sfmcpp.circle_scene(3, 5, camera_model="perspective", seed=0)
    problem.intrinsics[1, problem.intrinsic_names.index(name)] = value
    with pytest.raises(DatasetError, match=rf"intrinsics\[1\]: .*{name} = {value}.*: must be positive"):
        write(problem, tmp_path / target)
    assert not (tmp_path / target).exists()


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("two\nlines", r"must not be empty, .* hold a line break"),
        (" space before", "must not be empty, start or end with white space"),
        ("", "must not be empty"),
        ("#1.jpg", "must not begin with #, as comments do"),
    ],
)
def test_what_visualsfm_cannot_name_is_refused_and_nothing_is_left(
    tmp_path: Path, name: str, reason: str
) -> None:
    problem = problem_of(tmp_path, "model.nvm")
    problem.metadata.image_names = ["one", name, "three"]
    with pytest.raises(sfmcpp.DatasetError, match=f"image name {re.escape(repr(name))} {reason}"):
        write(problem, tmp_path / "written.nvm")
    assert not (tmp_path / "written.nvm").exists()
