"""Frames of one camera, and those of tracks that are known."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.pinhole import PINHOLE, pinhole_rows
from sfmcpp.model.arrays import (
    ANY,
    FloatArray,
    IndexArray,
    finite_array,
    index_array,
    require_increasing,
    shaped_array,
)
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.model.frames import Frame, RightView, View, require_baseline

_DENSE_ENOUGH = 100_000
_DISTORTED = len(PERSPECTIVE)


class RightUse(NamedTuple):
    """In how many frames right images are used, and how many corners they show there on average."""

    frames: int
    corners: float


class FrameSource(ABC):
    """Source of frames, one after the other.

    Attributes
    ----------
    intrinsics : (5,) or (12,) float64
        ``(f, aspect, cx, cy, skew)`` of the camera; with distortion all of the model ``"perspective"``.
    num_tracks : int
        Tracks met so far.
    corners : str or None
        What is followed in images; None for tracks that were followed before.
    seconds : float or None
        Spent so far on reading images and following corners [s]; None where there are no images.
    assumed_fps : float or None
        Frames per second where nothing tells their times; None where something does.
    doubt : str or None
        What makes their times doubtful, a sentence.
    camera_doubt : str or None
        What makes the intrinsics doubtful, a sentence.
    mask_doubt : str or None
        What makes the mask doubtful, a sentence.
    right_use : RightUse or None
        How much right images show, of those looked at so far; None where there are none.
    right_doubts : sequence of str
        What makes right images doubtful, or which are left out, in sentences, once all frames have been seen.
    image_size : tuple of int or None
        Width and height of the images [px], once one has been seen; None for tracks.
    image_names : sequence of str
        Names of the files, by the number of the frame; empty for tracks and videos.
    repeated : sequence of int
        Frames so far whose image is that of the frame before, to the last bit.
    shortfall : str or None
        As of :class:`sfmcpp.sources.vision.Frames`, once all frames have been seen.
    first_pixel_px : float
        Where the centre of the top left pixel is, in u and v [px]: 0.5 where pixels count from the corner of
        the image. Tracks are taken for such, as they do not tell.
    """

    intrinsics: FloatArray
    num_tracks: int = 0
    corners: str | None = None
    seconds: float | None = None
    assumed_fps: float | None = None
    doubt: str | None = None
    camera_doubt: str | None = None
    mask_doubt: str | None = None
    right_use: RightUse | None = None
    right_doubts: Sequence[str] = ()
    image_size: tuple[int, int] | None = None
    image_names: Sequence[str] = ()
    repeated: Sequence[int] = ()
    shortfall: str | None = None
    first_pixel_px: float = 0.5

    @property
    def assumption(self) -> str | None:
        """A sentence on the rate that is assumed; None where something tells the times."""
        if self.assumed_fps is None:
            return None
        return f"{self.assumed_fps:g} frames per second assumed: neither times.txt nor --fps is given"

    @property
    def unreadable(self) -> Mapping[str, str]:
        """Reason for each image left out so far because it cannot be read, by its name."""
        return MappingProxyType({})

    @property
    @abstractmethod
    def span_s(self) -> tuple[float, float]:
        """Times of the first frame and of the last one expected [s]."""

    def identity(self) -> dict[str, Any]:
        """Identity of these frames, as far as it is known before they are read."""
        return {"camera": self.intrinsics, "count": len(self), "times": self.span_s}

    @abstractmethod
    def __len__(self) -> int:
        """How many frames are expected."""

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """Give the frames in order; later ones have later times."""


class TrackSequence(FrameSource):
    """Tracks of one calibrated camera over n frames.

    Parameters
    ----------
    t_s : (n,)
        Time of each frame [s], increasing.
    frame_index, track_index : (M,) int
        Frame and track of each observation. A map has room for every number: where one is larger than M and
        than 100,000, tracks are numbered anew, in the order of their numbers.
    pixels : (M, 2)
        Where the frame sees the track [px].
    intrinsics : (5,) or (12,)
        ``(f, aspect, cx, cy, skew)``; with distortion all of the model ``"perspective"``.
    right_px : (M, 2), optional
        Where the right camera of a rectified pair sees it [px]; not a number where it does not.
    baseline_m : float or (3,), optional
        How far that is beside the left one, or where it is in the axes of both [m].

    Raises
    ------
    InvalidArgument
        If there is no frame, a shape is wrong, a number is not finite, an index is out of range, the stamps
        do not increase, or a frame sees a track twice.
    """

    def __init__(
        self,
        t_s: ArrayLike,
        frame_index: ArrayLike,
        track_index: ArrayLike,
        pixels: ArrayLike,
        intrinsics: ArrayLike,
        right_px: ArrayLike | None = None,
        baseline_m: float | ArrayLike | None = None,
    ) -> None:
        self.t_s = finite_array("t_s", t_s, (-1,))
        if not len(self.t_s):
            raise InvalidArgument("t_s: there is no frame, must be at least one")
        require_increasing("t_s", self.t_s)
        given = finite_array("intrinsics", intrinsics, (ANY,))
        width = _DISTORTED if len(given) == _DISTORTED else PINHOLE
        self.intrinsics = pinhole_rows(finite_array("intrinsics", given, (width,)))
        frames = index_array("frame_index", frame_index)
        tracks = index_array("track_index", track_index)
        seen = finite_array("pixels", pixels, (len(frames), 2))
        if len(tracks) != len(frames):
            raise InvalidArgument(f"track_index: {len(tracks)} entries for {len(frames)} observations")
        if len(frames) and not (frames.min() >= 0 and frames.max() < len(self.t_s)):
            raise InvalidArgument(f"frame_index: must be in [0, {len(self.t_s)})")
        if len(tracks) and tracks.min() < 0:
            raise InvalidArgument("track_index: must not be negative")
        tracks = _numbered_densely(tracks)
        order = np.lexsort((tracks, frames))
        self._tracks, self._pixels, ordered = tracks[order], seen[order], frames[order]
        self._right = None if right_px is None else _right_view(right_px, baseline_m, len(frames)).only(order)
        if ((np.diff(self._tracks) == 0) & (np.diff(ordered) == 0)).any():
            raise InvalidArgument("track_index: a frame sees a track twice")
        self._begin = np.searchsorted(ordered, np.arange(len(self.t_s) + 1))
        self.num_tracks = int(tracks.max()) + 1 if len(tracks) else 0

    def identity(self) -> dict[str, Any]:
        """All that the frames see."""
        seen = {"times": self.t_s, "tracks": self._tracks, "begin": self._begin, "pixels": self._pixels}
        right = {} if self._right is None else {"right": vars(self._right)}
        return {"camera": self.intrinsics, **seen, **right}

    def __len__(self) -> int:
        return len(self.t_s)

    def __iter__(self) -> Iterator[Frame]:
        return map(self.frame, range(len(self)))

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and of the last frame [s]."""
        return float(self.t_s[0]), float(self.t_s[-1])

    def frame(self, number: int) -> Frame:
        """Frame of that number."""
        return Frame(number, float(self.t_s[number]), self.view(number))

    def view(self, frame: int) -> View:
        """Observations of `frame`."""
        span = slice(self._begin[frame], self._begin[frame + 1])
        right = None if self._right is None else self._right.only(span)
        return View(self._tracks[span], self._pixels[span], right)


def _right_view(right_px: ArrayLike, baseline_m: float | ArrayLike | None, count: int) -> RightView:
    pixels = shaped_array("right_px", right_px, (count, 2))
    if baseline_m is None:
        raise InvalidArgument("baseline_m: missing, right_px needs it")
    require_baseline("baseline_m", baseline_m)
    return RightView(pixels, baseline_m)


def _numbered_densely(tracks: IndexArray) -> IndexArray:
    if tracks.max(initial=-1) <= max(len(tracks), _DENSE_ENOUGH):
        return tracks
    return np.unique(tracks, return_inverse=True)[1].astype(np.int32)
