"""Point ids of COLMAP models have 64 bits: text holds them exactly; errors name what stands there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from io_helpers import refusal
from sfmcpp.sources.io import read, write

LARGEST = 2**62


def model(folder: Path, first: str, second: str, seen: str | None = None) -> Path:
    """Two images of two points, which the ids in points3D.txt call `first` and `second`."""
    seen = first if seen is None else seen
    texts = {
        "cameras": "1 PINHOLE 640 480 500 500 320 240\n",
        "images": f"1 1 0 0 0 0 0 5 1 a.jpg\n10 20 {seen} 30 40 {second}\n"
        f"2 1 0 0 0 1 0 5 1 b.jpg\n50 60 {first} 70 80 {second}\n",
        "points3D": f"# of 64 bits\n{first} 1 2 3 255 0 7 0.5 1 0 2 0\n{second} 1 2 4 255 0 7 0.5 1 1 2 1\n",
    }
    for name, text in texts.items():
        (folder / f"{name}.txt").write_text(text)
    return folder


@pytest.mark.parametrize("format", ["colmap-text", "colmap-binary"])
@pytest.mark.parametrize("first", [2**53 - 1, 2**53, 2**53 + 1, 10**18 + 1, LARGEST])
def test_ids_beyond_those_of_floats_are_exact(tmp_path: Path, first: int, format: str) -> None:
    (tmp_path / "of").mkdir()
    problem = read(model(tmp_path / "of", str(first), str(first - 1)))
    np.testing.assert_array_equal(problem.metadata.extra["colmap_point_ids"], [first, first - 1])
    np.testing.assert_array_equal(problem.point_index, [0, 0, 1, 1])
    write(problem, tmp_path / "again", format=format)
    again = read(tmp_path / "again").metadata.extra["colmap_point_ids"]
    np.testing.assert_array_equal(again, [first, first - 1])


def test_a_keypoint_of_a_point_whose_id_is_one_less_is_refused(tmp_path: Path) -> None:
    error = refusal(model(tmp_path, str(2**53), "7", seen=str(2**53 + 1)))
    assert "points3D.txt:2: its track has a keypoint that the image gives to another point" in str(error)


@pytest.mark.parametrize("word", [str(LARGEST + 1), str(2**63), str(2**64 - 2), "1e19", "-9007199254740993"])
def test_ids_out_of_range_are_named_as_they_stand(tmp_path: Path, word: str) -> None:
    error = refusal(model(tmp_path, "1", word))
    told = str(int(float(word))) if "e" in word else word
    assert f"id of a keypoint {told}: must be an integer from -1 to {LARGEST}" in str(error)
    assert "images.txt:2" in str(error)
