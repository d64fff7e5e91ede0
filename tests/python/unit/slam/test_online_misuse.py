"""What a loop of one's own can hand over wrongly is refused, with its name."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.frames import Frame, View
from sfmcpp.slam import Slam
from slam_helpers import INTRINSICS

VIEW = View(np.arange(3, dtype=np.int32), np.zeros((3, 2)))


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ([707.0, 707.0, 601.0, 183.0, 0.0], "aspect = 707: must be f, aspect, cx, cy, skew"),
        ([-500.0, 1.0, 320.0, 240.0, 0.0], "f = -500"),
        ([500.0, 1.0, np.inf, 240.0, 0.0], "intrinsics"),
        ([500.0, 320.0, 240.0], "3 numbers, must be 5, or 12 with distortion"),
    ],
)
def test_intrinsics_in_another_order_are_refused(row: list[float], told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        Slam(np.array(row))


def test_a_frame_must_come_after_the_one_before() -> None:
    slam = Slam(INTRINSICS)
    slam.step(Frame(4, 1.0, VIEW))
    for number in (4, 3):
        with pytest.raises(InvalidArgument, match=rf"frame\.number = {number}: must be above 4"):
            slam.step(Frame(number, 1.1, VIEW))
    for t_s in (1.0, 0.9, np.nan):
        with pytest.raises(InvalidArgument, match=r"frame 5: t_s = .* must be after 1 s, that of 4"):
            slam.step(Frame(5, t_s, VIEW))
    slam.step(Frame(5, 1.1, VIEW))
    assert list(slam.result.path.times) == [4, 5]


def test_no_frame_comes_after_the_end() -> None:
    slam = Slam(INTRINSICS)
    slam.step(Frame(0, 0.0, VIEW))
    slam.finish()
    with pytest.raises(InvalidArgument, match=r"frame 1: comes after finish\(\)"):
        slam.step(Frame(1, 1.0, VIEW))
