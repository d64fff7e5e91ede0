"""What a function of residuals of one's own gives."""

from __future__ import annotations

from typing import NamedTuple

from sfmcpp.model.arrays import FloatArray


class Evaluation(NamedTuple):
    """Residuals of the members of a group, and their derivatives if requested.

    Attributes
    ----------
    residuals : (n, k) float64
        r of each member.
    by_poses : (n, k, p, 6) float64 or None
        Derivatives by the poses of each member, p = 1 or 2: δR, then the centre. None without cameras.
    by_point : (n, k, 3) float64 or None
        Derivatives by the point of each member. None without points.
    """

    residuals: FloatArray
    by_poses: FloatArray | None = None
    by_point: FloatArray | None = None
