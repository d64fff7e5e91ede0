"""Standard deviations of the intrinsics of a model."""

from __future__ import annotations

import numpy as np

from sfmcpp.ba import linearize, residuals
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem, camera_model
from sfmcpp.model.arrays import FloatArray

# Above these, they would take longer than all that is told beside them.
_MOST_IMAGES = 150
_MOST_OBSERVATIONS = 300_000


def sigmas_of_intrinsics(problem: Problem) -> FloatArray | None:
    """Standard deviations of the free intrinsics of each camera.

    From the inverse of the normal matrix, times the mean squared residual over the redundancy.

    Parameters
    ----------
    problem : Problem
        An adjusted one, in which every row of intrinsics is an image's.

    Returns
    -------
    (G, n) float64 or None
        In the units of the intrinsics; 0 for those that are fixed. None for a large problem, or where
        something is not determined at all.
    """
    count = problem.num_observations
    if not (2 <= problem.num_cameras <= _MOST_IMAGES and 0 < count <= _MOST_OBSERVATIONS):
        return None
    places = [int(np.argmax(problem.intrinsics_index == row)) for row in range(len(problem.intrinsics))]
    try:
        model = linearize(problem, gauge="fixed")
        covariances = model.covariance(cameras=places).cameras
    except InvalidArgument:  # something that nothing determines
        return None
    redundancy = 2 * count - model.num_columns
    if redundancy <= 0:
        return None
    variance = float((residuals(problem) ** 2).sum()) / redundancy
    roots = np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2) * variance, 0.0))
    columns = {name: column for column, name in enumerate(model.parameter_names)}
    found = np.zeros(problem.intrinsics.shape)
    for k, name in enumerate(camera_model(problem.camera_model).intrinsics):
        if name in columns:
            found[:, k] = roots[:, columns[name]]
    found[problem.fixed_intrinsics] = 0.0
    return found
