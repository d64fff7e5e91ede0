"""Frames of a camera in order of time: the tracks that each image observes, with pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray, IndexArray, finite_array, number_array, shaped_array
from sfmcpp.model.checks import require_positive


@dataclass(frozen=True, eq=False)
class RightView:
    """Observations of the left camera's tracks by the right camera of a pair.

    Both have the same intrinsics and axes, as those of a rectified pair.

    Attributes
    ----------
    pixels : (n, 2) float64
        Where it sees each track [px]; not a number where it does not.
    baseline_m : float or (3,) float64
        How far its centre is from that of the left one, along x; or where it is in the axes of both [m].
    """

    pixels: FloatArray
    baseline_m: float | FloatArray

    if TYPE_CHECKING:  # what is given need not be what is held

        def __init__(self, pixels: ArrayLike, baseline_m: float | ArrayLike) -> None: ...

    @property
    def centre_m(self) -> FloatArray:
        """(3,) centre of the right camera in the left one's axes [m]."""
        along = np.shape(self.baseline_m) == ()
        return np.array([self.baseline_m, 0.0, 0.0] if along else self.baseline_m, dtype=np.float64)

    def only(self, rows: slice | NDArray[np.bool_] | NDArray[np.intp]) -> RightView:
        """The observations of some of the tracks."""
        return RightView(self.pixels[rows], self.baseline_m)


@dataclass(frozen=True, eq=False)
class View:
    """Observations of one frame.

    Attributes
    ----------
    tracks : (n,) int32
        Numbers of the tracks, each once, ascending. Given to a step of a run: any integers from 0 on, in any
        order.
    pixels : (n, 2) float64
        Where it sees them [px].
    right : RightView, optional
        What a second camera sees of them.
    """

    tracks: IndexArray
    pixels: FloatArray
    right: RightView | None = None

    if TYPE_CHECKING:  # what is given need not be what is held

        def __init__(self, tracks: ArrayLike, pixels: ArrayLike, right: RightView | None = None) -> None: ...

    def __post_init__(self) -> None:
        for name in ("tracks", "pixels"):
            given = getattr(self, name)
            if not isinstance(given, np.ndarray):
                object.__setattr__(self, name, number_array(f"view.{name}", given))

    def only(self, mask: NDArray[np.bool_]) -> View:
        """The view with only the tracks of a mask (n,)."""
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


def checked_view(view: View) -> View:
    """The view with its tracks ascending.

    Parameters
    ----------
    view : View
        Its tracks may have any integers from 0 on, in any order.

    Returns
    -------
    View

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a track is no integer, negative or there twice, a pixel is not finite, or the
        baseline is not positive, or zero where it is a vector.
    """
    tracks = number_array("view.tracks", view.tracks)
    if tracks.ndim != 1:
        raise InvalidArgument(f"view.tracks: shape {tracks.shape}, must be (any)")
    if not len(tracks):
        tracks = tracks.astype(np.int32)
    if tracks.dtype.kind not in "iu":
        raise InvalidArgument(f"view.tracks: dtype {tracks.dtype}, must be integers")
    pixels, right = finite_array("view.pixels", view.pixels, (len(tracks), 2)), view.right
    if right is not None:
        right = RightView(shaped_array("view.right.pixels", right.pixels, (len(tracks), 2)), right.baseline_m)
        require_baseline("view.right.baseline_m", right.baseline_m)
    order = np.argsort(tracks, kind="stable")
    tracks = tracks[order]
    if len(tracks) and tracks[0] < 0:
        raise InvalidArgument(f"view.tracks: {tracks[0]} is negative, must be 0 or above")
    twice = np.flatnonzero(tracks[1:] == tracks[:-1])
    if len(twice):
        raise InvalidArgument(f"view.tracks: track {tracks[twice[0]]} is there twice, must be once")
    return View(tracks, pixels[order], right and right.only(order))


def require_baseline(name: str, value: float | ArrayLike) -> None:
    """Raise InvalidArgument unless `value` is a positive length, or a vector (3,) that is not zero [m]."""
    if np.shape(value) == ():
        require_positive(name, cast("float", value))
    elif not finite_array(name, value, (3,)).any():
        raise InvalidArgument(f"{name} = 0, 0, 0: the cameras of a pair must not be in one place")


def common(a: View, b: View) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Positions of the tracks that both see, in `a` and in `b`."""
    _, in_a, in_b = np.intersect1d(a.tracks, b.tracks, assume_unique=True, return_indices=True)
    return in_a, in_b
