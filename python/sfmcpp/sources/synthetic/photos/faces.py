"""Textured rectangles, and the boxes and walls that are made of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.synthetic.photos.textures import Texture, noise_texture

Tint = tuple[float, float, float]
GREY: Tint = (1.0, 1.0, 1.0)
# Textures of larger faces are coarser than asked for.
_MOST_TEXELS = 4096
_LEAST_TINT = 0.7


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
