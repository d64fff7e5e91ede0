"""OpenMVG, AliceVision and VisualSFM: files of a scene are read, and what is damaged in them is named."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sfmcpp
from io_helpers import residuals
from other_programs import (
    CENTRE,
    FILES,
    FOCAL,
    MEASURED,
    NAMES,
    POINTS,
    RADIAL,
    SEEN,
    SIZE,
    TANGENTIAL,
    TRUTH,
    alicevision,
    nvm,
    openmvg,
    problem_of,
)
from sfmcpp import DatasetError
from sfmcpp.sources.io import read, write


@pytest.mark.parametrize("name", FILES)
def test_a_scene_has_its_poses_points_and_no_residuals(tmp_path: Path, name: str) -> None:
    problem = problem_of(tmp_path, name)
    assert (problem.num_cameras, problem.num_points, problem.num_observations) == (3, POINTS, len(SEEN))
    assert problem.metadata.image_names == NAMES[:3]
    np.testing.assert_allclose(problem.centres, TRUTH.centres, rtol=0, atol=1e-14)
    np.testing.assert_allclose(problem.rotations, np.swapaxes(TRUTH.rotations, 1, 2), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(problem.points, TRUTH.points)
    np.testing.assert_allclose(residuals(problem), 0, atol=1e-9)
    np.testing.assert_allclose(sfmcpp.residuals(problem), 0, atol=1e-9)


@pytest.mark.parametrize("name", ["sfm_data.json", "cameras.sfm"])
def test_photos_without_a_pose_are_named_and_lenses_and_sizes_are_kept(tmp_path: Path, name: str) -> None:
    problem = problem_of(tmp_path, name)
    assert problem.metadata.extra["unregistered_images"] == ["lost.jpg"]
    np.testing.assert_array_equal(problem.metadata.image_sizes, [SIZE] * 3)
    lens = dict(zip(problem.intrinsic_names, problem.intrinsics[0], strict=True))
    assert [lens[k] for k in ("cx", "cy", "k1", "k2", "k3", "p1", "p2")] == [*CENTRE, *RADIAL, *TANGENTIAL]
    free = [name for name, fixed in zip(lens, problem.fixed_intrinsics[0], strict=True) if not fixed]
    assert free == ["f", "k1", "k2", "k3", "p1", "p2"]
    assert len(problem.intrinsics) == 1


@pytest.mark.parametrize("name", FILES)
def test_a_scene_is_adjusted_and_handed_on_to_colmap(tmp_path: Path, name: str) -> None:
    problem = problem_of(tmp_path, name)
    problem.points += 0.01
    problem.set_free_intrinsics()
    assert sfmcpp.solve(problem).final_rms_px < 1e-6
    columns = [problem.intrinsic_names.index(k) for k in ("k3", "p1", "p2") if k in problem.intrinsic_names]
    problem.intrinsics[:, columns] = 0  # which no supported model of COLMAP holds together
    write(problem, tmp_path / "model")
    assert read(tmp_path / "model").metadata.image_names == NAMES[:3]


def test_measurements_of_visualsfm_keep_their_distortion_in_the_metadata(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, "model.nvm")
    np.testing.assert_array_equal(problem.metadata.extra["nvm_measurement_distortion"], [MEASURED] * 3)
    np.testing.assert_array_equal(problem.metadata.extra["nvm_keys"], [4 + camera for camera, _ in SEEN])
    plain = problem_of(tmp_path, "model.nvm", nvm(0.0))
    np.testing.assert_allclose(plain.pixels, problem.pixels, rtol=0, atol=1e-9)
    assert problem.metadata.point_colors is not None
    assert problem.metadata.point_colors[3].tolist() == [3, 1, 2]


@pytest.mark.parametrize(
    ("version", "focal"),
    [
        ([1, 1, 0], {"pxFocalLength": FOCAL, "principalPoint": list(CENTRE)}),
        ([1, 2, 0], {"pxFocalLength": [FOCAL, 1.25 * FOCAL], "principalPoint": list(CENTRE)}),
        ([1, 2, 4], {"pixelRatio": 0.8}),
        ([1, 2, 6], {"pixelRatio": 1.25}),
        ([1, 2, 11], {"pixelRatio": 1.25, "focalLength": 1.25 * FOCAL * 7.5 / SIZE[0]}),
    ],
)
def test_versions_of_alicevision_tell_focal_lengths_and_centres_in_their_ways(
    tmp_path: Path, version: list[int], focal: dict[str, Any]
) -> None:
    content = alicevision() | {"version": version}
    content["intrinsics"][0] |= focal
    problem = problem_of(tmp_path, "cameras.sfm", json.dumps(content))
    lens = dict(zip(problem.intrinsic_names, problem.intrinsics[0], strict=True))
    assert lens["f"] == pytest.approx(FOCAL, rel=1e-15)
    assert lens["aspect"] == pytest.approx(1.0 if version == [1, 1, 0] else 1.25, rel=1e-15)
    assert (lens["cx"], lens["cy"]) == CENTRE


def test_json_is_told_by_its_contents(tmp_path: Path) -> None:
    for name, source in (("sfm_data.json", "openmvg"), ("cameras.sfm", "alicevision")):
        other = tmp_path / f"{source}.json"
        other.write_text(FILES[name]())
        assert read(other).metadata.source_format == source
    (tmp_path / "alicevision.json").rename(tmp_path / "sfm_data.json")  # as older versions called it
    assert read(tmp_path / "sfm_data.json").metadata.source_format == "alicevision"


def test_a_pipe_named_like_a_document_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "sfm_data.json")
    with pytest.raises(DatasetError, match="is not a regular file"):
        read(tmp_path / "sfm_data.json")


def changed(content: dict[str, Any], change: Callable[[dict[str, Any]], object]) -> str:
    copy = deepcopy(content)
    change(copy)
    return json.dumps(copy)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda c: c.update(sfm_data_version="9"), r"sfm_data_version: '9': must be 0\.2 or 0\.3"),
        (lambda c: c["views"][2]["value"]["ptr_wrapper"].pop("data"), r"views\[2\].*lacks 'data'"),
        (lambda c: c["extrinsics"][1]["value"]["rotation"][0].append(1), r"extrinsics\[1\].*9 numbers"),
        (lambda c: c["extrinsics"][1]["value"].update(rotation=[[1, 2, 3]] * 3), "no rotation matrix"),
        (lambda c: c["views"][1].update(key=10), r"views\[1\]: id 10 is used twice"),
        (lambda c: c["views"][1]["value"]["ptr_wrapper"]["data"].update(id_pose=20), "share pose 20: rigs"),
        (lambda c: c["intrinsics"][0]["value"].update(polymorphic_name="fisheye"), "'fisheye': must be one"),
        (lambda c: c["intrinsics"][0]["value"].pop("polymorphic_name"), "no class that was named"),
        (lambda c: c["structure"][0]["value"]["observations"][0].update(key=13), "view 13, which has no"),
        (lambda c: c["structure"][0]["value"]["observations"].append(
            c["structure"][0]["value"]["observations"][0]), "observes this point twice"),
        (lambda c: c["structure"][4]["value"].update(X=[1, 2, "x"]), r"structure\[4\]\.value\.X\[2\]: 'x'"),
        (lambda c: c["structure"][4]["value"].update(X=[1, 2, 1e200]), "finite number"),
    ],
)  # fmt: skip
def test_damage_of_openmvg_is_named_with_its_place(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], told: str
) -> None:
    with pytest.raises(DatasetError, match=told):
        problem_of(tmp_path, "sfm_data.json", changed(openmvg(), change))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda c: c.update(rigs=[{"rigId": "1"}]), "rigs: rigs are not supported yet"),
        (lambda c: c["intrinsics"][0].update(type="equidistant"), "'equidistant': must be one of"),
        (lambda c: c["intrinsics"][0].update(sensorWidth="0"), r"intrinsics\[0\]: .*must be positive"),
        (lambda c: c["structure"][0]["observations"][0].pop("x"), "exported with its features"),
        (lambda c: c["structure"][2].update(color=["0", "256", "1"]), "from 0 to 255"),
        (lambda c: c["structure"][2].update(color=["0"]), r"structure\[2\]\.color: a list of 1: must be 3"),
    ],
)
def test_damage_of_alicevision_is_named_with_its_place(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], told: str
) -> None:
    with pytest.raises(DatasetError, match=told):
        problem_of(tmp_path, "cameras.sfm", changed(alicevision(), change))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("NVM_V3 ", "NVM_V3_R9T", ":1: the first line must be NVM_V3"),
        ("NVM_V3 ", "NVM_V3 FixedK 1 2 3 4 5", ":1: the first line must be NVM_V3"),
        ("a.jpg 800.0", "a.jpg -800.0", r":4: focal length -800: must be positive"),
        ("a.jpg 800.0 ", "a.jpg ", ":4: the line must hold a name and 10 numbers"),
        ("\n20\n", "\n21\n", ":30: the line holds 1 numbers: must be 7"),
        ("\n20\n", "\n19\n", ":28: another model begins here"),
        ("\n0\n", "\n2\n", ":30: another model begins here"),
        ("0 1 2 ", "0 1 256 ", ":9: colour 256"),
        ("\n3\n", "\n90\n", "truncated: 90 cameras"),
    ],
)
def test_damage_of_visualsfm_is_named_with_its_line(tmp_path: Path, old: str, new: str, told: str) -> None:
    text = nvm()
    assert old in text
    with pytest.raises(DatasetError, match=told):
        problem_of(tmp_path, "model.nvm", text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"sfm_data_version": "0.3",\n "views": [}', ":2: is no JSON"),
        ('{"sfm_data_version": NaN}', "NaN is no finite number"),
        ('{"sfm_data_version": ' + "[" * 100_000, "nested too deeply"),
        ('{"sfm_data_version": "0.3", "views": 3}', "extrinsics|views"),
    ],
)
def test_what_is_no_json_is_refused(tmp_path: Path, text: str, told: str) -> None:
    with pytest.raises(DatasetError, match=told):
        problem_of(tmp_path, "sfm_data.json", text)
