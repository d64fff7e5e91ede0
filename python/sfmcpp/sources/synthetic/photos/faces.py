"""Textured rectangles, and the boxes and walls that are made of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.model.arrays import FloatArray

Samples = NDArray[np.float32]

# Of the noise before it is bent: how much of it is saturated, which makes edges and corners.
_CONTRAST = 1.4
_MIDDLE, _RANGE = 128.0, 105.0
Tint = tuple[float, float, float]
GREY: Tint = (1.0, 1.0, 1.0)
# Textures of larger faces are coarser than asked for.
_MOST_TEXELS = 4096
_LEAST_TINT = 0.7


@dataclass(frozen=True, eq=False)
class Texture:
    """Grey levels and their means over 2×2, 4×4 … texels, all in one array.

    Attributes
    ----------
    texels : (n,) uint8
        One level after the other, the finest first, each by rows.
    widths, heights, begins : (L,) int
        Size of each level, and where it begins.
    """

    texels: NDArray[np.uint8]
    widths: NDArray[np.int32]
    heights: NDArray[np.int32]
    begins: NDArray[np.int32]

    @classmethod
    def of(cls, grey: NDArray[np.float32]) -> Texture:
        """Texture of grey levels (height, width) in 0 … 255; width and height must be even."""
        levels = [grey]
        while min(levels[-1].shape) >= 4:
            fine = levels[-1][: levels[-1].shape[0] // 2 * 2, : levels[-1].shape[1] // 2 * 2]
            total = fine[::2, ::2] + fine[1::2, ::2] + fine[::2, 1::2] + fine[1::2, 1::2]
            levels.append((total / 4).astype(np.float32))
        heights, widths = np.array([level.shape for level in levels], dtype=np.int32).T
        begins = np.concatenate([[0], np.cumsum(heights * widths)[:-1]]).astype(np.int32)
        texels = np.concatenate([np.rint(level).astype(np.uint8).reshape(-1) for level in levels])
        return cls(texels, widths, heights, begins)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [texels]."""
        return int(self.widths[0]), int(self.heights[0])

    def at(self, u: Samples, v: Samples, texels_seen: Samples) -> Samples:
        """Grey levels (n,) at `u`, `v` (n,) in 0 … 1, means over squares of `texels_seen` (n,) texels."""
        level = np.log2(np.maximum(texels_seen, 1.0)).clip(0, len(self.begins) - 1)
        lower = level.astype(np.int32)
        upper = np.minimum(lower + 1, len(self.begins) - 1)
        part = level - lower
        return np.asarray((1 - part) * self._level_at(lower, u, v) + part * self._level_at(upper, u, v))

    def _level_at(self, level: NDArray[np.int32], u: Samples, v: Samples) -> Samples:
        """Bilinear interpolation between the texels of a level of its own for each sample."""
        width, height = self.widths[level], self.heights[level]
        x = (u * width - np.float32(0.5)).clip(0, width - 1)
        y = (v * height - np.float32(0.5)).clip(0, height - 1)
        left = np.minimum(x.astype(np.int32), np.maximum(width - 2, 0))
        top = np.minimum(y.astype(np.int32), np.maximum(height - 2, 0))
        a, b = (x - left).astype(np.float32), (y - top).astype(np.float32)
        first = self.begins[level] + top * width + left
        right, below = (width > 1).astype(np.int32), np.where(height > 1, width, 0)
        upper = self.texels[first] * (1 - a) + self.texels[first + right] * a
        lower = self.texels[first + below] * (1 - a) + self.texels[first + below + right] * a
        return np.asarray(upper * (1 - b) + lower * b)


def noise_texture(size: tuple[int, int], rng: np.random.Generator, contrast: float = 1.0) -> Texture:
    """Noise whose every octave is equally strong: looked at from anywhere, it has corners and blobs.

    Parameters
    ----------
    size : (int, int)
        Width and height [texels].
    rng : numpy.random.Generator
        Source of randomness.
    contrast : float
        Part of the range of grey levels that it takes.

    Returns
    -------
    Texture
    """
    from scipy.fft import irfft2, rfft2

    width, height = (max(8, 2 * round(n / 2)) for n in size)
    white = rng.standard_normal((height, width), dtype=np.float32)
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None, :])
    frequency[0, 0] = np.inf
    grey = irfft2(rfft2(white) / frequency.astype(np.float32), s=(height, width))
    grey = np.tanh(_CONTRAST * (grey - grey.mean()) / grey.std())
    return Texture.of((_MIDDLE + contrast * _RANGE * grey).astype(np.float32))


def plain_texture(grey: float) -> Texture:
    """One grey level without any detail."""
    return Texture.of(np.full((2, 2), grey, dtype=np.float32))


@dataclass(frozen=True, eq=False)
class Face:
    """A textured rectangle, seen from the side from which its texture's rows run to the right and down.

    Attributes
    ----------
    corner : (3,) float64
        Upper left corner [m].
    along, down : (3,) float64
        From there to the upper right and to the lower left corner [m].
    texture : Texture
        What is on it.
    tint : (float, float, float)
        Parts of red, green and blue that it reflects.
    """

    corner: FloatArray
    along: FloatArray
    down: FloatArray
    texture: Texture
    tint: Tint = GREY

    @property
    def corners(self) -> FloatArray:
        """(4, 3) its corners [m]."""
        steps = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        return np.asarray(self.corner + steps @ np.stack([self.along, self.down]))


class Painter:
    """Makes faces with textures of their own.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of randomness.
    texel_m : float
        Edge of a texel [m].
    """

    def __init__(self, rng: np.random.Generator, texel_m: float) -> None:
        self._rng, self._texel_m = rng, texel_m

    def face(
        self, corner: ArrayLike, along: ArrayLike, down: ArrayLike, texture: Texture | None = None
    ) -> Face:
        """One face, its texture drawn unless given; see :class:`Face`."""
        first, second = np.asarray(along, dtype=np.float64), np.asarray(down, dtype=np.float64)
        tint = tuple(float(part) for part in self._rng.uniform(_LEAST_TINT, 1.0, 3))
        painted = texture or self.texture(float(np.linalg.norm(first)), float(np.linalg.norm(second)))
        return Face(np.asarray(corner, dtype=np.float64), first, second, painted, tint)  # type: ignore[arg-type]

    def texture(self, width_m: float, height_m: float, contrast: float = 1.0) -> Texture:
        """A new texture for a face of that size."""
        width, height = (min(_MOST_TEXELS, round(size / self._texel_m)) for size in (width_m, height_m))
        return noise_texture((width, height), self._rng, contrast)

    def ground(self, lower: ArrayLike, upper: ArrayLike, texture: Texture | None = None) -> Face:
        """The rectangle z = 0 between two corners (x, y), seen from above."""
        (x0, y0), (x1, y1) = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
        return self.face((x0, y1, 0), (x1 - x0, 0, 0), (0, y0 - y1, 0), texture)

    def wall(self, left: ArrayLike, right: ArrayLike, bottom_m: float, top_m: float) -> Face:
        """An upright rectangle, seen from where `left` (x, y) is on the left and `right` on the right."""
        (x0, y0), (x1, y1) = np.asarray(left, dtype=np.float64), np.asarray(right, dtype=np.float64)
        return self.face((x0, y0, top_m), (x1 - x0, y1 - y0, 0), (0, 0, bottom_m - top_m))

    def box(self, lower: ArrayLike, upper: ArrayLike, sides: Sequence[Texture] = ()) -> list[Face]:
        """Four sides and the top of a box, seen from outside; `sides`, if given, are painted on the four."""
        (x0, y0, z0), (x1, y1, z1) = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
        ring = [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
        faces = []
        for number, (left, right) in enumerate(pairwise(ring)):
            along = (right[0] - left[0], right[1] - left[1], 0)
            texture = sides[number] if len(sides) else None
            faces.append(self.face((*left, z1), along, (0, 0, z0 - z1), texture))
        return [*faces, self.face((x0, y1, z1), (x1 - x0, 0, 0), (0, y0 - y1, 0))]
