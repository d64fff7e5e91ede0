"""Reconstructions that were never run: synthetic scenes as if photos of them had been put together."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import numpy as np

from sfmcpp.geometry import TwoViewGeometry
from sfmcpp.map import Map, map_of_problem
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.photos import Features, Photo
from sfmcpp.sfm import GpsOutcome, ImageOutcome, MatchGraph, Pair, SfmRun
from sfmcpp.sources.synthetic import circle_scene

SIZE = (640, 480)
FREE = ("f", "k1")
UNKNOWN = np.full((3, 3), np.nan)
NO_MATCH = "no two photos of it match"


def shared_scene(
    num_images: int = 8, num_points: int = 150, sigma_px: float = 0.5, **options: Any
) -> Problem:
    """Cameras on a circle that share their intrinsics, of which f and k1 are free; points have colours."""
    scene = circle_scene(
        num_images,
        num_points,
        camera_model="perspective",
        image_size=SIZE,
        pixel_sigma_px=sigma_px,
        seed=4,
        **options,
    )
    names = [f"set/photo {i:04d}.jpg" for i in range(num_images)]
    colors = np.random.default_rng(1).integers(30, 255, (num_points, 3), dtype=np.uint8)
    return Problem(
        "perspective",
        scene.cameras,
        scene.intrinsics[:1],
        scene.points,
        scene.camera_index,
        scene.point_index,
        scene.pixels,
        intrinsics_index=np.zeros(num_images, dtype=np.int32),
        fixed_intrinsics=np.array([[name not in FREE for name in INTRINSICS]]),
        metadata=Metadata(
            image_names=names,
            image_sizes=np.tile(np.array(SIZE, dtype=np.int64), (num_images, 1)),
            point_colors=colors,
        ),
    )


INTRINSICS = ("f", "aspect", "cx", "cy", "skew", "k1", "k2", "k3", "k4", "k5", "p1", "p2")


def with_loose_keypoints(problem: Problem, per_image: int = 3) -> Problem:
    """The same with keypoints that see no point, behind the others of each image."""
    counts = np.bincount(problem.camera_index, minlength=problem.num_cameras)
    image = np.repeat(np.arange(problem.num_cameras), per_image)
    rank = np.tile(np.arange(per_image), problem.num_cameras) + counts[image]
    loose = {
        "colmap_loose_image": image,
        "colmap_loose_keypoint_index": rank,
        "colmap_loose_pixels": np.random.default_rng(2).uniform(0, 400, (len(image), 2)),
    }
    return replace(problem, metadata=replace(problem.metadata, extra=loose))


def without_poses(world: Map, images: list[int]) -> Map:
    """The map once images have lost their poses, and with them their points."""
    world.forget(world.keypoints_of(images))
    world.poses[images] = np.nan
    return world


def features_of(world: Map) -> list[Features]:
    """Features that are the keypoints of a map."""
    found = []
    for begin, count in zip(world.keypoint_begin.tolist(), world.keypoint_counts.tolist(), strict=True):
        rows = slice(begin, begin + count)
        nan, none = np.full(count, np.nan), np.zeros((count, 0), np.uint8)
        found.append(Features(world.keypoints[rows], nan, nan, world.keypoint_colors[rows], none))
    return found


def pair(first: int, second: int, matches: int = 60, inliers: int = 50, message: str = "") -> Pair:
    """A pair of images; without inliers it does not match."""
    kind = "general" if inliers else "none"
    rows = np.repeat(np.arange(matches, dtype=np.int32)[:, None], 2, axis=1)
    geometry = TwoViewGeometry(
        kind, np.arange(matches) < inliers, UNKNOWN, UNKNOWN, np.full((3, 4), np.nan), 4.0, message
    )
    return Pair(first, second, rows, geometry)


def finished_run(num_images: int = 8, left_out: tuple[int, ...] = (), **changes: Any) -> SfmRun:
    """A run in which the photos of `left_out` did not find their place, and one file could not be read."""
    world = without_poses(map_of_problem(with_loose_keypoints(shared_scene(num_images))), list(left_out))
    names = world.image_names
    photos = [Photo(name, size=SIZE) for name in names]
    pairs = [pair(i, i + 1, inliers=40 + i) for i in range(num_images - 1) if not {i, i + 1} & set(left_out)]
    pairs += [pair(0, i, 12, 0, "12 matches, 30 are needed") for i in left_out]
    outcomes = {
        name: ImageOutcome(False, None, NO_MATCH) if i in left_out else ImageOutcome(True, 0)
        for i, name in enumerate(names)
    }
    outcomes["broken.jpg"] = ImageOutcome(False, None, "cannot be read: truncated")
    unreadable = {"broken.jpg": "cannot be read: truncated"}
    content: dict[str, Any] = {
        "source": "trips/fountain/images",
        "options": {"method": "incremental", "seed": 0, "threads": 2},
        "graph": MatchGraph(photos, features_of(world), pairs, unreadable),
        "models": [world],
        "images": outcomes,
        "seconds": {"features": 2.5, "matching": 1.0, "mapping": 0.5},
    }
    return SfmRun(**{**content, **changes})


def run_without_model(num_images: int = 3) -> SfmRun:
    """A run that found no model."""
    whole = finished_run(num_images, tuple(range(num_images)))
    whole.models.clear()
    return whole


def gps_outcome(run: SfmRun, outlier: int) -> GpsOutcome:
    """Positions of all images but one, which is off by 20 m."""
    names = run.graph.photos
    residuals = {photo.name: 20.0 if i == outlier else 0.5 + 0.01 * i for i, photo in enumerate(names)}
    return GpsOutcome(0.6, 0.12, [names[outlier].name], np.array([48.2, 16.37, 180.0]), residuals)


def thumbnail(photo: Photo) -> bytes:
    """A small picture whose grey level tells the photo."""
    from matplotlib.image import imsave

    level = (int(photo.name[-8:-4]) * 20 + 40) % 256
    stream = io.BytesIO()
    imsave(stream, np.full((48, 64, 3), level, dtype=np.uint8), format="jpg")
    return stream.getvalue()
