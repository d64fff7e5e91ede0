"""Groups of constraints to try, and their errors in plain NumPy: the reference for the core."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import sfmcpp
from sfmcpp import CONSTRAINT_KINDS, ConstraintGroup, Problem

Array = NDArray[np.float64]
CAMERAS = np.array([1, 4, 2])
PAIRS = np.array([[0, 1], [3, 4], [5, 2]])


def scene(camera_model: str = "perspective", seed: int = 1) -> Problem:
    truth = sfmcpp.circle_scene(6, 30, camera_model=camera_model, seed=seed)
    problem = sfmcpp.perturb(
        truth, point_sigma_m=0.1, position_sigma_m=0.1, rotation_sigma_deg=1.0, seed=seed + 1
    )
    return problem.set_free_intrinsics("f", "cx", "cy") if camera_model == "perspective" else problem


def rotations(rng: np.random.Generator, count: int) -> Array:
    matrices: Array = Rotation.from_rotvec(rng.normal(0, 0.1, (count, 3))).as_matrix()
    return matrices


def random_group(problem: Problem, kind: str, **more: Any) -> ConstraintGroup:
    """Three members with random weights, measured near nothing in particular."""
    rng = np.random.default_rng(5)
    shape = CONSTRAINT_KINDS[kind].values
    values: Array | None = None
    if shape == (3, 4):
        values = np.concatenate([rotations(rng, 3), rng.normal(0, 1, (3, 3, 1))], axis=2)
    elif shape == (3, 3):
        values = rotations(rng, 3)
    elif shape is not None:
        values = rng.uniform(100, 900, (3, *shape))
    if kind == "orientation-reprojections":
        values = problem.rotations[CAMERAS] @ rotations(rng, 3)
    cameras = CAMERAS if 1 in CONSTRAINT_KINDS[kind].cameras else PAIRS
    points = [problem.points[:4], problem.points[4:5], problem.points] if "reproj" in kind else ()
    weights = rng.uniform(0.5, 2, 3)
    return ConstraintGroup(kind, cameras, values, 3.0, weights, points=points, **more)


def matrix(pose: Array) -> Array:
    return np.vstack([pose, [0, 0, 0, 1]])


def images(problem: Problem, camera: int, pose: Array, points: Array) -> Array:
    """Pixels without distortion, of a camera with another pose."""
    named = dict(zip(problem.intrinsic_names, problem.intrinsics[camera], strict=True))
    x = (points - pose[:, 3]) @ pose[:, :3]
    u, v = x[:, 0] / x[:, 2], x[:, 1] / x[:, 2]
    return np.stack(
        [
            named["f"] * u + named["skew"] * v + named["cx"],
            named["aspect"] * named["f"] * v + named["cy"],
        ],
        axis=1,
    )


def error_of_images(problem: Problem, group: ConstraintGroup, k: int) -> Array:
    camera = int(np.atleast_1d(group.cameras[k])[-1])
    here = there = problem.cameras[camera]
    if group.kind == "smoothing-reprojections":
        there = problem.cameras[group.cameras[k][0]]
    else:
        assert group.values is not None
        there = np.column_stack([group.values[k], here[:, 3]])
    points = np.asarray(group.points[k])
    difference = images(problem, camera, here, points) - images(problem, camera, there, points)
    return difference / np.sqrt(len(points))


ERRORS: dict[str, Callable[[Array, Array, Any], Any]] = {
    "pose": lambda t, _, v: np.linalg.inv(t) @ matrix(v) - np.eye(4),
    "position": lambda t, _, v: t[:3, 3] - v,
    "orientation": lambda t, _, v: t[:3, :3].T @ v - np.eye(3),
    "displacement-pose": lambda t, p, v: np.linalg.inv(np.linalg.inv(p) @ t) @ matrix(v) - np.eye(4),
    "displacement-translation": lambda t, p, v: t[:3, 3] - p[:3, 3] - v,
    "displacement-rotation": lambda t, p, v: (p[:3, :3].T @ t[:3, :3]).T @ v - np.eye(3),
    "displacement-rotation-log": lambda t, p, v: Rotation.from_matrix(
        v.T @ p[:3, :3].T @ t[:3, :3]
    ).as_rotvec(),
    "scale": lambda t, p, v: np.linalg.norm(t[:3, 3] - p[:3, 3]) - v,
    "smoothing": lambda t, p, _: np.linalg.inv(t) - np.linalg.inv(p),
}
ENTRIES = {"pose": 12, "displacement-pose": 12, "smoothing": 12}


def error(problem: Problem, group: ConstraintGroup, k: int) -> Array:
    """Error of one member over the root of its dimension, from the table of ConstraintGroup."""
    if group.points:
        return error_of_images(problem, group, k).ravel()
    value = None if group.values is None else group.values[k]
    camera = int(np.atleast_1d(group.cameras[k])[-1])
    row = problem.intrinsics[problem.intrinsics_index[camera]]
    named = dict(zip(problem.intrinsic_names, row, strict=True))
    if group.kind == "focal":
        return np.atleast_1d(np.log(value / named["f"]))
    if group.kind == "principal-point":
        return (np.array([named["cx"], named["cy"]]) - value) / np.sqrt(2)
    previous = matrix(problem.cameras[np.atleast_1d(group.cameras[k])[0]])
    e = np.asarray(ERRORS[group.kind](matrix(problem.cameras[camera]), previous, value)).ravel()
    return e / np.sqrt(ENTRIES.get(group.kind, e.size))


def weighted_errors(problem: Problem, group: ConstraintGroup) -> Array:
    members = range(group.num_members)
    return np.concatenate(
        [np.sqrt(group.weight * group.member_weights[k]) * error(problem, group, k) for k in members]
    )


def positions(problem: Problem, truth: Problem, **more: Any) -> ConstraintGroup:
    return ConstraintGroup("position", np.arange(problem.num_cameras), truth.centres, name="gps", **more)
