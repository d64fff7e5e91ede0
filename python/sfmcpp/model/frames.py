"""What the images of a camera see, one after the other: tracks and where they are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import FloatArray, IndexArray


@dataclass(frozen=True, eq=False)
class View:
    """What one frame sees.

    Attributes
    ----------
    tracks : (n,) int32
        Tracks, ascending.
    pixels : (n, 2) float64
        Where it sees them [px].
    """

    tracks: IndexArray
    pixels: FloatArray

    def only(self, mask: NDArray[np.bool_]) -> View:
        """Those of `mask` (n,)."""
        return View(self.tracks[mask], self.pixels[mask])


@dataclass(frozen=True, eq=False)
class Frame:
    """One image of the camera, as the loop takes it.

    Attributes
    ----------
    number : int
        Its number, counted from 0.
    t_s : float
        Its time [s].
    view : View
        What it sees.
    """

    number: int
    t_s: float
    view: View


def common(a: View, b: View) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Positions of the tracks that both see, in `a` and in `b`."""
    _, in_a, in_b = np.intersect1d(a.tracks, b.tracks, assume_unique=True, return_indices=True)
    return in_a, in_b
