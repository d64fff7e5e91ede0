"""Photos of two textured planes whose grey levels are known everywhere, and a map of points on them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sfmcpp.map import Map
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.model.photos import Photo
from sfmcpp.sources.synthetic.image_geometry import looking_at
from textured_photos import write_photo

SIZE, FOCAL_PX = (400, 300), 380.0
INTRINSICS = np.array([FOCAL_PX, 1.0, 200.0, 150.0, *np.zeros(8)])
# A wall that stands on a floor: a point of each plane and two unit vectors along it.
PLANES = (
    (np.array([0.0, 2.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])),
    (np.array([0.0, 2.0, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, -1.0, 0.0])),
)
# How far keypoints are from the true images of their points [px].
NOISE_PX = 0.3


def cameras(count: int) -> FloatArray:
    """(count, 3, 4) along an arc before the wall."""
    angle = np.linspace(-0.5, 0.5, count)
    height = 1.3 + 0.2 * np.cos(5 * angle)
    centres = np.stack([4 * np.sin(angle), 2 - 4 * np.cos(angle), height], axis=1)
    return looking_at(centres, np.array([0.0, 1.6, 0.35]), np.array([0.0, 0.0, 1.0]))


def on_planes(camera: FloatArray, pixels: FloatArray) -> tuple[FloatArray, IndexArray]:
    """Points (n, 3) that a camera sees at `pixels` (n, 2), and on which plane each is."""
    normalised = (pixels - INTRINSICS[2:4]) / FOCAL_PX
    rays = np.column_stack([normalised, np.ones(len(pixels))]) @ camera[:, :3].T
    depths = []
    for corner, along, up in PLANES:
        normal = np.cross(along, up)
        depths.append((corner - camera[:, 3]) @ normal / (rays @ normal))
    nearest = np.argmin(depths, axis=0)
    return camera[:, 3] + np.min(depths, axis=0)[:, None] * rays, nearest.astype(np.int32)


def images_of(camera: FloatArray, points: FloatArray) -> FloatArray:
    """Pixels (n, 2) of `points` (n, 3)."""
    in_camera = (points - camera[:, 3]) @ camera[:, :3]
    return np.asarray(FOCAL_PX * in_camera[:, :2] / in_camera[:, 2:] + INTRINSICS[2:4])


def grey_levels(points: FloatArray, planes: IndexArray, seed: int = 0) -> FloatArray:
    """Waves of several lengths, on each plane others."""
    random = np.random.default_rng(seed)
    total = np.zeros(len(points))
    for number, (corner, along, up) in enumerate(PLANES):
        u, v = (points - corner) @ along, (points - corner) @ up
        here = np.zeros(len(points))
        for length_m in (0.1, 0.13, 0.17, 0.22, 0.3, 0.5):
            for _ in range(2):
                turn, phase = random.uniform(0, 2 * np.pi, 2)
                here += np.sin(2 * np.pi * (np.cos(turn) * u + np.sin(turn) * v) / length_m + phase)
        total[planes == number] = here[planes == number]
    return np.asarray((128 + 22 * total).clip(0, 255))


def write_photos(folder: Path, poses: FloatArray, *, noise: float = 2.0) -> list[Photo]:
    """A photo of each camera, with noise of grey levels."""
    x, y = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    pixels, random, photos = np.column_stack([x.ravel(), y.ravel()]), np.random.default_rng(1), []
    for number, camera in enumerate(poses):
        grey = grey_levels(*on_planes(camera, pixels)) + random.normal(0, noise, len(pixels))
        picture = np.rint(grey.clip(0, 255)).astype(np.uint8).reshape(SIZE[1], SIZE[0], 1)
        path = write_photo(folder / f"{number}.png", np.repeat(picture, 3, axis=2))
        photos.append(Photo(path.name, path, SIZE))
    return photos


def noisy_map(poses: FloatArray, *, num_points: int = 600, scale: float = 2.0) -> Map:
    """Points on the planes, seen by all cameras in whose images they are, at pixels with noise."""
    random = np.random.default_rng(2)
    middle = poses[len(poses) // 2]
    points, _ = on_planes(middle, random.uniform([20, 20], [380, 280], (num_points, 2)))
    world = Map("perspective")
    world.add_cameras(INTRINSICS[None], fixed=np.ones((1, 12), dtype=bool), sizes=[SIZE])
    world.add_points(points + random.normal(0, 0.002, points.shape))
    pixels = np.stack([images_of(camera, points) for camera in poses])
    pixels += random.normal(0, NOISE_PX, pixels.shape)
    seen = ((pixels > 15) & (pixels < np.array(SIZE) - 15)).all(axis=2)
    world.add_images(
        [f"{k}.png" for k in range(len(poses))],
        np.zeros(len(poses), dtype=int),
        seen.sum(axis=1),
        pixels[seen],
        points=np.nonzero(seen)[1],
        poses=poses,
        scales=np.full(int(seen.sum()), scale),
    )
    return world
