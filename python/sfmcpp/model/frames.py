"""Frames of a camera in order of time: the tracks that each image observes, with pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import FloatArray, IndexArray


@dataclass(frozen=True, eq=False)
class RightView:
    """Observations of the left camera's tracks by the right camera of a pair.

    The pair is rectified: both have the same intrinsics and axes, and the right one is aside along x.

    Attributes
    ----------
    pixels : (n, 2) float64
        Where it sees each track [px]; not a number where it does not.
    baseline_m : float
        How far its centre is from that of the left one [m].
    """

    pixels: FloatArray
    baseline_m: float

    def only(self, rows: slice | NDArray[np.bool_] | NDArray[np.intp]) -> RightView:
        """The observations of some of the tracks."""
        return RightView(self.pixels[rows], self.baseline_m)


@dataclass(frozen=True, eq=False)
class View:
    """Observations of one frame.

    Attributes
    ----------
    tracks : (n,) int32
        Tracks, ascending.
    pixels : (n, 2) float64
        Where it sees them [px].
    right : RightView, optional
        What a second camera sees of them.
    """

    tracks: IndexArray
    pixels: FloatArray
    right: RightView | None = None

    def only(self, mask: NDArray[np.bool_]) -> View:
        """Those of `mask` (n,)."""
        return View(self.tracks[mask], self.pixels[mask], self.right and self.right.only(mask))


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
