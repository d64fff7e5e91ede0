"""Bundler: exact round trips, unregistered cameras, and the line of every kind of damage."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from io_helpers import PROPERTY, assert_same_problem, no_warnings, random_problem, refusal, residuals
from sfmcpp import DatasetError, Problem
from sfmcpp.sources.io import read, write

SMALL = """# Bundle file v0.3
2 2
500 0.1 -0.01
1 0 0
0 1 0
0 0 1
0 0 -10
0 0 0
0 0 0
0 0 0
0 0 0
0 0 0
1 2 3
255 0 7
1 0 42 1.5 -2.5
-1 -2 -3
9 8 7
0"""


def bundler_file(folder: Path, changed: dict[int, str] | None = None) -> Path:
    """Write the small file with some lines, counted from 1, replaced."""
    lines = SMALL.split("\n")
    for number, text in (changed or {}).items():
        lines[number - 1] = text
    path = folder / "bundle.out"
    path.write_text("\n".join(lines) + "\n", encoding="latin-1")
    return path


def test_residual_is_that_of_the_definition(tmp_path: Path) -> None:
    problem = read(bundler_file(tmp_path))
    x, y, z = 1.0, 2.0, 3.0 - 10.0
    p = np.array([-x / z, -y / z])
    expected = 500 * (1 + 0.1 * (p @ p) - 0.01 * (p @ p) ** 2) * p - [1.5, -2.5]
    np.testing.assert_allclose(residuals(problem), [[expected[0], -expected[1]]], rtol=1e-13)


def test_unregistered_cameras_are_no_cameras_and_are_written_as_zeros(tmp_path: Path) -> None:
    problem = read(bundler_file(tmp_path))
    assert problem.num_cameras == 1
    write(problem, tmp_path / "again.out")
    written = [line.split() for line in (tmp_path / "again.out").read_text().split("\n")[7:12]]
    np.testing.assert_array_equal(np.array(written, dtype=float), np.zeros((5, 3)))


def test_unregistered_cameras_keep_their_places_in_a_bundler_file_alone(tmp_path: Path) -> None:
    lines = SMALL.split("\n")
    head, first, second, rest = lines[:2], lines[2:7], lines[7:12], lines[12:]
    rest[2] = "1 1 42 1.5 -2.5"
    (tmp_path / "bundle.out").write_text("\n".join([*head, *second, *first, *rest]) + "\n")
    problem = read(tmp_path / "bundle.out")
    assert (problem.num_cameras, problem.camera_index.tolist()) == (1, [0])
    np.testing.assert_array_equal(problem.intrinsics, [[500, 0.1, -0.01]])
    write(problem, tmp_path / "problem.npz")
    write(read(tmp_path / "problem.npz"), tmp_path / "again.out")
    assert (tmp_path / "again.out").read_text().split("\n")[2:7] == ["0.0 0.0 0.0"] * 5
    assert_same_problem(read(tmp_path / "again.out"), problem)
    write(problem, tmp_path / "model")
    model = read(tmp_path / "model")
    assert (model.num_cameras, model.metadata.image_names) == (1, ["image_000002"])


def test_a_point_seen_by_an_unregistered_camera_is_named_with_its_line(tmp_path: Path) -> None:
    error = refusal(bundler_file(tmp_path, {15: "1 1 42 1.5 -2.5"}))
    assert "camera 1 observes this point, and is all zeros: not registered" in str(error)
    assert error.line == 15


def test_rounded_rotations_become_rotations(tmp_path: Path) -> None:
    changed = {4: "0.8001 -0.6 0", 5: "0.6 0.7999 0", 6: "0 0 1"}
    rotation = read(bundler_file(tmp_path, changed)).rotations[0]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(
        rotation.T * [[1], [-1], [-1]], [[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]], atol=1e-4
    )


@PROPERTY
@given(st.integers(0, 2**32))
def test_random_problems_survive_writing_and_reading(seed: int) -> None:
    problem = random_problem(seed, "bal", {"f": 900, "k1": 0.2, "k2": 0.1})
    rng = np.random.default_rng(seed)
    keys = rng.integers(0, 9999, problem.num_observations)
    problem.metadata.extra["bundler_keys"] = keys
    with tempfile.TemporaryDirectory() as folder, no_warnings():
        write(problem, Path(folder) / "x.out")
        again = read(Path(folder) / "x.out")
    assert_same_problem(again, problem)
    np.testing.assert_array_equal(again.metadata.extra["bundler_keys"], keys)
    np.testing.assert_array_equal(again.metadata.point_colors, problem.metadata.point_colors)


@pytest.mark.parametrize("name", ["x.out", "xcams.txt", "x"])
def test_observations_are_grouped_by_point_and_keep_their_order(tmp_path: Path, name: str) -> None:
    rng = np.random.default_rng(6)
    order = rng.permutation(900)
    camera_index, point_index = order // 3, order % 3
    poses, pixels = np.tile(np.eye(3, 4), (300, 1, 1)), rng.normal(size=(900, 2))
    problem = Problem("bal", poses, np.ones((300, 3)), np.eye(3), camera_index, point_index, pixels)
    write(problem, tmp_path / name)
    again = read(tmp_path / name)
    grouped = [i for point in range(3) for i in range(900) if point_index[i] == point]
    np.testing.assert_array_equal(again.camera_index, camera_index[grouped])
    columns = [i for i, parameter in enumerate(again.intrinsic_names) if parameter in ("cx", "cy")]
    principal = again.intrinsics[again.intrinsics_index[again.camera_index]][:, columns]
    of_colmap = name == "x"  # whose pixels count from the corner
    assert (principal > 0).all() if of_colmap else (principal == 0).all()
    expected = pixels[grouped] + (principal if of_colmap else 0)
    np.testing.assert_allclose(again.pixels, expected, rtol=0, atol=0)


DAMAGE = [
    ({1: "# Bundle file v0.2"}, 1, "first line must be '# Bundle file v0.3'"),
    ({2: "2"}, 2, "holds 1 numbers: must be 2"),
    ({2: "-2 2"}, 2, "number of cameras -2"),
    ({2: f"2 {'9' * 30}"}, 2, "number of points"),
    ({2: "2 3"}, 18, "truncated: 2 cameras, 3 points take 20 lines, the file has 17"),
    ({2: "2 1"}, 16, "trailing garbage: 2 cameras, 1 points take 14 lines, the file has 17"),
    ({5: "0 1"}, 5, "holds 2 numbers: must be 3"),
    ({5: "0 2 0"}, 4, "camera 0: its 3x3 matrix is not a rotation"),
    ({6: "0 0 -1"}, 4, "not a rotation"),
    ({8: "500 0 0"}, 9, "camera 1: its 3x3 matrix is not a rotation"),
    ({13: "1 2 inf"}, 13, "inf is not a finite number"),
    ({14: "256 0 7"}, 14, "colour 256: must be an integer from 0 to 255"),
    ({15: "-1 0 42 1.5 -2.5"}, 15, "number of views -1"),
    ({15: "2 0 42 1.5 -2.5"}, 15, "holds 5 numbers"),
    ({15: "1 2 42 1.5 -2.5"}, 15, "camera index 2: must be an integer from 0 to 1"),
    ({15: "1 0 -4 1.5 -2.5"}, 15, "key number -4"),
    ({15: "2 0 42 1.5 -2.5 0 43 6 7"}, 15, "camera 0 observes this point twice"),
    ({17: "9 8 \xff"}, 17, "is not a finite number"),
    ({18: "0\n1 2 3"}, 19, "trailing garbage"),
    ({18: ""}, 17, "truncated"),
]


@pytest.mark.parametrize(("changed", "line", "reason"), DAMAGE)
def test_damage_is_named_with_its_line(
    tmp_path: Path, changed: dict[int, str], line: int, reason: str
) -> None:
    error = refusal(bundler_file(tmp_path, changed))
    assert reason in str(error)
    assert error.line == line


def test_metadata_of_another_length_are_refused(tmp_path: Path) -> None:
    problem = read(bundler_file(tmp_path))
    problem.metadata.extra["bundler_registered"] = np.array([True, True])
    with pytest.raises(DatasetError, match="bundler_registered tells of 2 cameras: must be 1"):
        write(problem, tmp_path / "x.out")
    del problem.metadata.extra["bundler_registered"]
    problem.metadata.extra["bundler_keys"] = np.arange(5)
    with pytest.raises(DatasetError, match="bundler_keys has 5 entries: must be 1"):
        write(problem, tmp_path / "x.out")
