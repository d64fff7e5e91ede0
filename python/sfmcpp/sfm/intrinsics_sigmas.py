"""Standard deviations of the intrinsics of a model."""

from __future__ import annotations

import numpy as np

from sfmcpp.ba import linearize
from sfmcpp.ba.linearize import LinearModel
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem, camera_model
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.model.selection import observing_cameras
from sfmcpp.sfm.fit_statistics import pixel_variance

# Of the largest, they take a second or two.
_MOST_IMAGES = 1000
_MOST_CAMERAS = 150
_MOST_OBSERVATIONS = 1_000_000


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
    is_small = problem.num_cameras <= _MOST_IMAGES and len(problem.intrinsics) <= _MOST_CAMERAS
    if not (is_small and problem.num_cameras >= 2 and 0 < count <= _MOST_OBSERVATIONS):
        return None
    try:
        model = linearize(problem, gauge="fixed")
        covariances = model.covariance(cameras=an_image_of_each(problem)).cameras
    except InvalidArgument:  # something that nothing determines
        return None
    if model.num_columns >= 2 * count:
        return None
    return intrinsics_sigmas_of(problem, model, covariances * pixel_variance(model))


def an_image_of_each(problem: Problem) -> IndexArray:
    """Number of an image of each row of intrinsics that has some: the first that sees something, if any."""
    sees = observing_cameras(problem)
    seeing_first = np.argsort(~sees, kind="stable")
    first = np.unique(problem.intrinsics_index[seeing_first], return_index=True)[1]
    return seeing_first[first].astype(np.int32)


def intrinsics_sigmas_of(problem: Problem, model: LinearModel, covariances: FloatArray) -> FloatArray:
    """Standard deviations (G, n) of the intrinsics, 0 for those that are fixed.

    Parameters
    ----------
    problem : Problem
        With G rows of intrinsics.
    model : LinearModel
        Of the problem.
    covariances : (g, d, d) float64
        Of the parameters of :func:`an_image_of_each` of them.
    """
    roots = np.sqrt(np.maximum(np.diagonal(covariances, axis1=1, axis2=2), 0.0))
    rows = np.unique(problem.intrinsics_index)
    columns = {name: column for column, name in enumerate(model.parameter_names)}
    found = np.zeros(problem.intrinsics.shape)
    for k, name in enumerate(camera_model(problem.camera_model).intrinsics):
        if name in columns:
            found[rows, k] = roots[:, columns[name]]
    found[problem.fixed_intrinsics] = 0.0
    return found
