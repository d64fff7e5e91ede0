"""The real problems, and the Dinosaur, whose points have to be triangulated first."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import sfmcpp
from experiments.description import ExperimentError
from sfmcpp import Problem

_REPOSITORY = Path(__file__).resolve().parents[2]
_DINOSAUR_TRACKS = "viff.xy"
_DINOSAUR_CAMERAS = "dino_Ps.mat"


def data_folder() -> Path:
    """Folder of real data: `$SFMCPP_DATA`, or `shared/data` beside the repository."""
    path = Path(os.environ.get("SFMCPP_DATA", _REPOSITORY.parent / "shared" / "data"))
    if not path.is_dir():
        raise ExperimentError(f"real data not found at {path}: set SFMCPP_DATA")
    return path


def problem_name(file: str) -> str:
    """Name of the problem in a file."""
    path = Path(file)
    return "dinosaur" if path.name == _DINOSAUR_TRACKS else path.name.partition(".")[0]


def read_real_problem(file: str) -> Problem:
    """Read a problem from a file relative to the folder of real data."""
    path = data_folder() / file
    return _dinosaur(path.parent) if path.name == _DINOSAUR_TRACKS else sfmcpp.read(path)


def _dinosaur(folder: Path) -> Problem:
    """Oxford's Dinosaur: given projection matrices, points by linear triangulation from all their views."""
    from scipy.io import loadmat  # the one experiment that reads a .mat file

    tracks = np.loadtxt(folder / _DINOSAUR_TRACKS).reshape(-1, 36, 2)
    cameras = np.stack(list(loadmat(folder / _DINOSAUR_CAMERAS)["P"][0])).astype(np.float64)
    point_index, camera_index = np.nonzero((tracks != -1).all(axis=2))
    pixels = tracks[point_index, camera_index]
    unknown = np.ones((len(tracks), 4))
    problem = sfmcpp.projective_problem(cameras, unknown, camera_index, point_index, pixels)
    problem.points[:] = _triangulate(problem)
    return problem


def _triangulate(problem: Problem) -> NDArray[np.float64]:
    """(N, 4) unit points of least ‖A X‖ (Hartley & Zisserman 2003, §12.2).

    Each observation gives A the rows ``x p₃ − p₁``, ``y p₃ − p₂`` in the frame of its image.
    """
    scale, *centre = problem.intrinsics[problem.camera_index].T
    frame_pixels = (problem.pixels - np.stack(centre, axis=1)) / scale[:, None]
    matrices = problem.cameras.reshape(-1, 3, 4)[problem.camera_index]
    rows = frame_pixels[:, :, None] * matrices[:, 2:] - matrices[:, :2]
    squares = np.zeros((problem.num_points, 4, 4))
    np.add.at(squares, problem.point_index, np.swapaxes(rows, 1, 2) @ rows)
    points: NDArray[np.float64] = np.linalg.eigh(squares)[1][:, :, 0]
    return points
