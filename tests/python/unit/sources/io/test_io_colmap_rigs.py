"""Rigs and frames of COLMAP models: read, or refused by name."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
import pytest

from io_helpers import assert_same_problem
from sfmcpp import DatasetError, rig_walk_scene
from sfmcpp.sources.io import read, write
from sfmcpp.sources.io.colmap.rig_files import (
    Frame,
    Rig,
    RigModel,
    Sensor,
    binary_rig_files,
    text_rig_files,
)
from test_io_colmap import FORMATS, small_model

RIGS_TEXT = "# RIG_ID NUM_SENSORS ...\n4 1 CAMERA 7\n9 1 CAMERA 8\n"
RIGS_BINARY = struct.pack("<QIIiIIIiI", 2, 4, 1, 0, 7, 9, 1, 0, 8)


@pytest.mark.parametrize("format", FORMATS)
def test_rigs_of_single_sensors_change_nothing(tmp_path: Path, format: str) -> None:
    problem = read(small_model(tmp_path))
    write(problem, tmp_path, format=format)
    if format == "colmap-text":
        (tmp_path / "rigs.txt").write_text(RIGS_TEXT)
    else:
        (tmp_path / "rigs.bin").write_bytes(RIGS_BINARY)
    again = read(tmp_path, format=format)
    assert again.rigs is None
    assert_same_problem(again, problem, intrinsics_rtol=4e-16)


def rig_model(folder: Path) -> Path:
    """A model of a rig as text: two frames of three cameras."""
    write(rig_walk_scene(6, 100, camera_model="perspective", seed=0), folder, format="colmap-text")
    return folder


@pytest.mark.parametrize(
    ("name", "old", "new", "reason"),
    [
        ("rigs.txt", "CAMERA 3 1.*", "CAMERA 3 0", "the pose of camera 3 in the rig is not known"),
        ("rigs.txt", "CAMERA 2 1", "IMU 2 1", "rig 1 has a sensor of kind IMU: only cameras"),
        ("rigs.txt", "CAMERA 3 1", "CAMERA 2 1", "camera 2 is in rigs twice"),
        (
            "rigs.txt",
            "CAMERA 3 1",
            "CAMERA 3 1 9",
            ":2: a line that cannot be read: words are left over",
        ),
        ("frames.txt", "CAMERA 2 5", "CAMERA 2 4", "frame 2: image 4 is of camera 1, not of 2"),
        ("frames.txt", "CAMERA 2 5", "CAMERA 2 9", "frame 2: image 9 is not in the list of images"),
        ("frames.txt", "CAMERA 2 5", "CAMERA 7 5", "frame 2: camera 7 is none of rig 1"),
        ("frames.txt", "3 CAMERA 1 4 CAMERA 2 5", "2 CAMERA 1 4", "image 5|no frame of frames.txt"),
        ("frames.txt", "CAMERA 2 5", "CAMERA 2 2", "frame 2: image 2 is in another frame too"),
        ("frames.txt", "\n2 1 ", "\n2 1 nan ", "frames.txt:.*nan is not a finite number"),
        ("frames.txt", "\n2 1 ", "\n2 1 0_1 ", "frames.txt:.*0_1 is not a finite number"),
        ("frames.txt", "\n2 1 ", "\n2 1_0 ", "frames.txt:.*1_0 must be a whole number from 0"),
        ("rigs.txt", "CAMERA 3 1", "CAMERA 3.5 1", "rigs.txt:2: .*3.5 must be a whole number from 0"),
    ],
)
def test_rigs_that_contradict_themselves_are_refused_by_name(
    tmp_path: Path, name: str, old: str, new: str, reason: str
) -> None:
    path = rig_model(tmp_path / "model") / name
    text = path.read_text()
    assert re.search(old, text)
    path.write_text(re.sub(old, new, text))
    with pytest.raises(DatasetError, match=reason) as refused:
        read(path.parent)
    assert Path(refused.value.path).parent == path.parent


def test_images_of_a_rig_may_stand_in_the_file_in_any_order(tmp_path: Path) -> None:
    folder = rig_model(tmp_path / "model")
    problem = read(folder)
    head, *lines = (folder / "images.txt").read_text().splitlines()
    images = [lines[row : row + 2] for row in range(0, len(lines), 2)]
    shuffled = [line for row in (4, 0, 5, 2, 1, 3) for line in images[row]]
    (folder / "images.txt").write_text("\n".join([head, *shuffled]) + "\n")
    again = read(folder)
    assert_same_problem(again, problem)
    np.testing.assert_array_equal(again.rigs.frame_of_camera, problem.rigs.frame_of_camera)
    np.testing.assert_array_equal(again.rigs.sensor_of_camera, problem.rigs.sensor_of_camera)


def test_an_image_that_is_not_where_its_frame_is_is_refused(tmp_path: Path) -> None:
    folder = rig_model(tmp_path / "model")
    lines = (folder / "images.txt").read_text().splitlines()
    words = lines[1].split()
    words[7] = "0.5"
    lines[1] = " ".join(words)
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    with pytest.raises(DatasetError, match="its pose is not that of its frame and sensor"):
        read(folder)


def write_frames_of_one_image(folder: Path, format: str, x: float) -> Path:
    """The rigs and frames of the small model, whose second image is at −x; its frames file."""
    paths = [folder / f"{name}.{'txt' if format == 'colmap-text' else 'bin'}" for name in ("rigs", "frames")]
    poses = {3: (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0), 9: (-1.0, 0.0, 0.0, 0.0, x, 0.0, 5.0)}
    frames = tuple(Frame(image, 1, pose, (("CAMERA", 7, image),)) for image, pose in poses.items())
    model = RigModel((Rig(1, (Sensor("CAMERA", 7),)),), frames, *paths)
    contents = text_rig_files(model) if format == "colmap-text" else binary_rig_files(model)
    for path, content in zip(paths, contents, strict=True):
        path.write_bytes(b"".join(content))
    return paths[1]


@pytest.mark.parametrize("format", FORMATS)
def test_poses_that_frames_of_one_image_contradict_are_refused(tmp_path: Path, format: str) -> None:
    """Scripts that know no frames leave them as they were, and COLMAP takes the poses of frames."""
    folder = tmp_path / "model"
    write(read(small_model(tmp_path)), folder, format=format)
    write_frames_of_one_image(folder, format, 1.0)
    assert read(folder).rigs is None
    frames = write_frames_of_one_image(folder, format, 1.001)
    suffix = frames.suffix
    told = rf"images{suffix}.*its pose is not that in frames{suffix}, which COLMAP takes: .* rigs{suffix}"
    with pytest.raises(DatasetError, match=told):
        read(folder)
    frames.unlink()
    assert read(folder).rigs is None


@pytest.mark.parametrize(
    ("rows", "reason"),
    [([0, 1, 2, 0, 1, 3], "sensor 2 has several rows"), ([0, 1, 1, 0, 1, 1], "sensors share intrinsics 1")],
)
def test_sensors_that_are_no_cameras_of_colmap_are_not_written(
    tmp_path: Path, rows: list[int], reason: str
) -> None:
    problem = rig_walk_scene(6, 100, camera_model="perspective", seed=0)
    problem.intrinsics = np.tile(problem.intrinsics[:1], (4, 1))
    problem.fixed_intrinsics = np.tile(problem.fixed_intrinsics[:1], (4, 1))
    problem.intrinsics_index = np.array(rows, np.int32)
    with pytest.raises(DatasetError, match=reason):
        write(problem, tmp_path / "model")


@pytest.mark.parametrize("other", FORMATS)
@pytest.mark.parametrize("format", FORMATS)
def test_a_model_of_rigs_replaces_another_and_one_without_does_not(
    tmp_path: Path, format: str, other: str
) -> None:
    problem = rig_walk_scene(6, 100, camera_model="perspective", seed=0)
    assert problem.rigs is not None
    write(rig_walk_scene(9, 100, camera_model="perspective", seed=1), tmp_path / "model", format=other)
    write(problem, tmp_path / "model", format=format)
    for kind in {format, other}:
        again = read(tmp_path / "model", format=kind)
        assert again.rigs is not None
        np.testing.assert_allclose(again.cameras, problem.cameras, rtol=0, atol=1e-12)
        assert again.rigs.num_frames == problem.rigs.num_frames
    problem.rigs = None
    with pytest.raises(DatasetError, match="would be replaced, and this file would contradict the new poses"):
        write(problem, tmp_path / "model", format=format)
