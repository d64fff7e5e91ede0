"""Scenes of named images with known poses, and their poses in another world."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry.similarity import Similarity
from sfmcpp.geometry.so3 import exp
from sfmcpp.study.evaluation import ImagePoses

AWAY = Similarity(0.25, exp(np.array([0.3, -1.0, 2.0])), np.array([3.0, -4.0, 50.0]))


def true_poses(count: int = 9, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.concatenate([exp(rng.normal(size=(count, 3))), 5 * rng.normal(size=(count, 3, 1))], axis=2)


def named(poses: np.ndarray, template: str = "{:04d}.jpg") -> ImagePoses:
    return ImagePoses(tuple(template.format(i) for i in range(len(poses))), poses)


def moved(truth: ImagePoses, rows: list[int] | None = None) -> ImagePoses:
    """Some of the images, in another world."""
    rows = list(range(len(truth))) if rows is None else rows
    return ImagePoses(tuple(truth.names[row] for row in rows), AWAY.apply_to_poses(truth.poses[rows]))
