"""Viewpoint of a page: up direction, centre and radius of the view, size of the cameras."""

from __future__ import annotations

import numpy as np

from sfmcpp.model.arrays import FloatArray

# What upright photos weigh beside horizontal ones, and looking down beside being held upright.
_TOPS, _DOWN = 0.05, 0.025
# Share of the points at either end of each axis that a view need not show.
_FAR = 0.05
_PARALLEL = 1e-6
_STRAIGHT = 0.9
# x axes of cameras are parallel if they leave so little in any other direction: a tenth of a radian or so.
_SQUARE_OF_PARALLEL = 0.02
# Centres lie in a plane if the variance across it is so much of the lesser in it, that so much of the other.
_ACROSS_PLANE, _ACROSS_LINE = 0.1, 0.01
# Cameras that are asked for their nearest neighbour, at most.
_ASKED = 500


def turn_upright(cameras: FloatArray) -> FloatArray:
    """Rotation from the world to x right, y ahead, z up, estimated from cameras (K, 3, 4) ``[R | c]``.

    People and drones keep the long side of an image level: up is what is most nearly orthogonal to the
    cameras' x axes. Where all of these are parallel, it is across the plane of the centres, as of a flight
    that keeps its heading; without such a plane where the tops of the cameras point, or what is behind
    cameras that look down. Ahead is where they look in the mean, or where the tops of those point that look
    down.
    """
    if not len(cameras):
        return np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    right, down, ahead = np.moveaxis(cameras[:, :, :3], 2, 0)
    tops, behind = -down.mean(axis=0), -ahead.mean(axis=0)
    level = right.T @ right / len(right)
    plane = _plane_normal(cameras[:, :, 3])
    if plane is not None and _is_upright(plane, level):
        up = plane
    else:
        up = np.linalg.eigh(level - _TOPS * np.outer(tops, tops) - _DOWN * np.outer(behind, behind))[1][:, 0]
    if up @ (tops + 0.5 * behind) < 0:
        up = -up
    # Of cameras that look straight down, the little that they look aside is any direction.
    looks_down = up @ behind > _STRAIGHT * np.linalg.norm(behind)
    return _upright_axes(up, *([tops] if looks_down else []), -behind, -down[0], ahead[0])


def _plane_normal(centres: FloatArray) -> FloatArray | None:
    """Unit normal of the plane in which most of the spread of centres (K, 3) is; None if there is none."""
    away = centres - centres.mean(axis=0)
    variances, axes = np.linalg.eigh(away.T @ away / len(away))
    across, least, most = variances
    if least <= _ACROSS_LINE * most or across > _ACROSS_PLANE * least:
        return None
    return np.asarray(axes[:, 0])


def _is_upright(normal: FloatArray, level: FloatArray) -> bool:
    """Whether the x axes, of mean square (3, 3) `level`, are parallel, and orthogonal to a normal."""
    return bool(
        np.linalg.eigvalsh(level)[1] < _SQUARE_OF_PARALLEL and normal @ level @ normal < _SQUARE_OF_PARALLEL
    )


def view_from_world(cameras: FloatArray) -> FloatArray:
    """Rotation to x right, y ahead, z up, of a camera under way.

    Up is where the tops of the cameras (K, 3, 4) point in the mean: on a vehicle they stand upright. Ahead is
    where the first one looks. Without cameras it is that of one with the axes of the world.
    """
    axes = cameras[:, :, :3] if len(cameras) else np.eye(3)[None]
    top, tops = -axes[0, :, 1], -axes[:, :, 1].mean(axis=0)
    length = float(np.linalg.norm(tops))
    up = tops / length if length > _PARALLEL else top
    return _upright_axes(up, axes[0, :, 2], top, axes[0, :, 0])


def _upright_axes(up: FloatArray, *ahead: FloatArray) -> FloatArray:
    """Rotation to x right, y ahead, z up: `ahead` is the first direction that is not parallel to `up`."""
    forward = next(level for direction in ahead if (level := _horizontal_part(direction, up)) is not None)
    return np.stack([np.cross(forward, up), forward, up])


def _horizontal_part(direction: FloatArray, up: FloatArray) -> FloatArray | None:
    """Unit vector along the part of a direction that is orthogonal to `up`; None if there is hardly any."""
    level = direction - (direction @ up) * up
    length = float(np.linalg.norm(level))
    return np.asarray(level / length) if length > _PARALLEL else None


def bounding_sphere(points: FloatArray, centres: FloatArray) -> tuple[FloatArray, float]:
    """Centre and radius of what a view should show: all cameras, and points but for the farthest.

    Parameters
    ----------
    points : (N, 3) float64
        Points.
    centres : (K, 3) float64
        Centres of cameras.
    """
    corners = [centres] if len(centres) else []
    if len(points):
        corners.append(np.quantile(points, [_FAR, 1 - _FAR], axis=0))
    if not corners:
        return np.zeros(3), 1.0
    ends = np.concatenate(corners)
    low, high = ends.min(axis=0), ends.max(axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low)) / 2 or 1.0


def camera_size(centres: FloatArray, radius: float) -> float:
    """How far in front of its centre (K, 3) the image of a camera is drawn, so that neighbours stay apart."""
    largest, smallest = 0.12 * radius, 0.01 * radius
    if len(centres) < 2:
        return largest
    asked = centres[:: -(-len(centres) // _ASKED)]
    squares = sum((asked[:, axis, None] - centres[:, axis]) ** 2 for axis in range(3))
    # The nearest of all is the camera itself.
    nearest = np.sqrt(np.partition(squares, 1, axis=1)[:, 1])
    return float(np.clip(0.6 * np.median(nearest), smallest, largest))
