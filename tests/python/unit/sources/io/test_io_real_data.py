"""Real files: the published costs, and nothing lost by writing and reading them again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from io_helpers import (
    assert_same_metadata,
    assert_same_problem,
    assert_same_residuals,
    cost,
    mean_squared_error,
    no_warnings,
)
from sfmcpp.sources.io import convert, read, write

pytestmark = pytest.mark.real

BAL = ["bal/problem-49-7776-pre.txt.bz2", "bal/ladybug-49-shrink-1800.txt"]
BUNDLER = ["kermit/results.example/bundle.out", "kitti_vo/Balbianello.out"]
SBA_ERRORS = {
    "7cams": 19.0947,
    "9cams": 8.17604,
    "54cams": 2.14707,
    "7camsvarK": 19.0947,
    "9camsvarK": 8.17603,
    "54camsvarK": 2.14707,
    "54camsvarKD": 2.14707,
}
SBA = [f"sba_demo/{name}.txt" for name in SBA_ERRORS]
NATIVE = [(n, "x.txt") for n in BAL] + [(n, "x.out") for n in BUNDLER] + [(n, "xcams.txt") for n in SBA]


@pytest.mark.parametrize(("name", "expected"), [(BAL[0], "8.509125e+05"), (BAL[1], "2.345198e+05")])
def test_bal_has_the_published_initial_cost(data_dir: Path, name: str, expected: str) -> None:
    assert f"{cost(read(data_dir / name)):.6e}" == expected


def test_ladybug_has_31_observations_behind_their_cameras(data_dir: Path) -> None:
    problem = read(data_dir / BAL[0])
    poses = problem.cameras[problem.camera_index]
    depth = np.sum((problem.points[problem.point_index] - poses[:, :, 3]) * poses[:, :, 2], axis=1)
    assert np.count_nonzero(depth <= 0) == 31


@pytest.mark.parametrize(("name", "expected"), SBA_ERRORS.items())
def test_sba_has_the_error_its_readme_prints(data_dir: Path, name: str, expected: float) -> None:
    assert f"{mean_squared_error(read(data_dir / f'sba_demo/{name}.txt')):.6g}" == f"{expected:.6g}"


def test_kermit_has_the_error_bundler_reached(data_dir: Path) -> None:
    problem = read(data_dir / BUNDLER[0])
    assert f"{np.sqrt(mean_squared_error(problem)):.2f}" == "0.49"
    assert (problem.num_cameras, problem.num_points) == (9, 634)
    assert np.bincount(problem.camera_index, minlength=9).min() > 0
    registered = problem.metadata.extra["bundler_registered"]
    assert (len(registered), np.count_nonzero(registered)) == (11, 9)


@pytest.mark.parametrize(("name", "target"), NATIVE)
def test_writing_in_its_own_format_keeps_a_real_problem(
    data_dir: Path, tmp_path: Path, name: str, target: str
) -> None:
    original = read(data_dir / name)
    with no_warnings():
        convert(data_dir / name, tmp_path / target)
        again = read(tmp_path / target)
    assert_same_problem(again, original, intrinsics_rtol=4e-16)
    assert_same_metadata(again, original)
    assert_same_residuals(again, original)


@pytest.mark.parametrize("suffix", [".bz2", ".gz", ".xz"])
def test_compressed_bal_holds_the_same_problem(data_dir: Path, tmp_path: Path, suffix: str) -> None:
    original = read(data_dir / BAL[1])
    write(original, tmp_path / f"x.txt{suffix}")
    write(original, tmp_path / "x.txt")
    assert (tmp_path / f"x.txt{suffix}").stat().st_size < (tmp_path / "x.txt").stat().st_size / 2
    again = read(tmp_path / f"x.txt{suffix}")
    assert_same_problem(again, original)
    assert_same_residuals(again, original)


@pytest.mark.parametrize("target", ["b.txt", "b.out", "bcams.txt", "b.npz", "b"])
@pytest.mark.parametrize("name", [BAL[1], *BUNDLER])
def test_every_format_keeps_the_residuals_of_a_radial_camera(
    data_dir: Path, tmp_path: Path, name: str, target: str
) -> None:
    original = read(data_dir / name)
    convert(data_dir / name, tmp_path / target)
    again = read(tmp_path / target)
    np.testing.assert_array_equal(again.camera_index, original.camera_index)
    np.testing.assert_array_equal(again.point_index, original.point_index)
    assert_same_residuals(again, original)


@pytest.mark.parametrize("target", ["bcams.txt", "b.npz", "b"])
@pytest.mark.parametrize("name", [SBA[0], SBA[-1]])
def test_every_format_with_a_principal_point_keeps_the_residuals(
    data_dir: Path, tmp_path: Path, name: str, target: str
) -> None:
    convert(data_dir / name, tmp_path / target)
    assert_same_residuals(read(tmp_path / target), read(data_dir / name))


def test_npz_keeps_real_problems_to_the_last_bit(data_dir: Path, tmp_path: Path) -> None:
    for name in (BAL[1], BUNDLER[0], SBA[0]):
        original = read(data_dir / name)
        write(original, tmp_path / "x.npz")
        again = read(tmp_path / "x.npz")
        assert_same_problem(again, original)
        np.testing.assert_array_equal(again.cameras, original.cameras)
        assert_same_metadata(again, original)
