"""Photos taken straight down from the air, whose cameras and points are known, and problems to begin with."""

from __future__ import annotations

import numpy as np

import sfmcpp
from sfmcpp.geometry import Similarity
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.synthetic.image_geometry import ImageGeometry, looking_at
from sfmcpp.sources.synthetic.observation import observe

HEIGHT_M = 60.0


def flight(places: FloatArray, seed: int) -> Problem:
    """Photos from `places` (n, 2) [m] in 60 m above hilly ground."""
    random = np.random.default_rng([seed, 1])
    low, high = places.min(axis=0) - 50, places.max(axis=0) + 50
    ground = np.append(random.uniform(low, high, (300, 2)), random.uniform(0, 15, (300, 1)), axis=1)
    centres = np.append(places, HEIGHT_M + random.normal(0, 0.2, (len(places), 1)), axis=1)
    cameras = looking_at(centres, centres - [0, 0, 1], np.array([0.0, 1.0, 0.0]))
    return observe(ImageGeometry("calibrated", 500.0, (640, 480)), cameras, ground, 0.5, random)


def in_a_frame_of_its_own(truth: Problem, seed: int) -> Problem:
    """Far off, turned, of another scale, and perturbed."""
    random = np.random.default_rng([seed, 4])
    turn = nearest_rotation(random.normal(size=(3, 3)))
    away = Similarity(0.07, turn, random.normal(0, 50.0, 3))
    problem = sfmcpp.perturb(
        truth, point_sigma_m=0.3, position_sigma_m=0.3, rotation_sigma_deg=0.3, seed=seed
    )
    problem.cameras[:] = away.apply_to_poses(problem.cameras)
    problem.points[:] = away.apply(problem.points)
    return problem


def tilt_deg(problem: Problem, truth: Problem) -> float:
    """Angle between the plumb lines of a model and of the truth, in the mean."""
    turns = truth.cameras[:, :, :3] @ np.swapaxes(problem.cameras[:, :, :3], 1, 2)
    return float(np.degrees(np.arccos(nearest_rotation(turns.mean(axis=0))[2, 2])))
