"""Shapes that no rate or setting was chosen on: surveys, object scans, rooms, a square that many photograph.

They are drawn here, by no scene of the package, with one lens for all images ("one") or one for each ("own").
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import Problem
from sfmcpp.sources.synthetic import perturb
from sfmcpp.sources.synthetic.image_geometry import UP, looking_at

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Lens:
    """Pinhole of a focal length [px] in images of a width and height [px]."""

    focal_px: float
    width_px: int
    height_px: int


@dataclass(frozen=True, eq=False)
class Shape:
    """Cameras (C, 3) that look at targets (C, 3), points (N, 3), and how many of those in view are tracked.

    `share` is of all points, or one of each (N,). Points with normals (N, 3) are seen from one side alone.
    The world direction `up` points up in every image.
    """

    centres: Array
    targets: Array
    points: Array
    lens: Lens
    share: float | Array
    start_sigma_m: float
    normals: Array | None = None
    up: Array = field(default_factory=UP.copy)


def survey(images: int, rng: np.random.Generator) -> Shape:
    """Images straight down from 100 m over rough ground, 80 % and 60 % overlapping."""
    in_row = int(np.ceil(np.sqrt(2 * images)))
    rows, columns = np.divmod(np.arange(images), in_row)
    places = np.stack([columns * 20.0, rows * 53.0], axis=1)
    num_points = int(np.prod(np.ptp(places, axis=0) + 100.0) / 30.0)
    ground = rng.uniform(places.min(axis=0) - 50.0, places.max(axis=0) + 50.0, (num_points, 2))
    points = np.column_stack([ground, rng.gamma(1.0, 6.0, num_points)])
    centres = np.column_stack([places, np.full(images, 100.0)]) + rng.normal(0.0, 1.0, (images, 3))
    lens, north = Lens(3000.0, 4000, 3000), np.array([0.0, 1.0, 0.0])
    return Shape(centres, centres - UP, points, lens, 0.5, 1.0, up=north)


def scan(images: int, rng: np.random.Generator) -> Shape:
    """Rings of images around an object."""
    rings = max(3, images // 100)
    angle = np.tile(np.linspace(0.0, 2 * np.pi, images // rings, endpoint=False), rings)
    height = np.repeat(np.linspace(-0.3, 1.2, rings), images // rings)
    cosine = np.cos(height)
    centres = 5.0 * np.stack([np.cos(angle) * cosine, np.sin(angle) * cosine, np.sin(height)], axis=1)
    normals = rng.normal(size=(60 * images, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = normals * rng.uniform(1.2, 1.8, (len(normals), 1))
    targets = rng.normal(0.0, 0.05, centres.shape)
    return Shape(centres, targets, points, Lens(3500.0, 4000, 3000), 0.35, 0.05, normals)


def room(images: int, rng: np.random.Generator) -> Shape:
    """A hand-held video within the walls of a room."""
    t = np.linspace(0.0, 12 * np.pi, images)
    centres = np.stack(
        [2.5 * np.cos(0.31 * t) + 4, 1.8 * np.sin(0.43 * t) + 3, 1.5 + 0.2 * np.sin(t)], axis=1
    )
    ahead = np.stack([np.cos(0.9 * t), np.sin(0.9 * t), 0.2 * np.sin(0.7 * t)], axis=1)
    sides = np.array([8.0, 6.0, 3.0])
    points = rng.uniform(0.0, 1.0, (40 * images, 3)) * sides
    wall = rng.integers(0, 6, len(points))
    points[np.arange(len(points)), wall // 2] = (wall % 2) * sides[wall // 2]
    return Shape(centres, centres + ahead, points, Lens(800.0, 1280, 960), 0.5, 0.05)


def square(images: int, rng: np.random.Generator) -> Shape:
    """Photos by many people: few points are in most of them, most points in few (Pareto)."""
    centres = np.stack(
        [rng.normal(0, 12, images), -25 - rng.gamma(2, 4, images), rng.uniform(1.5, 4, images)], 1
    )
    targets = np.stack([rng.normal(0, 10, images), np.zeros(images), rng.uniform(3, 14, images)], 1)
    count = 25 * images
    points = np.stack([rng.normal(0, 18, count), rng.gamma(1, 3, count), rng.uniform(0, 25, count)], 1)
    share = np.minimum(0.02 * rng.pareto(1.2, count), 0.9)
    return Shape(centres, targets, points, Lens(1800.0, 2000, 1500), share, 0.2)


_SHAPES: dict[str, Callable[[int, np.random.Generator], Shape]] = {
    "survey": survey,
    "scan": scan,
    "room": room,
    "square": square,
}


def problem_of(name: str, images: int, lenses: str, seed: int = 2) -> Problem:
    """A shape with noise of 1 px, observed by two images or more, from a poor start."""
    rng = np.random.default_rng(seed)
    shape = _SHAPES[name](images, rng)
    cameras = looking_at(shape.centres, shape.targets, shape.up)
    seen = [_seen(shape, camera, rng) for camera in cameras]
    camera = np.repeat(np.arange(len(seen), dtype=np.int32), [len(rows) for rows, _ in seen])
    point = np.concatenate([rows for rows, _ in seen])
    pixels = np.concatenate([pixels for _, pixels in seen])
    tracked = np.bincount(point, minlength=len(shape.points)) >= 2
    number = np.cumsum(tracked, dtype=np.int32) - 1
    kept = tracked[point]
    rows = np.zeros(len(seen), dtype=np.int32) if lenses == "one" else np.arange(len(seen), dtype=np.int32)
    problem = Problem(
        "bal",
        cameras,
        np.tile([shape.lens.focal_px, 0.0, 0.0], (rows[-1] + 1, 1)),
        shape.points[tracked],
        camera[kept],
        number[point[kept]],
        pixels[kept] + rng.normal(0.0, 1.0, (int(kept.sum()), 2)),
        intrinsics_index=rows,
    )
    sigma = shape.start_sigma_m
    return perturb(problem, point_sigma_m=sigma, position_sigma_m=sigma, rotation_sigma_deg=0.5, seed=1)


def _seen(shape: Shape, camera: Array, rng: np.random.Generator) -> tuple[NDArray[np.int64], Array]:
    """Points that a camera tracks, and their images."""
    offsets = shape.points - camera[:, 3]
    in_camera = offsets @ camera[:, :3]
    depth = np.where(in_camera[:, 2] > 0.3, in_camera[:, 2], np.inf)
    pixels = shape.lens.focal_px * in_camera[:, :2] / depth[:, None]
    visible = np.isfinite(depth) & (np.abs(pixels) < [shape.lens.width_px / 2, shape.lens.height_px / 2]).all(
        axis=1
    )
    if shape.normals is not None:
        visible &= (offsets * shape.normals).sum(axis=1) < -0.2 * depth
    rows = np.flatnonzero(visible & (rng.random(len(visible)) < shape.share)).astype(np.int64)
    return rows, pixels[rows]
