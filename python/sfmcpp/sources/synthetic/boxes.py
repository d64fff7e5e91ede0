"""Upright boxes: points on them, and what they hide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sources.synthetic.sight import enters

# A point on a box is not hidden by the surface it lies on.
_SURFACE_M = 1e-6


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes with sides along the axes of the world.

    Attributes
    ----------
    lower, upper : (B, 3) float64
        Opposite corners [m].
    """

    lower: FloatArray
    upper: FloatArray

    def surface_points(self, per_m2: float, rng: np.random.Generator) -> FloatArray:
        """(N, 3) points, uniform on all sides but the bottoms; `per_m2` on a square metre, rounded."""
        found = [np.empty((0, 3))]
        for lower, upper in zip(self.lower, self.upper, strict=True):
            size = upper - lower
            for axis, high in ((0, False), (0, True), (1, False), (1, True), (2, True)):
                count = round(per_m2 * float(np.prod(np.delete(size, axis))))
                places = rng.uniform(lower, upper, (count, 3))
                places[:, axis] = upper[axis] if high else lower[axis]
                found.append(places)
        return np.concatenate(found)

    def hides(self, centre: FloatArray, points: FloatArray) -> BoolArray:
        """(N,) whether a box stands between `centre` (3,) and each of `points` (N, 3) (slab method)."""
        way = points - centre
        hidden = np.zeros(len(points), dtype=np.bool_)
        for lower, upper in zip(self.lower + _SURFACE_M, self.upper - _SURFACE_M, strict=True):
            hidden |= enters(centre, way, lower, upper)
        return hidden
