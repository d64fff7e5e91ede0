"""Where the camera stands still, so that the rates of a gyroscope are its bias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.geometry.significance import mad_sigma
from sfmcpp.model import Gap
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame, common

# Shortest rest [s], and fewest tracks that tell.
_LEAST_S, _FEWEST = 1.0, 20
# Tracks of a camera that rests move by no more than noise about each axis [px] …
_LARGEST_NOISE_PX = 2.0
# … and all together, by a shift or a rotation of the image, by no more than this [px] and so many of its
# standard deviations: a median varies by 1.25 times as much as a mean.
_SAME_PX, _SAME_SIGMAS = 0.1, 3.0 * 1.25
# Tracks farther from the median than so many standard deviations are wrong, or move by themselves.
_INLIER_SIGMAS = 3.0


@dataclass
class Standstill:
    """The frames in a row whose tracks are where they were in the first of them.

    Attributes
    ----------
    first, last : Frame or None
        Of these frames; the same one while the camera moves, None before any.
    """

    first: Frame | None = None
    last: Frame | None = None

    def take(self, frame: Frame | None) -> Gap | None:
        """The rest that the next frame ends, if there was one; None: there is no next frame."""
        if self.first is not None and frame is not None and stands_still(self.first, frame):
            self.last = frame
            return None
        ended = self._rest()
        self.first = self.last = frame
        return ended

    def _rest(self) -> Gap | None:
        if self.first is None or self.last is None or self.last.t_s - self.first.t_s < _LEAST_S:
            return None
        return Gap(self.first.t_s, self.last.t_s)


def stands_still(before: Frame, after: Frame) -> bool:
    """Whether the tracks of two frames show no motion of the camera, above all no rotation."""
    in_before, in_after = common(before.view, after.view)
    if len(in_before) < _FEWEST:
        return False
    places = before.view.pixels[in_before]
    moved = after.view.pixels[in_after] - places
    shift = np.median(moved, axis=0)
    noise = mad_sigma(moved - shift)
    largest = _SAME_PX + _SAME_SIGMAS * noise / np.sqrt(len(moved))
    if noise > _LARGEST_NOISE_PX or np.abs(shift).max() > largest:
        return False
    still = (np.abs(moved - shift) <= _SAME_PX + _INLIER_SIGMAS * noise).all(axis=1)
    return bool(_rotation_px(places[still], moved[still]) <= largest)


def _rotation_px(places: FloatArray, moved: FloatArray) -> float:
    """By how much a rotation about the optical axis moves pixels (n, 2), root mean square [px]."""
    from_middle = places - places.mean(axis=0)
    across = np.column_stack([-from_middle[:, 1], from_middle[:, 0]])
    size = float(np.linalg.norm(across))
    return abs(float((across * moved).sum())) / (size * np.sqrt(len(places))) if size > 0 else 0.0
