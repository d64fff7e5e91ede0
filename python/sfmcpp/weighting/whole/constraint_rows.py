"""Errors of a group of constraints and their derivatives, as rows of the normal equations.

The equations are those of the table of :class:`sfmcpp.ConstraintGroup`, for all members at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sfmcpp import _core
from sfmcpp.ba.arrays import core_arrays
from sfmcpp.geometry.so3 import log
from sfmcpp.model import ConstraintGroup, Problem
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.weighting.whole.columns import POSE_SIZE, CameraColumns, moved_poses

# Steps of the central differences: of an angle [rad], and of other things over their size.
_STEP = 1e-5
# Intrinsic parameters of images that constraints compare, and what a camera model without them has.
_PINHOLE = {"f": 1.0, "aspect": 1.0, "cx": 0.0, "cy": 0.0, "skew": 0.0}


@dataclass(frozen=True)
class ConstraintRows:
    """The errors ``√(member weight) e`` of a group, a row for each entry; their squares add up to Σ m ε.

    Attributes
    ----------
    member : (R,) int32
        The member each row belongs to; members of weight zero have none.
    errors : (R,) float64
        The errors, each divided by the root of its dimension as the thesis has it.
    jacobian : (R, n) float64
        By the columns of the cameras.
    """

    member: IndexArray
    errors: FloatArray
    jacobian: FloatArray

    @property
    def squared_error(self) -> float:
        """Σ m ε over the members."""
        return float(self.errors @ self.errors)


@dataclass(frozen=True)
class _Cameras:
    """Poses and intrinsics of one camera of each member."""

    poses: FloatArray
    intrinsics: FloatArray

    @property
    def rotations(self) -> FloatArray:
        return self.poses[:, :, :3]

    @property
    def inverse_rotations(self) -> FloatArray:
        return np.swapaxes(self.rotations, 1, 2)

    @property
    def centres(self) -> FloatArray:
        return self.poses[:, :, 3]


def squared_error(group: ConstraintGroup, problem: Problem) -> float:
    """Σ m ε of a group at the present state.

    Parameters
    ----------
    group : ConstraintGroup
        The group; its weight does not matter.
    problem : Problem
        The cameras.

    Returns
    -------
    float
        The weighted sum of its members' mean squared errors.
    """
    active = _active(group)
    here, previous = _sides(active, problem)
    return float((_weigh(active, _errors(active, problem, here, previous)) ** 2).sum())


def constraint_rows(
    group: ConstraintGroup, problem: Problem, columns: CameraColumns | None
) -> ConstraintRows:
    """Linearise a group at the present state.

    Parameters
    ----------
    group : ConstraintGroup
        The group; its weight does not matter.
    problem : Problem
        The cameras, of a metric model.
    columns : CameraColumns or None
        Where derivatives go; None: no derivatives, and a Jacobian of no columns.

    Returns
    -------
    ConstraintRows
        Errors and derivatives.
    """
    active = _active(group)
    here, previous = _sides(active, problem)
    errors = _errors(active, problem, here, previous)
    members = np.flatnonzero(group.member_weights).astype(np.int32)
    member = np.broadcast_to(members[:, None], errors.shape)
    real = np.isfinite(errors)
    weighed = _weigh(active, errors)[real]
    if columns is None:
        return ConstraintRows(member[real], weighed, np.zeros((len(weighed), 0)))
    entries = np.zeros((*errors.shape, columns.count + 1))
    pairs = _pairs(active)
    _add_derivatives(
        entries, lambda s: _errors(active, problem, s, previous), here, pairs[:, 1], problem, columns
    )
    if active.cameras.ndim == 2:
        _add_derivatives(
            entries, lambda s: _errors(active, problem, here, s), previous, pairs[:, 0], problem, columns
        )
    jacobian = _weigh(active, entries)[real][:, : columns.count]
    return ConstraintRows(member[real], weighed, jacobian)


def _active(group: ConstraintGroup) -> ConstraintGroup:
    """The group without members of weight zero."""
    on = group.member_weights > 0
    return replace(
        group,
        cameras=group.cameras[on],
        values=None if group.values is None else group.values[on],
        member_weights=group.member_weights[on],
        points=[x for x, keep in zip(group.points, on, strict=False) if keep],
    )


def _pairs(group: ConstraintGroup) -> IndexArray:
    """(n, 2) previous camera, −1 for none, and this one."""
    if group.cameras.ndim == 2:
        return group.cameras
    return np.stack([np.full_like(group.cameras, -1), group.cameras], axis=1)


def _sides(group: ConstraintGroup, problem: Problem) -> tuple[_Cameras, _Cameras]:
    previous, here = _pairs(group).T
    rows = problem.intrinsics[problem.intrinsics_index]
    return _Cameras(problem.cameras[here], rows[here]), _Cameras(problem.cameras[previous], rows[previous])


def _weigh(group: ConstraintGroup, values: FloatArray) -> FloatArray:
    return np.sqrt(group.member_weights).reshape(-1, *[1] * (values.ndim - 1)) * np.nan_to_num(values)


def _add_derivatives(
    entries: FloatArray,
    errors: Callable[[_Cameras], FloatArray],
    at: _Cameras,
    cameras: IndexArray,
    problem: Problem,
    columns: CameraColumns,
) -> None:
    """Add central differences by the parameters of one side to their columns."""
    members = np.arange(len(cameras))
    lengths = np.ones(len(cameras)) * (np.ptp(problem.centres, axis=0).max() / problem.num_cameras or 1.0)
    for k in range(POSE_SIZE):
        steps = _STEP * (lengths if k >= 3 else np.ones_like(lengths))
        ends = [errors(replace(at, poses=moved_poses(at.poses, k, s))) for s in (steps, -steps)]
        entries[members, :, columns.pose[cameras, k]] += (ends[0] - ends[1]) / (2 * steps[:, None])
    for k in columns.free_intrinsics:
        step = np.zeros_like(at.intrinsics)
        step[:, k] = steps = _STEP * np.maximum(np.abs(at.intrinsics[:, k]), 1.0)
        ends = [errors(replace(at, intrinsics=at.intrinsics + s * step)) for s in (1, -1)]
        column = columns.intrinsics[problem.intrinsics_index[cameras], k]
        entries[members, :, column] += (ends[0] - ends[1]) / (2 * steps[:, None])


def _errors(group: ConstraintGroup, problem: Problem, here: _Cameras, previous: _Cameras) -> FloatArray:
    """(n, r) errors over the root of their dimension; NaN fills rows of members with fewer entries."""
    if group.kind in ("orientation-reprojections", "smoothing-reprojections"):
        return _image_errors(group, problem, here, previous)
    if group.kind in ("focal", "principal-point"):
        return _intrinsic_errors(group, problem, here, previous)
    values = np.zeros(0) if group.values is None else group.values
    errors = _POSE_ERRORS[group.kind](here, previous, values)
    entries = int(np.prod(errors.shape[1:]))
    return np.asarray(errors.reshape(group.num_members, entries) / np.sqrt(entries))


def _rotation_error(here: _Cameras, measured: FloatArray) -> FloatArray:
    return np.asarray(here.inverse_rotations @ measured - np.eye(3)).reshape(-1, 9)


def _pose_error(here: _Cameras, rotations: FloatArray, centres: FloatArray) -> FloatArray:
    apart = (here.inverse_rotations @ (centres - here.centres)[:, :, None])[:, :, 0]
    return np.concatenate([_rotation_error(here, rotations), apart], axis=1)


def _displacement_error(here: _Cameras, previous: _Cameras, values: FloatArray) -> FloatArray:
    centres = previous.centres + (previous.rotations @ values[:, :, 3:])[:, :, 0]
    return _pose_error(here, previous.rotations @ values[:, :, :3], centres)


def _smoothing_error(here: _Cameras, previous: _Cameras) -> FloatArray:
    a, b = (
        np.concatenate([c.inverse_rotations, -c.inverse_rotations @ c.centres[:, :, None]], axis=2)
        for c in (here, previous)
    )
    return np.asarray(a - b)


_POSE_ERRORS: dict[str, Callable[[_Cameras, _Cameras, FloatArray], FloatArray]] = {
    "pose": lambda c, _, v: _pose_error(c, v[:, :, :3], v[:, :, 3]),
    "position": lambda c, _, v: c.centres - v,
    "orientation": lambda c, _, v: _rotation_error(c, v),
    "displacement-pose": _displacement_error,
    "displacement-translation": lambda c, p, v: c.centres - p.centres - v,
    "displacement-rotation": lambda c, p, v: _rotation_error(c, p.rotations @ v),
    "displacement-rotation-log": lambda c, p, v: log(
        np.swapaxes(v, 1, 2) @ p.inverse_rotations @ c.rotations
    ),
    "scale": lambda c, p, v: np.linalg.norm(c.centres - p.centres, axis=1) - v,
    "smoothing": lambda c, p, _: _smoothing_error(c, p),
}


def _intrinsic_errors(
    group: ConstraintGroup, problem: Problem, here: _Cameras, previous: _Cameras
) -> FloatArray:
    names = list(problem.intrinsic_names)
    if group.kind == "focal":
        f = here.intrinsics[:, names.index("f")]
        target = previous.intrinsics[:, names.index("f")] if group.values is None else group.values
        return np.asarray(np.log(target / f)[:, None])
    centre = [names.index("cx"), names.index("cy")]
    target = previous.intrinsics[:, centre] if group.values is None else group.values
    return np.asarray((here.intrinsics[:, centre] - target) / np.sqrt(2))


def _image_errors(group: ConstraintGroup, problem: Problem, here: _Cameras, previous: _Cameras) -> FloatArray:
    sizes = np.array([len(x) for x in group.points], dtype=np.int64)
    other = previous.poses
    if group.kind == "orientation-reprojections":
        assert group.values is not None
        other = np.concatenate([group.values, here.centres[:, :, None]], axis=2)
    apart = _images(group, problem, here.poses) - _images(group, problem, other)
    errors = np.full((group.num_members, 2 * int(sizes.max(initial=0))), np.nan)
    for k, (begin, size) in enumerate(zip(np.cumsum(sizes) - sizes, sizes, strict=True)):
        errors[k, : 2 * size] = apart[begin : begin + size].ravel() / np.sqrt(size)
    return errors


def _images(group: ConstraintGroup, problem: Problem, poses: FloatArray) -> FloatArray:
    """Images of the frozen points of all members, without distortion: minus the residuals of pixels at 0."""
    points = np.concatenate([np.zeros((0, 3)), *group.points])
    camera = np.repeat(np.arange(group.num_members), [len(x) for x in group.points]).astype(np.int32)
    row = problem.intrinsics[problem.intrinsics_index[_pairs(group)[:, 1]]]
    named = dict(zip(problem.intrinsic_names, row.T, strict=True))
    values = [named.get(name, np.full(len(row), default)) for name, default in _PINHOLE.items()]
    index = np.arange(len(points), dtype=np.int32)
    pinhole, pixels = np.stack(values, axis=1), np.zeros((len(points), 2))
    imagined = Problem("calibrated", poses, pinhole, points, camera, index, pixels)
    return -np.asarray(_core.residuals(core_arrays(imagined)))
