"""What a SLAM run reads: which tracks each frame sees, and where."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray, IndexArray, finite_array, require_increasing


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


class FrameSource(Protocol):
    """Where frames come from, one after the other: tracks read from a file, or a camera that is running.

    Parameters
    ----------
    *args, **kwargs
        Those of the class that follows this protocol.
    """

    @property
    def intrinsics(self) -> FloatArray:
        """``(f, aspect, cx, cy, skew)`` of the camera, float64."""

    def __len__(self) -> int:
        """How many frames are expected."""

    def __iter__(self) -> Iterator[Frame]:
        """Give the frames in order; later ones have later times."""


class TrackSequence:
    """Tracks of one calibrated camera over n frames.

    Parameters
    ----------
    t_s : (n,)
        Time of each frame [s], increasing.
    frame_index, track_index : (M,) int
        Frame and track of each observation.
    pixels : (M, 2)
        Where the frame sees the track [px].
    intrinsics : (5,)
        ``(f, aspect, cx, cy, skew)``.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, an index is out of range, the stamps do not increase, or
        a frame sees a track twice.
    """

    def __init__(
        self,
        t_s: ArrayLike,
        frame_index: ArrayLike,
        track_index: ArrayLike,
        pixels: ArrayLike,
        intrinsics: ArrayLike,
    ) -> None:
        self.t_s = finite_array("t_s", t_s, (-1,))
        require_increasing("t_s", self.t_s)
        self.intrinsics = finite_array("intrinsics", intrinsics, (5,))
        frames = np.asarray(frame_index, dtype=np.int32)
        tracks = np.asarray(track_index, dtype=np.int32)
        seen = finite_array("pixels", pixels, (len(frames), 2))
        if len(tracks) != len(frames):
            raise InvalidArgument(f"track_index: {len(tracks)} entries for {len(frames)} observations")
        if len(frames) and not (frames.min() >= 0 and frames.max() < len(self.t_s)):
            raise InvalidArgument(f"frame_index: must be in [0, {len(self.t_s)})")
        if len(tracks) and tracks.min() < 0:
            raise InvalidArgument("track_index: must not be negative")
        order = np.lexsort((tracks, frames))
        self._tracks, self._pixels, ordered = tracks[order], seen[order], frames[order]
        if ((np.diff(self._tracks) == 0) & (np.diff(ordered) == 0)).any():
            raise InvalidArgument("track_index: a frame sees a track twice")
        self._begin = np.searchsorted(ordered, np.arange(len(self.t_s) + 1))
        self.num_tracks = int(tracks.max()) + 1 if len(tracks) else 0

    def __len__(self) -> int:
        return len(self.t_s)

    def __iter__(self) -> Iterator[Frame]:
        return map(self.frame, range(len(self)))

    def frame(self, number: int) -> Frame:
        """Frame of that number."""
        return Frame(number, float(self.t_s[number]), self.view(number))

    def view(self, frame: int) -> View:
        """What `frame` sees."""
        span = slice(self._begin[frame], self._begin[frame + 1])
        return View(self._tracks[span], self._pixels[span])


def common(a: View, b: View) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Positions of the tracks that both see, in `a` and in `b`."""
    _, in_a, in_b = np.intersect1d(a.tracks, b.tracks, assume_unique=True, return_indices=True)
    return in_a, in_b
