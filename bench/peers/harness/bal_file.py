"""The BAL file and its cost in NumPy: read once more, apart from every solver, to check what each claims.

Camera (9): angle-axis, translation, f, k1, k2. With P = R X + t and p = −P.xy / P.z the residual is
f (1 + k1 |p|² + k2 |p|⁴) p − observed [px]; the camera looks along −z, so P.z < 0 is in front of it.
"""

from __future__ import annotations

import bz2
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]


@dataclass
class BalProblem:
    """Observations (M) and initial cameras (C, 9) and points (N, 3) of a BAL file."""

    camera_index: IndexArray
    point_index: IndexArray
    pixels: FloatArray
    cameras: FloatArray
    points: FloatArray


@dataclass
class State:
    """Cameras and points of any solver, in BAL's frames.

    Attributes
    ----------
    rotations, translations : (C, 3, 3), (C, 3) float64
        camera_from_world, the camera looking along −z with y up.
    intrinsics : (C, 3) float64
        f [px], k1, k2.
    points : (N, 3) float64
        World points.
    """

    rotations: FloatArray
    translations: FloatArray
    intrinsics: FloatArray
    points: FloatArray

    @classmethod
    def from_parameters(cls, cameras: FloatArray, points: FloatArray) -> State:
        """From BAL's own nine parameters a camera."""
        return cls(rotation_matrices(cameras[:, :3]), cameras[:, 3:6], cameras[:, 6:], points)

    @classmethod
    def load(cls, path: Path) -> State:
        """Read what :meth:`save` wrote."""
        with np.load(path) as arrays:
            return cls(**arrays)

    def save(self, path: Path) -> None:
        """Write as NPZ."""
        np.savez(path, **vars(self))


def plain_copy(path: Path, folder: Path) -> Path:
    """The file itself if it is BAL text, else a copy in `folder`: decompressed, or converted by sfmcpp.

    Converted files lose what BAL does not hold (masks, standard deviations); a principal point is subtracted
    from the pixels. All solvers, sfmcpp too, then read the same text.
    """
    if path.suffix == ".txt" and path.is_file():
        return path
    if path.suffixes[-2:] == [".txt", ".bz2"]:
        copy = folder / path.stem
        with bz2.open(path) as source, copy.open("wb") as target:
            shutil.copyfileobj(source, target)
        return copy
    import sfmcpp

    copy = folder / f"{path.name.split('.')[0]}.txt"
    sfmcpp.write(sfmcpp.read(path), copy)
    return copy


def read_bal(path: Path) -> BalProblem:
    """Read a plain-text BAL file.

    Raises
    ------
    ValueError
        If the file does not hold as many numbers as its header says.
    """
    numbers = np.array(path.read_text().split(), dtype=np.float64)
    if len(numbers) < 3:
        raise ValueError(f"{path}:1: the header must be three counts: cameras, points, observations")
    num_cameras, num_points, num_observations = (int(n) for n in numbers[:3])
    sizes = np.array([3, 4 * num_observations, 9 * num_cameras, 3 * num_points])
    if len(numbers) != sizes.sum():
        raise ValueError(f"{path}: {len(numbers)} numbers, the header asks for {sizes.sum()}")
    _, observations, cameras, points = np.split(numbers, np.cumsum(sizes)[:-1])
    columns = observations.reshape(-1, 4)
    return BalProblem(
        camera_index=columns[:, 0].astype(np.int64),
        point_index=columns[:, 1].astype(np.int64),
        pixels=columns[:, 2:].copy(),
        cameras=cameras.reshape(-1, 9).copy(),
        points=points.reshape(-1, 3).copy(),
    )


def rotation_matrices(angle_axis: FloatArray) -> FloatArray:
    """Rodrigues' formula: (C, 3) angle-axis vectors [rad] to (C, 3, 3) matrices."""
    angle = np.linalg.norm(angle_axis, axis=1)[:, None, None]
    cross = cross_matrices(angle_axis)
    linear = np.sinc(angle / np.pi)
    quadratic = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.asarray(np.eye(3) + linear * cross + quadratic * (cross @ cross))


def cross_matrices(vectors: FloatArray) -> FloatArray:
    """(C, 3) vectors to (C, 3, 3) matrices [v]× with [v]× u = v × u."""
    matrices = np.zeros((len(vectors), 3, 3))
    for row, column, component, sign in ((0, 1, 2, -1), (0, 2, 1, 1), (1, 2, 0, -1)):
        matrices[:, row, column] = sign * vectors[:, component]
        matrices[:, column, row] = -sign * vectors[:, component]
    return matrices


def points_in_cameras(problem: BalProblem, state: State) -> FloatArray:
    """(M, 3): each observed point in the frame of the camera that sees it."""
    rotated = np.einsum(
        "mij,mj->mi", state.rotations[problem.camera_index], state.points[problem.point_index]
    )
    return np.asarray(rotated + state.translations[problem.camera_index])


def residuals_px(problem: BalProblem, state: State) -> FloatArray:
    """(M, 2): projected minus observed [px], by the formula also behind the camera."""
    local = points_in_cameras(problem, state)
    image = -local[:, :2] / local[:, 2:]
    r2 = np.sum(image**2, axis=1)
    focal, k1, k2 = state.intrinsics[problem.camera_index].T
    return np.asarray((focal * (1.0 + r2 * (k1 + k2 * r2)))[:, None] * image - problem.pixels)


def cost(problem: BalProblem, state: State, only_in_front: bool) -> float:
    """½ Σ‖r‖² over all observations, or over those in front of their camera."""
    squared = np.sum(residuals_px(problem, state) ** 2, axis=1)
    if only_in_front:
        squared = squared[points_in_cameras(problem, state)[:, 2] < 0.0]
    return 0.5 * float(np.sum(squared))


def count_behind(problem: BalProblem, state: State) -> int:
    """How many observed points lie behind the camera that sees them."""
    return int(np.count_nonzero(points_in_cameras(problem, state)[:, 2] >= 0.0))
