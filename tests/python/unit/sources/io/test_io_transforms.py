"""transforms.json against OpenCV's and OpenGL's own conventions, computed apart from the package."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sfmcpp import DatasetError, Metadata, Problem
from sfmcpp.cli.console import ExitCode
from sfmcpp.sources.io import read, write
from sfmcpp.sources.io.transforms import write_transforms
from sfmcpp.study.evaluation import evaluate_model

LENS = {"f": 800.0, "aspect": 1.01, "cx": 322.0, "cy": 239.5, "k1": 0.1, "k2": -0.05, "p1": 1e-3, "p2": -2e-3}
SIZE = (640, 480)


def scene(groups: int = 1, **lens: float) -> Problem:
    """Cameras in a row that look along z, turned at random, with named images; pixels play no part."""
    rng = np.random.default_rng(5)
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    count = 4
    turns = rotation.from_rotvec(0.2 * rng.normal(size=(count, 3))).as_matrix()
    problem = Problem(
        "perspective",
        np.concatenate([turns, rng.normal(size=(count, 3, 1))], axis=2),
        np.zeros((groups, 12)),
        rng.normal(size=(7, 3)) + np.array([0, 0, 6]),
        np.empty(0, np.int32),
        np.empty(0, np.int32),
        np.empty((0, 2)),
        intrinsics_index=np.arange(count) % groups,
        metadata=Metadata(image_names=[f"left/{i}.jpg" for i in range(count)]),
    )
    for row in range(groups):
        values = {**dict.fromkeys(problem.intrinsic_names, 0.0), "aspect": 1.0, **LENS, **lens}
        values["f"] += 10 * row
        problem.intrinsics[row] = [values[name] for name in problem.intrinsic_names]
    problem.metadata.image_sizes = np.tile(SIZE, (count, 1))
    return problem


def written(problem: Problem, folder: Path) -> dict[str, Any]:
    write(problem, folder / "transforms.json")
    content: dict[str, Any] = json.loads((folder / "transforms.json").read_text())
    return content


def seen(content: dict[str, Any], frame: dict[str, Any], points: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of points, as a program with OpenGL's cameras and OpenCV's distortion finds them."""
    cv2 = pytest.importorskip("cv2")
    lens = {**content, **frame}
    world = np.column_stack([points, np.ones(len(points))])
    x, y, z, _ = np.linalg.solve(np.array(frame["transform_matrix"]), world.T)
    assert (z < 0).all(), "what an OpenGL camera sees lies at negative z"
    matrix = np.array([[lens["fl_x"], 0, lens["cx"]], [0, lens["fl_y"], lens["cy"]], [0, 0, 1]])
    distortion = np.array([lens.get(name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3")])
    # In the image x goes right and y down, hence the signs.
    pixels, _ = cv2.projectPoints(np.column_stack([x, -y, -z]), np.zeros(3), np.zeros(3), matrix, distortion)
    return np.asarray(pixels[:, 0])


def expected_pixels(problem: Problem, camera: int) -> np.ndarray:
    """The same by the definition of the perspective model."""
    v = dict(zip(problem.intrinsic_names, problem.intrinsics[problem.intrinsics_index[camera]], strict=True))
    inside = (problem.points - problem.centres[camera]) @ problem.rotations[camera]
    x, y = (inside[:, :2] / inside[:, 2:]).T
    r2 = x * x + y * y
    radial = 1 + v["k1"] * r2 + v["k2"] * r2**2 + v["k3"] * r2**3
    u = x * radial + 2 * v["p1"] * x * y + v["p2"] * (r2 + 2 * x * x)
    w = y * radial + v["p1"] * (r2 + 2 * y * y) + 2 * v["p2"] * x * y
    return np.column_stack([v["f"] * u + v["cx"], v["f"] * v["aspect"] * w + v["cy"]])


@pytest.mark.parametrize("lens", [{}, {"k3": 0.02}, {"k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0}])
@pytest.mark.parametrize("groups", [1, 2, 4])
def test_another_program_sees_every_point_in_the_same_pixel(
    groups: int, lens: dict[str, float], tmp_path: Path
) -> None:
    problem = scene(groups, **lens)
    content = written(problem, tmp_path)
    assert len(content["frames"]) == problem.num_cameras
    for camera, frame in enumerate(content["frames"]):
        pixels = seen(content, frame, problem.points)
        np.testing.assert_allclose(pixels, expected_pixels(problem, camera), atol=1e-9)


def test_a_camera_that_looks_along_the_worlds_z_is_turned_about_x(tmp_path: Path) -> None:
    problem = scene()
    problem.cameras[0] = np.eye(3, 4)
    problem.cameras[0, :, 3] = [1, 2, 3]
    matrix = written(problem, tmp_path)["frames"][0]["transform_matrix"]
    # Right is +x, up is −y of a world whose y goes down, and the camera looks along its own −z.
    assert matrix == [[1, 0, 0, 1], [0, -1, 0, 2], [0, 0, -1, 3], [0, 0, 0, 1]]


def test_intrinsics_stand_once_where_all_frames_share_them_and_else_with_each(tmp_path: Path) -> None:
    keys = {"fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "k2", "p1", "p2"}
    shared = written(scene(1), tmp_path)
    assert keys <= set(shared)
    assert [set(frame) for frame in shared["frames"]] == [{"file_path", "transform_matrix"}] * 4
    assert (shared["w"], shared["h"], shared["camera_model"]) == (*SIZE, "OPENCV")
    assert isinstance(shared["w"], int)
    apart = written(scene(2), tmp_path)
    assert not keys & set(apart)
    assert [frame["fl_x"] for frame in apart["frames"]] == [800.0, 810.0, 800.0, 810.0]
    assert all(keys <= set(frame) for frame in apart["frames"])


def test_images_are_named_below_their_folder(tmp_path: Path) -> None:
    assert [f["file_path"] for f in written(scene(), tmp_path)["frames"]][:2] == ["left/0.jpg", "left/1.jpg"]
    write_transforms(scene(), tmp_path / "transforms.json", image_folder="../photos/")
    content = json.loads((tmp_path / "transforms.json").read_text())
    assert content["frames"][3]["file_path"] == "../photos/left/3.jpg"
    assert "ply_file_path" not in content
    write_transforms(scene(), tmp_path / "transforms.json", points="points.ply")
    assert json.loads((tmp_path / "transforms.json").read_text())["ply_file_path"] == "points.ply"


@pytest.mark.parametrize("name", ["k4", "k5", "skew"])
def test_what_the_file_cannot_say_is_refused_and_nothing_written(name: str, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=rf"{name} = 0.5 cannot be kept in transforms.json"):
        write(scene(**{name: 0.5}), tmp_path / "transforms.json")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("groups", [1, 2])
def test_cameras_come_back_without_points_and_all_is_fixed(groups: int, tmp_path: Path) -> None:
    problem = scene(groups, k3=0.02)
    written(problem, tmp_path)
    again = read(tmp_path / "transforms.json")
    assert (again.num_cameras, again.num_points, again.num_observations) == (4, 0, 0)
    np.testing.assert_allclose(again.cameras, problem.cameras, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(again.intrinsics_index, problem.intrinsics_index)
    np.testing.assert_allclose(again.intrinsics, problem.intrinsics, rtol=1e-15)
    assert again.metadata.image_names == problem.metadata.image_names
    np.testing.assert_array_equal(again.metadata.image_sizes, problem.metadata.image_sizes)
    assert again.fixed_intrinsics.all()


def test_images_of_different_sizes_share_no_camera(tmp_path: Path) -> None:
    """Both were of the size of the last one in models that were written of it."""
    content = written(scene(), tmp_path)
    content["frames"][1] |= {"w": content["w"] + 2, "h": content["h"] + 4}
    path = tmp_path / "sizes.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    truth = read(path)
    write(truth, tmp_path / "model")
    found = read(tmp_path / "model")
    assert len(found.intrinsics) == 2
    np.testing.assert_array_equal(found.metadata.image_sizes, truth.metadata.image_sizes)


def test_a_focal_length_may_be_told_by_the_angle_of_view(tmp_path: Path) -> None:
    content = written(scene(), tmp_path)
    for name in ("fl_x", "fl_y", "cx", "cy"):
        del content[name]
    content["camera_angle_x"] = 2 * np.arctan(SIZE[0] / 2 / 750.0)
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    again = read(tmp_path / "transforms.json")
    f, aspect, cx, cy = again.intrinsics[0, :4]
    assert (f, aspect, cx, cy) == (pytest.approx(750.0, rel=1e-14), 1.0, SIZE[0] / 2, SIZE[1] / 2)


def test_it_is_a_truth_that_a_model_is_measured_against(tmp_path: Path) -> None:
    problem = scene()
    written(problem, tmp_path)
    problem.cameras[:, :, 3] += np.array([0.5, 0, 0])
    found = evaluate_model(problem, tmp_path / "transforms.json", align_to="none")
    assert found.to_dict()["centre_error"]["max"] == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"camera_model": "OPENCV_FISHEYE"}, "'OPENCV_FISHEYE': must be one of OPENCV"),
        ({"is_fisheye": True}, "is_fisheye: fisheye lenses, as instant-ngp marks them, are not supported"),
        ({"fl_x": "8_00"}, "fl_x: '8_00': must be a finite number"),
        ({"fl_x": -1}, "fl_x = -1, fl_y = 808: must be positive"),
        ({"frames": 3}, r"frames: 3.*: must be a list"),
        ({"frames": [{"file_path": "a"}]}, r"frames\[0\]: lacks 'transform_matrix'"),
        (
            {"frames": [{"file_path": "a", "transform_matrix": [[1, 0, 0, 0]] * 4}]},
            "last row must be 0 0 0 1",
        ),
    ],
)
def test_damage_is_named_with_its_place(change: dict[str, Any], told: str, tmp_path: Path) -> None:
    content = written(scene(), tmp_path) | change
    (tmp_path / "transforms.json").write_text(json.dumps(content))
    with pytest.raises(DatasetError, match=told):
        read(tmp_path / "transforms.json")


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ([{"cameras": {}, "shots": {}, "points": {}}], "OpenSfM: must be made a Bundler file"),
        ([{"id": 0, "img_name": "a"}], "is no transforms.json, which has 'frames'"),
        ({"cameras": []}, "is no transforms.json, which has 'frames'"),
        ([], "is no transforms.json, which has 'frames'"),
    ],
)
def test_json_of_other_programs_is_named(content: Any, told: str, tmp_path: Path) -> None:
    (tmp_path / "cameras.json").write_text(json.dumps(content))
    with pytest.raises(DatasetError, match=told):
        read(tmp_path / "cameras.json")


def test_the_command_line_converts_to_it(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from sfmcpp.cli.app import app

    write(scene(), tmp_path / "model")
    result = CliRunner().invoke(app, ["convert", str(tmp_path / "model"), str(tmp_path / "transforms.json")])
    assert result.exit_code == ExitCode.DONE
    assert json.loads((tmp_path / "transforms.json").read_text())["fl_x"] == 800.0


def test_equal_lenses_before_images_of_two_sizes_keep_these_sizes(tmp_path: Path) -> None:
    problem = scene(4)
    problem.intrinsics[:] = problem.intrinsics[0]
    assert problem.metadata.image_sizes is not None
    problem.metadata.image_sizes[3] = 320, 240  # a corner of an image
    written(problem, tmp_path)
    again = read(tmp_path / "transforms.json")
    assert again.intrinsics_index.tolist() == [0, 0, 0, 1]
    write(again, tmp_path / "model")
    np.testing.assert_array_equal(read(tmp_path / "model").metadata.image_sizes, [SIZE] * 3 + [(320, 240)])
