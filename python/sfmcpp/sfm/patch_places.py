"""Where the patches of a point are in its photos, and how they are distorted, by what the model predicts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry.pinhole import unit
from sfmcpp.geometry.point_tests import projected_points
from sfmcpp.geometry.surface import surface_normals, surface_slopes
from sfmcpp.map import LocalProblem, Map
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray

Numbers = NDArray[np.intp]

# Of an image of a patch over its area in the reference: less is seen from the side, or from behind.
_LEAST_AREA = 0.05


@dataclass(frozen=True, eq=False)
class PatchPlaces:
    """Patches of N points in M observations.

    Attributes
    ----------
    reference : (N,) int
        Observation of each point whose keypoint tells which point is meant: its ray is nearest to the mean.
    pixels : (M, 2) float64
        Centres [px]: in the reference the keypoint, elsewhere what the model predicts of it.
    maps : (M, 2, 2) float64
        Derivatives of the position with respect to that in the reference; not a number where the patch is not
        seen from its front.
    spacings : (N,) float64
        Distance of samples in the reference [px], where all of what was detected is in the patch.
    """

    reference: Numbers
    pixels: FloatArray
    maps: FloatArray
    spacings: FloatArray

    @classmethod
    def of(cls, world: Map, local: LocalProblem, step_per_scale: float) -> PatchPlaces:
        """Of the points of `local`; the distance of samples is a pixel at least."""
        problem = local.problem
        towards, reference = _references(problem)
        slopes = surface_slopes(problem, surface_normals(problem.points, towards))
        maps = slopes @ inverses(slopes[reference])[problem.point_index]
        maps[~(determinants(maps) >= _LEAST_AREA)] = np.nan
        predicted = projected_points(problem, problem.points)
        meant = (problem.pixels - predicted)[reference]
        pixels = predicted + np.einsum("mij,mj->mi", maps, meant[problem.point_index])
        spacings = np.fmax(1.0, step_per_scale * world.keypoint_scales[local.rows[reference]])
        return cls(reference, pixels, maps, spacings)


def _references(problem: Problem) -> tuple[FloatArray, Numbers]:
    """Mean direction (N, 3) from each point to its cameras, and the observation (N,) nearest to it."""
    index = problem.point_index
    rays = unit(problem.centres[problem.camera_index] - problem.points[index])
    towards = unit(np.stack([np.bincount(index, ray, problem.num_points) for ray in rays.T], axis=1))
    cosines = (rays * towards[index]).sum(axis=1)
    order = np.lexsort((-cosines, index))
    first = np.searchsorted(index[order], np.arange(problem.num_points))
    return towards, np.asarray(order[first], dtype=np.intp)


def determinants(matrices: FloatArray) -> FloatArray:
    """Of (n, 2, 2)."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, -1)
    return np.asarray(a * d - b * c)


def inverses(matrices: FloatArray) -> FloatArray:
    """Of (n, 2, 2); infinite or not a number where there is none."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.moveaxis(np.array([[d, -b], [-c, a]]) / determinants(matrices), -1, 0))
