"""What the right camera of a stereo pair sees of the corners followed through the left images.

Each corner is found in the right image as in the next frame (:mod:`sfmcpp.sources.vision.klt`), looked for
first where the depth known from the frame before has it, or at infinity. It must come back, and lie on its
epipolar line and in front of the cameras. What is found is turned into the axes and the lens of the left
camera: a pair need not be rectified.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.pinhole import mean_focal_px, to_normalised, to_pixels
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.frames import RightView, View
from sfmcpp.sources.frame_times import times_of_names
from sfmcpp.sources.frames import RightUse
from sfmcpp.sources.stereo_pair import StereoPair
from sfmcpp.sources.vision import Frames, KltSettings
from sfmcpp.sources.vision.images import GreyImage
from sfmcpp.sources.vision.klt import find_corners
from sfmcpp.wording import counted, first_few

# Farthest from its epipolar line, and behind infinity by its disparity, that a corner may be found [px]. Of
# rendered pairs 98 % are within 0.5 px; calibrations are off by some tenths.
_OFF_LINE_PX, _BEHIND_PX = 1.5, 1.0
# Where corners of the pairs are farther off in the middle, they are of another camera: of rectified images
# taken for those of a lens, or the other way round, a third of the corners may still be near their lines.
_OTHER_CAMERA_PX = 0.5
# A right camera farther beside the left one is likely one whose millimetres were taken for metres [m].
_LONGEST_M = 10.0
# An image pair is left out if that share of its corners fits no such pair, of so many or more; and all are
# where that share of those so far is: one that fits does so by chance, or as the camera stands.
_MOST_CONTRADICT, _FEWEST = 0.5, 20
# So many pairs from the first on that see nearly all behind the cameras are swapped.
_SURELY_SWAPPED = 3
# Where right images show fewer of the corners, they hardly show the same.
_FEW_SHARE = 0.1
# Images that a warning names at most.
_NAMED = 3
# Images taken at times that differ by more are no pair [s]: a car that turns turns by a pixel.
_SAME_TIME_S = 1e-3


@dataclass(eq=False)
class _Tally:
    """Counts of a run."""

    corners: int = 0
    found: int = 0
    frames: int = 0
    used: int = 0
    seen: int = 0
    alone: list[int] = field(default_factory=list)
    used_off_px: list[float] = field(default_factory=list)
    off_line_px: list[float] = field(default_factory=list)
    behind: int = 0

    @property
    def are_no_pairs(self) -> bool:
        """Whether most of the image pairs are none."""
        return len(self.off_line_px) + self.behind > _MOST_CONTRADICT * self.frames


class RightImages:
    """Right images beside left ones that come in order; one of them is in memory at a time.

    Parameters
    ----------
    images : Frames
        Those of the right camera.
    left : Frames
        Those of the left one.
    pair : StereoPair
        The cameras.
    settings : KltSettings
        How corners are followed.

    Raises
    ------
    DatasetError
        If no right image belongs to a left one.
    """

    def __init__(self, images: Frames, left: Frames, pair: StereoPair, settings: KltSettings) -> None:
        self.images, self.pair = images, pair
        self._left, self._settings = left, settings
        self._partners = partners(left, images)
        self.begin()

    def identity(self) -> dict[str, Any]:
        """Which images belong together, and the cameras."""
        return {**vars(self.pair), "partners": list(self._partners.items())}

    def begin(self) -> None:
        """Begin with the first image."""
        self._tally = _Tally()
        self._to_come = self.images.numbered()
        self._latest: tuple[int, GreyImage] | None = None
        self._tracks, self._nearness = np.empty(0, np.int32), np.empty(0)

    def beside(self, number: int, image: GreyImage, view: View) -> View:
        """The view of the left image of that number with what the right one sees of it.

        Raises
        ------
        DatasetError
            If a right image cannot be read or is the left one, or the first ones have everything behind the
            cameras.
        """
        other = self._partner_of(number)
        if other is None:
            self._tally.alone.append(number)
            return view
        if len(view.tracks) and np.array_equal(image, other):
            raise DatasetError(
                self.images.path, f"shows the images of {self._left.path}: must be another camera"
            )
        pixels = self._seen(image, other, view)
        right = None if pixels is None else RightView(pixels, self.pair.centre_m)
        return View(view.tracks, view.pixels, right)

    def _partner_of(self, number: int) -> GreyImage | None:
        """The right image of a left one; None if there is none, or it cannot be read."""
        wanted = self._partners.get(number, -1)
        while self._latest is None or self._latest[0] < wanted:
            self._latest = next(self._to_come, (len(self.images), np.empty((0, 0), np.uint8)))
        return self._latest[1] if self._latest[0] == wanted else None

    def _seen(self, image: GreyImage, other: GreyImage, view: View) -> FloatArray | None:
        """Pixels (n, 2) of a right camera turned into the left one's axes; None if the images are no pair."""
        rays = to_normalised(view.pixels, self.pair.left)
        corners, guesses = (px.astype(np.float32) for px in (view.pixels, self._guesses(view, rays)))
        right, good = find_corners(image, other, corners, guesses, self._settings)
        right_px = right.astype(np.float64)
        turned = self.pair.turned_rays(right_px)
        nearness = self.pair.inverse_depths(rays, turned)
        off_px = np.linalg.norm(right_px - self.pair.in_right(rays, nearness), axis=1)
        on_line = good & (off_px <= _OFF_LINE_PX)
        fits = on_line & (self._disparities_px(nearness) >= -_BEHIND_PX)
        if not self._is_pair(good, on_line, fits, off_px):
            return None
        self._tally.used, self._tally.seen = self._tally.used + 1, self._tally.seen + int(fits.sum())
        self._tracks, self._nearness = view.tracks[fits], nearness[fits].clip(min=0.0)
        pixels = np.full((len(good), 2), np.nan)
        pixels[fits] = to_pixels(turned[fits], self.pair.left)
        return pixels

    def _disparities_px(self, nearness: FloatArray) -> FloatArray:
        return np.asarray(mean_focal_px(self.pair.right) * np.linalg.norm(self.pair.centre_m) * nearness)

    def _guesses(self, view: View, rays: FloatArray) -> FloatArray:
        """Where the right image should show the corners: as near as in the frame before, or far away."""
        nearness = np.zeros(len(view.tracks))
        _, here, before = np.intersect1d(view.tracks, self._tracks, assume_unique=True, return_indices=True)
        nearness[here] = self._nearness[before]
        guesses = self.pair.in_right(rays, nearness)
        return np.where(np.isfinite(guesses), guesses, view.pixels)

    def _is_pair(self, good: BoolArray, on_line: BoolArray, fits: BoolArray, off_px: FloatArray) -> bool:
        """Whether most of what is found fits the pair, and so it was in most pairs before; counted."""
        tally = self._tally
        tally.frames += 1
        found, agreeing = np.count_nonzero(good), np.count_nonzero(fits)
        tally.corners, tally.found = tally.corners + len(good), tally.found + found
        if found < _FEWEST:
            return not tally.are_no_pairs
        middle_px = float(np.median(off_px[good]))
        if agreeing > _MOST_CONTRADICT * found:
            tally.used_off_px.append(middle_px)
            return not tally.are_no_pairs
        if np.count_nonzero(on_line) <= _MOST_CONTRADICT * found:
            tally.off_line_px.append(middle_px)
        else:
            tally.behind += 1
            if tally.behind == tally.frames == _SURELY_SWAPPED:
                raise DatasetError(self.images.path, self._swapped_text())
        return False

    def _swapped_text(self) -> str:
        return (
            f"shows what {self._left.path} shows shifted to the wrong side: everything would be behind the "
            "cameras; swap the left and the right images, if they were taken at one time and the camera is "
            "that of these images"
        )

    @property
    def use(self) -> RightUse:
        """How much the right images looked at so far show."""
        return RightUse(self._tally.used, self._tally.seen / max(self._tally.used, 1))

    @property
    def doubts(self) -> Sequence[str]:
        """What makes the right images looked at so far doubtful, in sentences."""
        return list(self._doubts())

    def _doubts(self) -> Iterator[str]:
        tally = self._tally
        left_out = f"right images are left out{'' if tally.are_no_pairs else ' there'}"
        if off_px := tally.off_line_px:
            yield (
                f"in {len(off_px)} of {tally.frames} pairs of images most of what both show is off its "
                f"epipolar line, by {np.median(off_px):.2g} px: the pair is not rectified, or not calibrated "
                f"so, or left and right were swapped or not taken at one time; {left_out}"
            )
        if tally.used_off_px and (off := float(np.median(tally.used_off_px))) > _OTHER_CAMERA_PX:
            yield (
                f"what both images of a pair show is off its epipolar line by {off:.2g} px in the middle: "
                "the cameras are not those of the images, as rectified images need others than "
                "those that they were made of; the map and its scale are wrong then"
            )
        if (beside_m := float(np.linalg.norm(self.pair.centre_m))) > _LONGEST_M:
            yield (
                f"the right camera is {beside_m:.4g} m beside the left one by its calibration: if those are "
                "millimetres, the map is 1000 times too large"
            )
        if tally.behind:
            yield (
                f"in {tally.behind} of {tally.frames} pairs of images most of what both show would be behind "
                f"the cameras: left and right were not taken at one time; {left_out}"
            )
        if alone := tally.alone:
            frames = counted(len(alone), "frame is", "frames are")
            yield f"{frames} without a right image, the first {self._name_of_left(alone[0])}"
        if lost := self.images.unreadable:
            named = first_few((f"{name}: {reason}" for name, reason in lost.items()), _NAMED)
            yield f"right images cannot be read: {named}"
        if tally.frames and tally.found < _FEW_SHARE * tally.corners:
            share = f"{tally.found / tally.corners:.1%}"
            yield f"right images show only {share} of the corners of left ones: they may be of another scene"

    def _name_of_left(self, number: int) -> str:
        return self._left.names[number] if self._left.names else f"frame {number}"


def partners(left: Frames, right: Frames) -> Mapping[int, int]:
    """Numbers of the right images by those of the left ones that they belong to.

    Those of two folders by the names of their files; else by their times, where these are the names; else by
    the last numbers in the names. Others, as videos, by their order.

    Raises
    ------
    DatasetError
        If none belongs to another.
    """
    if not (left.names and right.names):
        return {k: k for k in range(min(len(left), len(right)))}
    found = _with_same_names(left, right) or _with_same_times(left, right) or _with_same_numbers(left, right)
    if not found:
        reason = f"none of its images, as {right.names[0]}, belongs to one of {left.path}, as {left.names[0]}"
        raise DatasetError(right.path, f"{reason}: files of one pair must have one name, time or number")
    return found


def _with_same_names(left: Frames, right: Frames) -> dict[int, int]:
    numbers = {Path(name).stem: number for number, name in enumerate(right.names)}
    stems = [Path(name).stem for name in left.names]
    return {k: numbers[stem] for k, stem in enumerate(stems) if stem in numbers}


def _with_same_times(left: Frames, right: Frames) -> dict[int, int]:
    times, others = times_of_names(left), times_of_names(right)
    if times is None or others is None:
        return {}
    nearest = np.abs(others[None] - times[:, None]).argmin(axis=1)
    return {k: int(n) for k, n in enumerate(nearest) if abs(others[n] - times[k]) <= _SAME_TIME_S}


def _with_same_numbers(left: Frames, right: Frames) -> dict[int, int]:
    """Right image of each left one by the last numbers in names; none where two of a folder have the same."""
    numbers, others = _last_numbers(left.names), _last_numbers(right.names)
    by_number = {number: k for k, number in enumerate(others)}
    if len(by_number) < len(others) or len(set(numbers)) < len(numbers):
        return {}
    return {k: by_number[number] for k, number in enumerate(numbers) if number in by_number}


def _last_numbers(names: Sequence[str]) -> list[int]:
    found = [re.findall(r"\d+", Path(name).stem) for name in names]
    return [int(digits[-1]) for digits in found if digits]
