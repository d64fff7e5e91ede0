"""sba's files: exact round trips, siblings, covariances, and the line of every kind of damage."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from io_helpers import PROPERTY, assert_same_problem, no_warnings, random_problem, refusal, residuals
from sfmcpp import DatasetError
from sfmcpp.sources.io import read, read_sba, write

CAMERAS = ["# quaternion translation", "1 0 0 0 0 0 5", "0.5 0.5 0.5 0.5 1 2 3"]
POINTS = ["# X Y Z n frame x y", "1 2 3 2 0 10 20 1 30 40", "", "4 5 6 0"]
CALIBRATION = ["800 1 320", "0 840 240", "0 0 1"]
ORDER = ("f", "cx", "cy", "aspect", "skew", "k1", "k2", "p1", "p2", "k3")


def sba_files(folder: Path, cameras: dict[int, str], points: dict[int, str], calib: dict[int, str]) -> Path:
    """Write the small problem, with some lines, counted from 1, of each file replaced."""
    texts = {"3cams.txt": (CAMERAS, cameras), "3pts.txt": (POINTS, points), "calib.txt": (CALIBRATION, calib)}
    for name, (lines, changed) in texts.items():
        merged = [changed.get(number, line) for number, line in enumerate(lines, 1)]
        (folder / name).write_text("\n".join(merged) + "\n")
    return folder / "3cams.txt"


def test_residuals_are_those_of_the_definition(tmp_path: Path) -> None:
    problem = read(sba_files(tmp_path, {}, {}, {}))
    assert problem.camera_model == "calibrated"
    assert problem.intrinsics.shape == (1, 5)
    first = np.array([1, 2, 8.0])
    second = np.array([3 + 1, 1 + 2, 2 + 3.0])
    matrix = np.array([[800, 1, 320], [0, 840, 240], [0, 0, 1.0]])
    pixels = [(matrix @ x / x[2])[:2] for x in (first, second)]
    np.testing.assert_allclose(residuals(problem), np.array(pixels) - [[10, 20], [30, 40]], rtol=1e-13)


@pytest.mark.parametrize(("count", "free"), [(5, {"f", "cx", "cy"}), (10, {"f", "cx", "cy", "k1", "k2"})])
def test_columns_and_masks_of_varying_intrinsics(tmp_path: Path, count: int, free: set[str]) -> None:
    numbers = " ".join(str(n) for n in range(1, count + 1))
    path = sba_files(tmp_path, {2: f"{numbers} 1 0 0 0 0 0 5", 3: f"{numbers} 1 0 0 0 0 0 6"}, {}, {})
    problem = read(path)
    expected = dict(zip(ORDER[:count], range(1, count + 1), strict=True))
    values = dict(zip(problem.intrinsic_names, problem.intrinsics[1], strict=True))
    assert {k: v for k, v in values.items() if v} == expected
    assert {
        n for n, f in zip(problem.intrinsic_names, problem.fixed_intrinsics[0], strict=True) if not f
    } == free


@PROPERTY
@given(st.integers(0, 2**32), st.booleans(), st.booleans())
def test_random_problems_survive_writing_and_reading(seed: int, distorted: bool, weighted: bool) -> None:
    names = ORDER if distorted else ORDER[:5]
    problem = random_problem(seed, "perspective", dict.fromkeys(names, 0.7), least=1)
    problem.set_free_intrinsics(*("f", "cx", "cy", "k1", "k2")[: 5 if distorted else 3])
    if weighted and problem.num_observations:
        problem.sigma_px = np.random.default_rng(seed).uniform(0.1, 3, problem.num_observations)
    with tempfile.TemporaryDirectory() as folder, no_warnings():
        write(problem, Path(folder) / "xcams.txt")
        again = read(Path(folder) / "xcams.txt")
    assert_same_problem(again, problem)
    np.testing.assert_array_equal(again.sigma_px, problem.sigma_px)


def test_fixed_intrinsics_go_to_a_calibration_file_of_their_own(tmp_path: Path) -> None:
    original = read(sba_files(tmp_path, {}, {}, {}))
    write(original, tmp_path / "newcams.txt")
    assert (tmp_path / "newcalib.txt").exists()
    assert_same_problem(read(tmp_path / "newcams.txt"), original, intrinsics_rtol=4e-16)


@pytest.mark.parametrize("covariance", ["4 0 4", "4 0 0 4"])
def test_isotropic_covariances_become_standard_deviations(tmp_path: Path, covariance: str) -> None:
    path = sba_files(tmp_path, {}, {2: f"1 2 3 1 0 10 20 {covariance}"}, {})
    np.testing.assert_array_equal(read(path).sigma_px, [2.0])


@pytest.mark.parametrize("covariance", ["4 1 5", "4 1 1 5"])
def test_other_covariances_stay_what_they_are(tmp_path: Path, covariance: str) -> None:
    problem = read(sba_files(tmp_path, {}, {2: f"1 2 3 1 0 10 20 {covariance}"}, {}))
    np.testing.assert_array_equal(problem.covariance_px2, [[[4.0, 1.0], [1.0, 5.0]]])
    assert problem.sigma_px is None
    write(problem, tmp_path / "newcams.txt")
    np.testing.assert_array_equal(read(tmp_path / "newcams.txt").covariance_px2, problem.covariance_px2)


def test_files_can_be_named_one_by_one(tmp_path: Path) -> None:
    path = sba_files(tmp_path, {}, {}, {})
    renamed = [path.rename(tmp_path / "a"), (tmp_path / "3pts.txt").rename(tmp_path / "b")]
    renamed.append((tmp_path / "calib.txt").rename(tmp_path / "c"))
    assert read_sba(*renamed).num_observations == 2


DAMAGE = [
    ("3cams.txt", {2: "1 0 0 0 0 0"}, 2, "holds 6 numbers: must be 7 (pose), 12"),
    ("3cams.txt", {3: "1 0 0 0 0 0"}, 3, "holds 6 numbers: must be 7 as on the first line"),
    ("3cams.txt", {3: "0 0 0 0 1 2 3"}, 3, "the quaternion is zero"),
    ("3cams.txt", {3: "0.9 0.1 0.2 0.3 1.7e308 1.7e308 1.7e308"}, 3, "too large"),
    ("3cams.txt", {3: "1 0 0 zero 1 2 3"}, 3, "'zero' is not a finite number"),
    ("3pts.txt", {2: "1 2 3"}, 2, "holds 3 numbers: must be at least 4"),
    ("3pts.txt", {2: "1 2 3 -1"}, 2, "number of frames -1"),
    ("3pts.txt", {2: "1 2 3 2 0 10 20"}, 2, "holds 7 numbers"),
    ("3pts.txt", {2: f"1 2 3 {'9' * 30} 0 10 20"}, 2, "number of frames"),
    ("3pts.txt", {2: "1 2 3 1 2 10 20"}, 2, "frame 2: must be an integer from 0 to 1"),
    ("3pts.txt", {2: "1 2 3 2 0 10 20 0 30 40"}, 2, "frame 0 observes this point twice"),
    ("3pts.txt", {2: "1 2 3 1 0 10 20 4 5 5"}, 2, "must be positive definite"),
    ("3pts.txt", {2: "1 2 3 1 0 10 20 4 1 2 4"}, 2, "must be symmetric"),
    ("3pts.txt", {4: "4 5 nan 0"}, 4, "nan is not a finite number"),
    ("calib.txt", {1: "800 1"}, 1, "holds 2 numbers: must be 3"),
    ("calib.txt", {2: "0.5 840 240"}, 1, "the calibration matrix must be"),
    ("calib.txt", {1: "0 1 320"}, 1, "aspect ratio 840.0 / 0.0 is not finite"),
    ("calib.txt", {3: "0 0 1\n0 0 1"}, 4, "has 3 lines, not 4"),
]


@pytest.mark.parametrize(("name", "changed", "line", "reason"), DAMAGE)
def test_damage_is_named_with_its_file_and_line(
    tmp_path: Path, name: str, changed: dict[int, str], line: int, reason: str
) -> None:
    parts = [changed if name == n else {} for n in ("3cams.txt", "3pts.txt", "calib.txt")]
    error = refusal(sba_files(tmp_path, *parts))
    assert reason in str(error)
    assert (Path(error.path).name, error.line) == (name, line)


@pytest.mark.parametrize(
    ("missing", "reason"), [("3pts.txt", "points file '3pts.txt'"), ("calib.txt", "'3calib.txt'")]
)
def test_missing_siblings_are_named(tmp_path: Path, missing: str, reason: str) -> None:
    path = sba_files(tmp_path, {}, {}, {})
    (tmp_path / missing).unlink()
    assert reason in str(refusal(path))


def test_a_file_of_comments_alone_is_refused(tmp_path: Path) -> None:
    path = sba_files(tmp_path, {}, {}, {})
    path.write_text("# nothing\n")
    assert "only comments" in str(refusal(path))


def test_problems_without_points_are_refused(tmp_path: Path) -> None:
    problem = read(sba_files(tmp_path, {}, {}, {}))
    problem.points, problem.camera_index = problem.points[:0], problem.camera_index[:0]
    problem.fixed_points = problem.fixed_points[:0]
    problem.point_index, problem.pixels = problem.point_index[:0], problem.pixels[:0]
    with pytest.raises(DatasetError, match="without points"):
        write(problem, tmp_path / "newcams.txt")
