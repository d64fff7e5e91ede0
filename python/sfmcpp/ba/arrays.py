"""The arrays of a problem as the core takes them."""

from __future__ import annotations

from typing import Any

from sfmcpp.model import Problem

_ARRAYS = (
    "camera_model",
    "cameras",
    "intrinsics",
    "points",
    "intrinsics_index",
    "camera_index",
    "point_index",
    "pixels",
    "sigma_px",
    "fixed_cameras",
    "fixed_points",
    "fixed_intrinsics",
)


def core_arrays(problem: Problem) -> dict[str, Any]:
    """Arrays of `problem` by name, without copies."""
    return {name: getattr(problem, name) for name in _ARRAYS}
