"""Programs of users pass strict type checks where they give what the documentation allows."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[3]

PROGRAM = """
import numpy as np
from numpy.typing import NDArray
import sfmcpp
from sfmcpp import slam
from sfmcpp.geometry import Similarity
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.sensors import Mounting

cameras = np.tile(np.eye(3, 4), (2, 1, 1))
camera, point = np.divmod(np.arange(40), 20)
problem = sfmcpp.Problem(
    "calibrated", cameras, [[500, 1, 320, 240, 0]], np.zeros((20, 3)), camera, point, np.zeros((40, 2)),
    intrinsics_index=[0, 0], sigma_px=np.ones(40), fixed_cameras=[True, False],
    rigs=sfmcpp.Rigs(np.eye(3, 4)[None], [0, 1], [0, 0], free_sensors=[False]),
)
points: NDArray[np.float64] = problem.points
sigmas: NDArray[np.float64] | None = problem.sigma_px
gps = sfmcpp.ConstraintGroup("position", np.arange(2), [[0, 0, 0], [1, 0, 0]], sigma=[0.1, 0.2])
own = sfmcpp.ResidualGroup(lambda poses: poses[:, 2, 3:], range(2), member_weights=[1, 2])
near = sfmcpp.ResidualGroup(lambda places: places, points=[3, 4])
sfmcpp.solve(problem, constraints=[gps, own, near])
Similarity(2.0, np.eye(3), [0, 0, 1])
Mounting([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, 1])
SensorStream([0, 1], [[2], [3]], "speed")
Trajectory(range(2), cameras)
robot = slam.Slam([500, 1, 320, 240, 0])
robot.feed("odometer", [0.0, 0.1], [1, 2])
robot.step(slam.Frame(0, 0.0, slam.View(np.arange(2), [[1, 2], [3, 4]])))
tracks: NDArray[np.int32] = slam.View([0], [[1, 2]]).tracks
sfmcpp.CameraFunction(lambda places, row: row[:, :1] * places[:, :2], ["f"], free_by_default=["f"])
"""
WRONG = 'sfmcpp.ConstraintGroup("position", object(), None, sigma="much", weight="auto")\n'


def checked(program: str, folder: Path) -> str:
    path = folder / "program.py"
    path.write_text(program, encoding="utf-8")
    # As users have it, installed: of files there mypy reads what they declare, and no bodies of functions.
    cache = REPOSITORY / ".mypy_cache/users"  # beside that of the package, which may be in use
    flags = ("--strict", "--no-error-summary", f"--cache-dir={cache}")
    command = [sys.executable, "-m", "mypy", *flags, str(path)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


def test_arrays_lists_and_whole_numbers_are_accepted_and_nothing_else(tmp_path: Path) -> None:
    pytest.importorskip("mypy", reason="mypy is not installed")
    found = checked(PROGRAM + WRONG, tmp_path).splitlines()
    line = PROGRAM.count("\n") + 1
    assert [text for text in found if f"program.py:{line}: " not in text] == []
    assert len(found) == 2, found  # of the cameras and of the weight: any text may be an array
