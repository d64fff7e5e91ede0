"""A trajectory refuses what cannot be one."""

from __future__ import annotations

import numpy as np
import pytest

from sensor_helpers import random_poses
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Trajectory


@pytest.mark.parametrize(
    ("t_s", "change", "told"),
    [
        ([0.0, 1.0, 1.0], None, r"t_s\[2\] = 1.0 s is a duplicate"),
        ([0.0, 2.0, 1.0], None, r"t_s\[2\] = 1.0 s is earlier"),
        ([0.0, 1.0, 2.0], (1, 0, 0, np.nan), r"poses\[1, 0, 0\] = nan"),
        ([0.0, 1.0, 2.0], (1, 0, 0, 5.0), r"poses\[1\]: its first three columns are no rotation"),
        ([0.0, 1.0], None, "poses: shape"),
    ],
)
def test_an_impossible_trajectory_is_refused(
    t_s: list[float], change: tuple[int, int, int, float] | None, told: str
) -> None:
    poses = random_poses(np.random.default_rng(0), 3)
    if change is not None:
        poses[change[:3]] = change[3]
    with pytest.raises(InvalidArgument, match=told):
        Trajectory(np.array(t_s), poses)
