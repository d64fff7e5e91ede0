"""The arrays of a problem and of its constraints as the core takes them."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp import _core
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import CameraFunction, ConstraintGroup, Problem, Rigs, camera_model
from sfmcpp.model.arguments import require_instance
from sfmcpp.model.arrays import IndexArray, index_array, number_array
from sfmcpp.model.constraints import NO_CAMERA
from sfmcpp.model.residual_group import Group, ResidualGroup, checked_groups
from sfmcpp.model.selection import remade

_NUMBERS = ("cameras", "intrinsics", "points", "pixels", "sigma_px", "covariance_px2")
_STRUCTURE = (
    "intrinsics_index",
    "camera_index",
    "point_index",
    "fixed_cameras",
    "fixed_points",
    "fixed_intrinsics",
)


def core_arrays(problem: Problem) -> dict[str, Any]:
    """Arrays of `problem` by name, without copies but of indices and masks.

    They say where the core reads and writes, while a callback or another thread may change the caller's.
    """
    require_instance("problem", problem, Problem)
    rigs = remade(problem).rigs  # and the shapes are right: the core compares sizes
    views = {name: getattr(problem, name) for name in _NUMBERS}
    copies = {name: number_array(name, getattr(problem, name)).copy() for name in _STRUCTURE}
    return {"camera_model": _core_model(problem), **views, **copies, **_rig_arrays(rigs)}


def with_own_fields(problem: Problem) -> Problem:
    """The same arrays in a problem of its own, which is not changed by what is assigned to fields later.

    Raises
    ------
    InvalidArgument
        If it is no problem.
    """
    require_instance("problem", problem, Problem)
    own = copy(problem)
    for name in _STRUCTURE:
        setattr(own, name, number_array(name, getattr(problem, name)))
    own.rigs, own.metadata = copy(problem.rigs), copy(problem.metadata)
    return own


def _core_model(problem: Problem) -> str | _core.CoreCameraFunction:
    model = camera_model(problem.camera_model)
    if not isinstance(model, CameraFunction):
        return model.name
    model.require_images(problem)
    return _core.CoreCameraFunction(model.name, model.intrinsics, model.evaluate)


def _rig_arrays(rigs: Rigs | None) -> dict[str, Any]:
    if rigs is None:
        return {}
    return {
        "rig_sensors": rigs.sensors,
        "frame_of_camera": rigs.frame_of_camera.copy(),
        "sensor_of_camera": rigs.sensor_of_camera.copy(),
        "free_sensors": rigs.free_sensors.copy(),
    }


def core_constraints(groups: Iterable[Group], problem: Problem) -> list[dict[str, Any]]:
    """Groups as the core takes them: pairs (previous, this) of cameras, the points of all members in one."""
    return [_core_constraint(group, problem) for group in checked_groups(groups)]


def _core_constraint(group: Group, problem: Problem) -> dict[str, Any]:
    pairs = np.full(group.num_members, NO_CAMERA, np.int32) if group.cameras is None else group.cameras
    if pairs.ndim == 1:
        pairs = np.stack([np.full_like(pairs, NO_CAMERA), pairs], axis=1)
    common = {
        "name": group.name,
        "weight": group.weight,
        "loss": group.loss,
        "loss_scale": group.loss_scale,
        "cameras": np.ascontiguousarray(pairs),
        "member_weights": group.member_weights,
    }
    if isinstance(group, ResidualGroup):
        points = np.zeros(0, np.int32) if group.points is None else group.points
        rows = group.residuals_at(problem).shape[1]
        return common | {"function": group.evaluate, "rows": rows, "point_index": points}
    return common | _constraint_values(group)


def _constraint_values(group: ConstraintGroup) -> dict[str, Any]:
    sizes = [len(x) for x in group.points] or [0] * group.num_members
    return {
        "kind": group.kind,
        "values": np.zeros(0) if group.values is None else group.values,
        "points": np.concatenate([np.zeros((0, 3)), *group.points]),
        "points_begin": np.cumsum([0, *sizes], dtype=np.int32),
    }


def chosen_numbers(name: str, value: ArrayLike | Literal["all"], count: int) -> IndexArray:
    """Numbers of some of `count` cameras or points; "all" is every one."""
    if isinstance(value, str):
        if value != "all":
            raise InvalidArgument(f"{name} = {value!r}: must be numbers or 'all'")
        return np.arange(count, dtype=np.int32)
    numbers = index_array(name, number_array(name, value).reshape(-1))
    for number in numbers[(numbers < 0) | (numbers >= count)]:
        raise InvalidArgument(f"{name}: {number}, must be in [0, {count})")
    return numbers
