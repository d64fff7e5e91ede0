"""Small images of a stereo pair that drives between two walls towards a third, with the truth."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.geometry.pinhole import homogeneous, to_normalised

SIZE = 256, 192
RECTIFIED = np.array([180.0, 1.0, 127.5, 95.5, 0.0])
BASELINE_M = 0.4
BESIDE = np.column_stack([np.eye(3), [BASELINE_M, 0.0, 0.0]])
# Two lenses that distort, the right one turned by two degrees: a pair as that of EuRoC.
LENSES = (
    np.array([160.0, 1.0, 124.0, 97.0, 0.0, -0.25, 0.06, 0.0, 0.0, 0.0, 0.0005, -0.0003]),
    np.array([164.0, 0.99, 131.0, 93.0, 0.0, -0.24, 0.05, 0.0, 0.0, 0.0, -0.0004, 0.0002]),
)
TURNED = np.column_stack(
    [so3.rotation_from_angle_axis(np.radians([[1.2, -1.0, 1.3]]))[0], [BASELINE_M, 0.012, -0.02]]
)
# Normal and offset of each wall: n · p = d.
_WALLS = (((1.0, 0.0, 0.1), 2.5), ((-1.0, 0.0, 0.1), 2.5), ((0.0, 1.0, 0.0), 1.4), ((0.2, 0.1, 1.0), 14.0))
_TEXELS, _PER_M = 1024, 40.0


def way(count: int, step_m: float = 0.15) -> np.ndarray:
    """Poses (n, 3, 4) of the left camera, world_from_camera."""
    k = np.arange(count)
    turns = so3.rotation_from_angle_axis(np.outer(0.01 * k, [0.1, 1.0, 0.0]))
    centres = np.column_stack([0.02 * k, 0.005 * k, step_m * k])
    return np.concatenate([turns, centres[:, :, None]], axis=2)


def beside(poses: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Poses of the right camera, left_from_right being `pose`."""
    return np.concatenate([poses[:, :, :3] @ pose[:, :3], poses[:, :, :3] @ pose[:, 3:] + poses[:, :, 3:]], 2)


def depths(pose: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Depth of what rays (n, 2) of a camera meet first, and the number of its wall."""
    directions = homogeneous(rays) @ pose[:, :3].T
    with np.errstate(divide="ignore"):
        met = np.array([(d - np.dot(n, pose[:, 3])) / (directions @ n) for n, d in _WALLS])
    met[met <= 0] = np.inf
    return met.min(axis=0), met.argmin(axis=0)


def picture(pose: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """What a camera sees, (height, width) uint8."""
    pixels = np.stack(np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1])), axis=-1).reshape(-1, 2) * 1.0
    rays = to_normalised(pixels, intrinsics)
    depth, wall = depths(pose, rays)
    points = (homogeneous(rays) * depth[:, None]) @ pose[:, :3].T + pose[:, 3]
    image = np.zeros(SIZE[::-1], np.float32)
    for number, (normal, _) in enumerate(_WALLS):
        axes = np.delete(np.arange(3), int(np.argmax(np.abs(normal))))
        at = (_PER_M * points[:, axes] % (_TEXELS - 1)).astype(np.float32).reshape(*image.shape, 2)
        seen = cv2.remap(_texture(number), at, None, cv2.INTER_LINEAR)
        image = np.where((wall == number).reshape(image.shape), seen, image)
    return np.rint(image).astype(np.uint8)


@cache
def _texture(seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(0, 256, (_TEXELS, _TEXELS)).astype(np.float32)
    return np.asarray(cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2.0), None, 0, 255, cv2.NORM_MINMAX))


def write_pictures(
    folder: Path, poses: np.ndarray, intrinsics: np.ndarray, names: Sequence[str] = ()
) -> Path:
    """Write what a camera sees at its poses, by default as ``000000.png`` and so on."""
    folder.mkdir(parents=True)
    for number, pose in enumerate(poses):
        name = names[number] if names else f"{number:06d}.png"
        assert cv2.imwrite(str(folder / name), picture(pose, intrinsics))
    return folder


def write_rectified(place: Path, count: int) -> np.ndarray:
    """Write ``image_0``, ``image_1`` and KITTI's ``calib.txt`` into a folder; the left poses."""
    poses = way(count)
    write_pictures(place / "image_0", poses, RECTIFIED)
    write_pictures(place / "image_1", beside(poses, BESIDE), RECTIFIED)
    (place / "calib.txt").write_text(calib())
    return poses


def calib(names: Sequence[str] = ("P0: ", "P1: "), baselines_m: Sequence[float] = (0.0, BASELINE_M)) -> str:
    """Text of a ``calib.txt`` with these matrices."""
    f, _, cx, cy, _ = RECTIFIED
    rows = [f"{f} 0 {cx} {-f * b} 0 {f} {cy} 0 0 0 1 0" for b in baselines_m]
    return "".join(f"{name}{row}\n" for name, row in zip(names, rows, strict=True))
