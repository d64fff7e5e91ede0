"""Scenes of known cameras for the tests of batch factorisation, and how good a reconstruction of them is."""

from __future__ import annotations

import numpy as np

import sfmcpp
from sfmcpp import Problem
from sfmcpp.ba.projective import matrices_to_frames
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.image_tracks import ImageTracks, image_tracks
from sfmcpp.sfm.batch.measurements import Measurements, normalised_measurements
from sfmcpp.sfm.batch.projective import ProjectiveReconstruction
from sfmcpp.study.evaluation.projective import projective_errors_px


def turntable(num_cameras: int = 12, num_points: int = 150, sigma_px: float = 0.0, seed: int = 0) -> Problem:
    """Cameras round a cube, which see all of it."""
    return sfmcpp.circle_scene(num_cameras, num_points, pixel_sigma_px=sigma_px, seed=seed)


def measured_of(problem: Problem) -> Measurements:
    """Its observations."""
    return normalised_measurements(
        problem.camera_index, problem.point_index, problem.pixels, problem.num_cameras
    )[0]


def true_cameras(problem: Problem, measured: Measurements) -> FloatArray:
    """(C, 3, 4) true projection matrices to the frames of the images, of norm one, depths positive."""
    cameras = matrices_to_frames(sfmcpp.projection_matrices(problem), measured.frames)
    return cameras / np.linalg.norm(cameras, axis=(1, 2), keepdims=True)


def tracks_of(problem: Problem) -> ImageTracks:
    """What its images see."""
    return image_tracks(
        problem.camera_index, problem.point_index, problem.pixels, sizes=problem.metadata.image_sizes
    )


def random_homography(seed: int = 0) -> FloatArray:
    """(4, 4) well conditioned, near no similarity."""
    rng = np.random.default_rng(seed)
    return np.eye(4) + 0.3 * rng.standard_normal((4, 4))


def share_of_noise(found: ProjectiveReconstruction, truth: Problem, is_wrong: BoolArray) -> float:
    """Error after the best homography over that of the adjustment of the same observations from the truth.

    Points with a wrong observation are left out of both.
    """
    problem = found.problem
    assert problem is not None
    same = Problem(
        truth.camera_model,
        truth.cameras[found.images],
        truth.intrinsics[found.images],
        truth.points[found.tracks],
        problem.camera_index,
        problem.point_index,
        truth.pixels[found.observations],
    )
    wrong = is_wrong[found.observations]
    right = (np.bincount(problem.point_index, wrong, problem.num_points) == 0)[problem.point_index]
    best = sfmcpp.as_projective(same)
    sfmcpp.solve(best, method="dog-leg", max_iterations=100)
    ours, theirs = (projective_errors_px(p, same, right)[right] for p in (problem, best))
    return float(np.sqrt(np.mean(ours**2) / np.mean(theirs**2)))
