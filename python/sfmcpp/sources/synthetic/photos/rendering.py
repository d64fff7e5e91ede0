"""Ray casting of textured rectangles, with several rays per pixel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.synthetic.image_geometry import ImageGeometry, distort
from sfmcpp.sources.synthetic.photos.faces import Face, Samples

Picture = NDArray[np.uint8]

# Rays in a row and a column of each pixel.
_FINE = 2
_NEAREST_M = 0.1
_SKY_TOP, _SKY_BOTTOM = np.array([150.0, 180.0, 225.0]), np.array([225.0, 232.0, 240.0])
_ITERATIONS = 12
_EDGE_STEPS = 9
# Where a face is longer than wide in the image, it is blurred less along its length than would be right.
_LONGEST_BLUR = 2.0


@dataclass(frozen=True)
class _RenderWindow:
    """Part of an image: rows and columns of rays."""

    rows: slice
    columns: slice


class Eye:
    """A camera that makes pictures.

    Parameters
    ----------
    geometry : ImageGeometry
        Focal length, size and distortion; of camera model ``"perspective"``.
    """

    def __init__(self, geometry: ImageGeometry) -> None:
        self._geometry = geometry
        width, height = geometry.image_size
        centre = geometry.principal_point_px
        x = ((np.arange(_FINE * width) + 0.5) / _FINE - centre[0]) / geometry.focal_px
        y = ((np.arange(_FINE * height) + 0.5) / _FINE - centre[1]) / geometry.focal_px
        self._x, self._y = self._undistorted(*np.meshgrid(x, y))

    def _undistorted(self, x: FloatArray, y: FloatArray) -> tuple[Samples, Samples]:
        """Directions of rays; the radius by Newton's method, within the image: beyond, the lens may fold."""
        k1, k2 = self._geometry.distortion
        image = np.hypot(x, y)
        radius = image.copy()
        for _ in range(_ITERATIONS if self._geometry.is_distorted else 0):
            square = radius**2
            error = radius * (1 + square * (k1 + square * k2)) - image
            radius -= error / (1 + square * (3 * k1 + 5 * square * k2))
            radius = radius.clip(0, self._geometry.corner_tangent)
        scale = radius / np.maximum(image, 1e-12)
        return (x * scale).astype(np.float32), (y * scale).astype(np.float32)

    def picture(self, faces: Sequence[Face], camera: FloatArray) -> FloatArray:
        """Render `faces` as a `camera` (3, 4) sees them: (height, width, 3) red, green, blue in 0 … 255."""
        shape = self._x.shape
        nearness = np.zeros(shape, dtype=np.float32)
        seen = np.full(shape, -1, dtype=np.int16)
        for number, face in enumerate(faces):
            self._cast_rays(number, face, camera, nearness, seen)
        width, height = self._geometry.image_size
        total = np.zeros((height, width, 3))
        for number in np.unique(seen):
            rows, columns = np.nonzero(seen == number)
            colours = self._colours(None if number < 0 else faces[number], camera, rows, columns)
            pixel = rows // _FINE * width + columns // _FINE
            for channel in range(3):
                found = np.bincount(pixel, colours[:, channel], width * height)
                total[:, :, channel] += found.reshape(height, width)
        return np.asarray(total / _FINE**2)

    def _cast_rays(
        self, number: int, face: Face, camera: FloatArray, nearness: Samples, seen: NDArray[np.int16]
    ) -> None:
        """Note a face on all rays on which it is the nearest so far."""
        window = self._window(face, camera)
        lines = _lines(face, camera)
        if window is None or lines is None:
            return
        at = (window.rows, window.columns)
        x, y = self._x[at], self._y[at]
        u, v, near = (line[0] * x + line[1] * y + line[2] for line in lines)
        first = (near > nearness[at]) & (u >= 0) & (v >= 0) & (u <= near) & (v <= near)
        first &= near < 1 / _NEAREST_M
        nearness[at][first] = near[first]
        seen[at][first] = number

    def _window(self, face: Face, camera: FloatArray) -> _RenderWindow | None:
        """Rays that may meet a face: all, unless all of it is well in front of the camera."""
        whole = _RenderWindow(slice(0, self._x.shape[0]), slice(0, self._x.shape[1]))
        corners = (face.corners - camera[:, 3]) @ camera[:, :3]
        if (corners[:, 2] <= _NEAREST_M).all():
            return None
        steps = np.linspace(0, 1, _EDGE_STEPS)[:, None]
        edges = [a + steps * (b - a) for a, b in zip(corners, np.roll(corners, 1, axis=0), strict=True)]
        outline = np.concatenate(edges)
        tangents = outline[:, :2] / np.maximum(outline[:, 2:], _NEAREST_M)
        is_wide = np.hypot(*tangents.T) > 1.05 * self._geometry.corner_tangent
        if (corners[:, 2] <= _NEAREST_M).any() or (self._geometry.is_distorted and is_wide.any()):
            return whole
        image = self._geometry.focal_px * distort(tangents, self._geometry.distortion)
        rays = _FINE * (image + self._geometry.principal_point_px)
        low = np.floor(rays.min(axis=0) - 2 * _FINE).clip(0, self._x.shape[::-1]).astype(int)
        high = np.ceil(rays.max(axis=0) + 2 * _FINE).clip(0, self._x.shape[::-1]).astype(int)
        if (low >= high).any():
            return None
        return _RenderWindow(slice(low[1], high[1]), slice(low[0], high[0]))

    def _colours(
        self,
        face: Face | None,
        camera: FloatArray,
        rows: NDArray[np.intp],
        columns: NDArray[np.intp],
    ) -> FloatArray:
        """Colours (n, 3) of the rays that meet a face, or nothing."""
        x, y = self._x[rows, columns], self._y[rows, columns]
        lines = None if face is None else _lines(face, camera)
        if face is None or lines is None:
            up = (camera[2, 0] * x + camera[2, 1] * y + camera[2, 2]) / np.sqrt(x * x + y * y + 1)
            part = up.clip(0, 1)[:, None]
            return np.asarray(part * _SKY_TOP + (1 - part) * _SKY_BOTTOM)
        u, v, near = (line[0] * x + line[1] * y + line[2] for line in lines)
        u, v = u / near, v / near
        width, height = face.texture.size
        step = 1 / (_FINE * self._geometry.focal_px)
        across, along = (
            step
            / near
            * np.hypot(width * (lines[0][k] - u * lines[2][k]), height * (lines[1][k] - v * lines[2][k]))
            for k in (0, 1)
        )
        longest, shortest = np.maximum(across, along), np.minimum(across, along)
        grey = face.texture.at(u, v, np.maximum(longest / _LONGEST_BLUR, shortest).astype(np.float32))
        return np.asarray(grey[:, None] * np.array(face.tint))


def _lines(face: Face, camera: FloatArray) -> Samples | None:
    """(3, 3): rows that give u/z, v/z and 1/z of a face on the ray (x, y, 1); None if its back is seen.

    With the plane's normal n = along × down, 1/z = n·d / n·(corner − c) on the ray d, and u and v are told by
    the vectors that are dual to `along` and `down`.
    """
    normal = np.cross(face.along, face.down)
    offset = face.corner - camera[:, 3]
    height = float(normal @ offset)
    if height <= 0:
        return None
    nearness = normal / height
    square = normal @ normal
    duals = np.cross(face.down, normal) / square, np.cross(normal, face.along) / square
    lines = [dual - (dual @ offset) * nearness for dual in duals]
    return np.asarray(np.stack([*lines, nearness]) @ camera[:, :3], dtype=np.float32)
