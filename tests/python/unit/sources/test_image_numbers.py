"""Images of a folder that are missing by their numbers, where their times are counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp.sources.frame_times import doubt_of_numbers, times_of_images
from sfmcpp.sources.vision import open_frames

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")


def names(numbers: list[int], form: str = "frame_{:04d}.png") -> list[str]:
    return [form.format(number) for number in numbers]


@pytest.mark.parametrize("numbers", [[0, 1, 2, 5, 6, 7], [10, 12, 14, 20, 22, 24], [1, 2, 3, 4, 5, 7, 8]])
@pytest.mark.parametrize("form", ["{:06d}.jpg", "cam2_{:03d}.png", "{}.png"])
def test_images_that_are_missing_are_told(numbers: list[int], form: str) -> None:
    told = doubt_of_numbers(names(numbers, form))
    k = int(np.argmax(np.diff(numbers)))
    between = f"from {form.format(numbers[k])} to {form.format(numbers[k + 1])} by their numbers"
    assert told is not None
    assert between in told


@pytest.mark.parametrize(
    "found",
    [
        [],
        names([0, 1, 2, 3, 4]),
        names([5, 10, 15, 20]),
        names([1, 2, 9]),
        names([1, 5, 6, 20, 21, 40, 77]),
        ["a.png", "b.png", "c.png", "d.png", "e.png"],
        ["a1.png", "b1.png", "c1.png", "d1.png", "e1.png"],
    ],
)
def test_even_numbers_and_names_that_are_none_are_not_doubted(found: list[str]) -> None:
    assert doubt_of_numbers(found) is None


def test_they_are_doubted_where_images_are_counted_and_nowhere_else(tmp_path: Path) -> None:
    for name in names([0, 1, 2, 3, 7, 8, 9, 10]):
        cv2.imwrite(str(tmp_path / name), np.zeros((4, 4), np.uint8))
    for fps, stamps in ((None, None), (25.0, None), (None, np.arange(20.0))):
        _, _, doubt = times_of_images(open_frames(tmp_path), fps, stamps)
        assert doubt is not None
        assert "from frame_0003.png to frame_0007.png" in doubt
    (tmp_path / "times.txt").write_text("".join(f"{k}\n" for k in range(8)))
    _, _, doubt = times_of_images(open_frames(tmp_path), None, None)
    assert doubt is None
