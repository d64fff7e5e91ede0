"""What covariances in the free gauge refer to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sfmcpp
from dense_models import (
    METRIC,
    assert_same_covariance,
    dense_covariance,
    odd_problem,
    problem_of,
    root_of_normal_matrix,
)
from sfmcpp import InvalidArgument, Problem


def problem_with(freedoms: int, camera_model: str) -> Problem:
    """Bare images leave seven freedoms, a rig, which has a size, six, and a fixed point four."""
    if freedoms == 6:
        return sfmcpp.rig_walk_scene(12, 60, seed=0)
    return problem_of(camera_model) if freedoms == 7 else odd_problem(camera_model)


@pytest.mark.parametrize(
    ("freedoms", "camera_model"), [(6, ""), *((n, name) for n in (4, 7) for name in METRIC)]
)
def test_the_datum_of_cameras_is_an_s_transformation_of_the_pseudo_inverse(
    freedoms: int, camera_model: str
) -> None:
    """With the projector ``I − N (NᵀWN)⁻¹ NᵀW``, W of poses, centres in units of their extent."""
    problem = problem_with(freedoms, camera_model)
    model = sfmcpp.linearize(problem)
    offsets = np.linalg.norm(problem.centres - problem.centres.mean(axis=0), axis=1)
    weights = np.zeros(model.num_columns)
    weights[model.camera_columns[:, :3]] = 1.0
    weights[model.camera_columns[:, 3:6]] = offsets.max() ** -2
    _, sizes, vectors = np.linalg.svd(root_of_normal_matrix(model), full_matrices=False)
    unseen = vectors[-freedoms:].T
    assert sizes[-freedoms] < 1e-6 * sizes[-freedoms - 1]
    weighted = weights[:, None] * unseen
    projector = np.eye(len(weights)) - unseen @ np.linalg.solve(unseen.T @ weighted, weighted.T)
    expected = projector @ dense_covariance(model) @ projector.T
    point = model.point_columns[problem.point_index[0]]
    columns = np.concatenate([model.camera_columns[[0, 3]].ravel(), point + np.arange(3)])
    found, among = model.covariance_of_columns(columns), expected[np.ix_(columns, columns)]
    assert (np.abs(found - among) <= 1e-7 * np.sqrt(np.outer(np.diag(among), np.diag(among)))).all()


def test_points_that_images_hardly_tell_move_the_datum_of_all_but_not_of_cameras() -> None:
    """A hundred points at a thousand times the distance, where rays of two cameras hardly part."""
    near = problem_of("calibrated")
    ahead = near.centres[:2].mean(axis=0) + 4000 * near.rotations[:2, :, 2].mean(axis=0)
    far = ahead + np.random.default_rng(4).normal(0, 400, (100, 3))
    numbers = near.num_points + np.tile(np.arange(100, dtype=np.int32), 2)
    both = replace(
        near,
        points=np.concatenate([near.points, far]),
        fixed_points=None,
        camera_index=np.concatenate([near.camera_index, np.repeat(np.arange(2, dtype=np.int32), 100)]),
        point_index=np.concatenate([near.point_index, numbers]),
        pixels=np.concatenate([near.pixels, np.zeros((200, 2))]),
    )
    sigmas = {
        (datum, count): np.sqrt(
            np.diagonal(sfmcpp.linearize(p, datum=datum).covariance(cameras="all").cameras, axis1=1, axis2=2)
        )
        for datum in ("cameras", "all")
        for count, p in (("near", near), ("both", both))
    }
    assert (sigmas["cameras", "both"] < 1.01 * sigmas["cameras", "near"]).all()
    assert np.median(sigmas["all", "both"] / sigmas["all", "near"]) > 10


def test_the_datum_of_cameras_knows_no_unit() -> None:
    problem = problem_of("bal")
    scale = np.repeat([1.0, 1e3, 1.0], [3, 3, 3])
    small, large = (
        sfmcpp.linearize(replace(problem, cameras=problem.cameras * unit, points=problem.points * factor))
        for factor, unit in ((1.0, 1.0), (1e3, np.array([1, 1, 1, 1e3])))
    )
    expected = small.covariance(cameras=[2]).cameras[0] * np.outer(scale, scale)
    assert_same_covariance(1e-3 * large.covariance(cameras=[2]).cameras[0], 1e-3 * expected)
    with pytest.raises(InvalidArgument, match="datum = 'points': must be one of cameras, all"):
        sfmcpp.linearize(problem, datum="points")  # type: ignore[arg-type]
