"""Two real blocks of the folder of data as problems that BAL can hold, for `whole_set.py`.

Both come as tracks and poses without points: these are triangulated, and tracks of which an observation is
far off are left out. BAL gives every image its own focal length and distortion, so this is not the adjustment
of the sources.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from sfmcpp import Problem, write
from sfmcpp.geometry import reprojection_errors_px, triangulate_midpoint
from sfmcpp.sources.io.image_tracks import read_image_tracks

FloatArray = NDArray[np.float64]
# From a camera that looks along −z with y up to one that looks along z with y down.
_TURNED = np.diag([1.0, -1.0, -1.0])


def real_block_files(data: Path, folder: Path) -> list[Path]:
    """BAL files of the blocks that the data have, made once."""
    found = [(folder / f"{name}.txt", block, data / source) for name, (source, block) in BLOCKS.items()]
    there = [(path, block, source) for path, block, source in found if source.is_dir()]
    folder.mkdir(parents=True, exist_ok=True)
    for path, block, source in there:
        if not path.exists():
            write(block(source), path)
    return [path for path, _, _ in there]


def roma(folder: Path) -> Problem:
    """DBAT's Roma: 60 photos with rough orientations (ω, φ, κ in degrees) and a camera calibrated in mm."""
    orientation = np.loadtxt(folder / "prior" / "initial_eo.txt", delimiter=",")
    image, point, x, y = np.loadtxt(folder / "measurements" / "markpts.txt", delimiter=",").T
    px_per_mm, focal_mm, k1_per_mm2 = 3744 / 24.0, 24.3581, 2.174e-4
    pixels = np.stack([x, y], axis=1) - px_per_mm * np.array([18.1143, 12.0])
    rotations = Rotation.from_euler("XYZ", orientation[:, 4:7], degrees=True).as_matrix() @ _TURNED
    return _block(
        _poses(rotations, orientation[:, 1:4]),
        np.array([px_per_mm * focal_mm, -k1_per_mm2 * focal_mm**2, 0.0]),
        np.searchsorted(orientation[:, 0], image),
        point,
        pixels,
        max_error_px=200.0,
    )


def malaga(folder: Path) -> Problem:
    """Malaga PARKING-6L, a loop of 170 images with poses (angles about z, y, x in radians, centre)."""
    tracks = read_image_tracks(folder / "Malaga")
    given = loadmat(folder / "Malaga" / "GT_P0_PA.mat")["GT_P0"]
    calibration = np.loadtxt(folder / "calSBA_malaga.txt")
    return _block(
        _poses(Rotation.from_euler("ZYX", given[:, :3]).as_matrix(), given[:, 3:]),
        np.array([calibration[[0, 1], [0, 1]].mean(), 0.0, 0.0]),
        tracks.image_index,
        tracks.track_index,
        tracks.pixels - calibration[:2, 2],
        max_error_px=50.0,
    )


BLOCKS: dict[str, tuple[str, Callable[[Path], Problem]]] = {
    "roma": ("dbat_roma", roma),
    "malaga": ("malaga", malaga),
}


def _poses(rotations: FloatArray, centres: FloatArray) -> FloatArray:
    return np.concatenate([rotations, centres[:, :, None]], axis=2)


def _block(
    poses: FloatArray,
    intrinsics: FloatArray,
    camera_index: NDArray[np.integer],
    track: NDArray[np.generic],
    pixels: FloatArray,
    max_error_px: float,
) -> Problem:
    numbers, point_index = np.unique(track, return_inverse=True)
    block = Problem(
        "bal",
        poses,
        np.tile(intrinsics, (len(poses), 1)),
        np.zeros((len(numbers), 3)),
        camera_index.astype(np.int32),
        point_index.astype(np.int32),
        pixels,
    )
    block.points[:] = triangulate_midpoint(block)
    far = ~(reprojection_errors_px(block, block.points) <= max_error_px)
    return block.with_points(np.bincount(block.point_index, far, minlength=block.num_points) == 0)
