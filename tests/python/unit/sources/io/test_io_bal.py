"""BAL: conventions, exact round trips, and the line of every kind of damage."""

from __future__ import annotations

import tempfile
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from io_helpers import PROPERTY, assert_same_problem, cost, no_warnings, random_problem, refusal
from sfmcpp import DatasetError, Problem
from sfmcpp.sources.io import read, text_pieces, write

# Two cameras, two points, three observations on lines 2 to 4; cameras on 5 to 22, points on 23 to 28.
HEADER = ["2 2 3"]
OBSERVATIONS = ["0 0 1.5 -2.5", "1 0 3 4", "1 1 -5 6e-1"]
CAMERAS = [
    "0.1 0.2 0.3 1 2 -30 500 0.01 -0.001".replace(" ", "\n"),
    "0 0 0 0 0 -9 400 0 0".replace(" ", "\n"),
]
POINTS = ["1\n2\n3", "-1\n-2\n-3"]
LINES = "\n".join(HEADER + OBSERVATIONS + CAMERAS + POINTS).split("\n")


def bal_file(folder: Path, **changed: str) -> Path:
    """Write the small file with some lines, ``line7="…"``, replaced."""
    lines = list(LINES)
    for key, text in changed.items():
        lines[int(key.removeprefix("line")) - 1] = text
    path = folder / "small.txt"
    path.write_text("\n".join(lines) + "\n")
    return path


def projected_by_the_definition(camera: list[float], point: list[float]) -> np.ndarray:
    """Project as the BAL page defines it, with Rodrigues' formula term by term."""
    w, t, (f, k1, k2) = np.array(camera[:3]), np.array(camera[3:6]), camera[6:]
    angle = np.linalg.norm(w)
    k, x = w / angle, np.array(point)
    rotated = x * np.cos(angle) + np.cross(k, x) * np.sin(angle) + k * (k @ x) * (1 - np.cos(angle))
    in_camera = rotated + t
    p = -in_camera[:2] / in_camera[2]
    r2 = p @ p
    return f * (1 + k1 * r2 + k2 * r2**2) * p


def test_cost_is_that_of_the_definition(tmp_path: Path) -> None:
    camera, point = [0.1, 0.2, 0.3, 1.0, 2.0, -30.0, 500.0, 0.01, -0.001], [1.0, 2.0, 3.0]
    path = tmp_path / "one.txt"
    numbers = "\n".join(map(repr, [*camera, *point]))
    path.write_text(f"1 1 1\n0 0 7.5 -11.25\n{numbers}\n")
    expected = projected_by_the_definition(camera, point) - [7.5, -11.25]
    assert cost(read(path)) == pytest.approx(0.5 * expected @ expected, rel=1e-13)


def test_the_layout_that_gtsam_writes_is_read(tmp_path: Path) -> None:
    """Blank lines after the header and about the cameras, observations by point, twenty digits (4.3.0)."""
    numbers = [f"{float(x):.20g}" for block in CAMERAS + POINTS for x in block.split()]
    blocks = [numbers[at : at + 9] for at in (0, 9)] + [numbers[18:21], numbers[21:]]
    text = [*HEADER, "", *OBSERVATIONS, "", *("\n".join(block) + "\n" for block in blocks)]
    path = tmp_path / "gtsam.txt"
    path.write_text("\n".join(text))
    assert_same_problem(read(path), read(bal_file(tmp_path)))


def test_everything_is_free(tmp_path: Path) -> None:
    problem = read(bal_file(tmp_path))
    assert not problem.fixed_intrinsics.any()
    assert not problem.fixed_cameras.any()
    assert not problem.fixed_points.any()


@PROPERTY
@given(st.integers(0, 2**32), st.sampled_from(["", ".gz", ".bz2", ".xz"]))
def test_random_problems_survive_writing_and_reading(seed: int, suffix: str) -> None:
    problem = random_problem(seed, "bal", {"f": 900, "k1": 0.2, "k2": 0.1})
    with tempfile.TemporaryDirectory() as folder, no_warnings():
        path = Path(folder) / f"x.txt{suffix}"
        write(problem, path)
        assert_same_problem(read(path), problem)


def test_principal_point_moves_into_the_pixels(tmp_path: Path) -> None:
    problem = random_problem(7, "perspective", {"f": 900, "cx": 320, "cy": 240, "k1": 0.1}, least=3)
    problem.pixels[:] = np.random.default_rng(8).uniform(0, 640, problem.pixels.shape)
    write(problem, tmp_path / "x.txt")
    assert cost(read(tmp_path / "x.txt")) == pytest.approx(cost(problem), rel=1e-9)


@pytest.mark.parametrize("name", ["aspect", "skew", "k3", "p1"])
def test_intrinsics_without_a_place_are_refused_by_name(tmp_path: Path, name: str) -> None:
    problem = random_problem(7, "perspective", {"f": 900, name: 0.5}, least=3)
    with pytest.raises(DatasetError, match=rf"{name} = \S+ cannot be kept in BAL"):
        write(problem, tmp_path / "x.txt")
    assert list(tmp_path.iterdir()) == []


DAMAGE = [
    ({"line1": "2 2"}, 18, "trailing garbage: 2 cameras, 2 points, 0 observations"),
    ({"line1": "-2 2 3"}, 1, "number of cameras -2: must be an integer from 0"),
    ({"line1": "2 2.5 3"}, 1, "points 2.5: must be an integer .*; a BAL file begins with three counts"),
    ({"line1": "2 2 " + "9" * 30}, 1, "number of observations 1e\\+30|number of observations 9\\.9+"),
    ({"line1": "2 2 2000000000"}, 28, "truncated: .* the file has 39"),
    ({"line1": "2 2 2"}, 25, "trailing garbage: .* take 35 numbers, the file has 39"),
    ({"line3": "2 0 3 4"}, 3, "camera index 2: must be an integer from 0 to 1"),
    ({"line3": "-1 0 3 4"}, 3, "camera index -1"),
    ({"line4": "1 2 -5 6"}, 4, "point index 2: must be an integer from 0 to 1"),
    ({"line4": "1 0.5 -5 6"}, 4, "point index 0.5: must be an integer"),
    ({"line4": "1 0 7 8"}, 4, "same point by the same camera as line 3"),
    ({"line2": "0 0 nan -2.5"}, 2, "nan is not a finite number"),
    ({"line2": "0 0 1.5 -inf"}, 2, "-inf is not a finite number"),
    ({"line12": "1e999"}, 12, "inf is not a finite number"),
    ({"line12": "50x"}, 12, "'50x' is not a finite number"),
    ({"line12": "1-2"}, 12, "'1-2' is not a finite number"),
    ({"line12": "1_0"}, 12, "'1_0' is not a finite number"),
    ({"line12": "1.5e"}, 12, "'1.5e' is not a finite number"),
    ({"line12": "\0"}, 12, "not a finite number"),
    ({"line12": "é"}, 12, "is not a finite number"),
    ({"line5": "1e308", "line6": "1.7e308"}, 5, "camera 0: the numbers of its pose are too large"),
    ({"line28": "-3\n1"}, 29, "trailing garbage"),
    ({"line28": "-3\nend"}, 29, "'end' is not a finite number"),
    ({"line28": ""}, 27, "truncated"),
]


@pytest.mark.parametrize(("changed", "line", "reason"), DAMAGE)
def test_damage_is_named_with_its_line(
    tmp_path: Path, changed: dict[str, str], line: int, reason: str
) -> None:
    error = refusal(bal_file(tmp_path, **changed))
    assert error.line == line
    with pytest.raises(DatasetError, match=reason):
        raise error


@pytest.mark.parametrize("size", [1, 7, 50])
def test_pieces_of_the_text_change_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    problem = random_problem(3, "bal", {"f": 900, "k1": 0.2, "k2": 0.1}, least=3)
    write(problem, tmp_path / "x.txt")
    whole = read(tmp_path / "x.txt")
    errors = [(changed, refusal(bal_file(tmp_path, **changed))) for changed, *_ in DAMAGE]
    monkeypatch.setattr(text_pieces, "_PIECE_BYTES", size)
    monkeypatch.setattr(text_pieces, "_CHUNK_BYTES", 1 + size // 3)
    assert_same_problem(read(tmp_path / "x.txt"), whole)
    for changed, error in errors:
        assert str(refusal(bal_file(tmp_path, **changed))) == str(error)


def test_counts_that_the_file_cannot_hold_take_no_memory(tmp_path: Path) -> None:
    path = bal_file(tmp_path, line1="2000000000 2000000000 2000000000")
    tracemalloc.start()
    error = refusal(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert "truncated" in str(error)
    assert peak < 1e6


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "the file is empty"),
        (b" \n \n", "header needs three counts"),
        (b"1 2\n", "header needs three counts"),
    ],
)
def test_files_without_a_header_are_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    path = tmp_path / "x.txt"
    path.write_bytes(content)
    assert reason in str(refusal(path))


def test_cameras_and_points_without_observations_are_legal(tmp_path: Path) -> None:
    path = bal_file(tmp_path, line1="2 2 0", line2="", line3="", line4="")
    problem = read(path)
    assert (problem.num_cameras, problem.num_points, problem.num_observations) == (2, 2, 0)


def test_line_structure_does_not_matter(tmp_path: Path) -> None:
    path = tmp_path / "flat.txt"
    path.write_bytes(b"\r\n\t ".join(" ".join(LINES).encode().split()))
    assert_same_problem(read(path), read(bal_file(tmp_path)))


@pytest.mark.parametrize("name", ["cameras", "points", "pixels", "intrinsics"])
def test_what_is_not_finite_is_not_written(tmp_path: Path, name: str) -> None:
    problem: Problem = read(bal_file(tmp_path))
    getattr(problem, name).flat[-1] = np.nan
    before = sorted(tmp_path.iterdir())
    with pytest.raises(DatasetError, match=rf"{name}\[\d.*\] is nan: must be finite"):
        write(problem, tmp_path / "x.txt")
    assert sorted(tmp_path.iterdir()) == before
