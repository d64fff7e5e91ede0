"""KLT tracking of corners through images.

Corners are those whose structure tensor has a large smaller eigenvalue (Shi and Tomasi, "Good features to
track", CVPR 1994), or a large determinant beside its trace (Harris and Stephens, "A combined corner and edge
detector", Alvey 1988), some in each cell of a grid so that they cover the image. They are looked for in the
image at half its size, in a seventh of the time: what is followed is a square around them, and on KITTI's
images it is followed as well. They are followed from each frame to the next by the pyramidal method of Lucas
and Kanade (Bouguet, Intel 2000), and back again: those that do not come back to where they started are
dropped (Kalal, Mikolajczyk and Matas, "Forward-backward error", ICPR 2010). Where the exposure changes,
images are compared after one of them has got the histogram of the other.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray, number_array
from sfmcpp.model.checks import require_count, require_fraction, require_one_of, require_positive
from sfmcpp.model.frames import View
from sfmcpp.sources.vision.images import GreyImage, load_cv2
from sfmcpp.sources.vision.keypoints import HARRIS_K, cells_of, rank_within

Corners = NDArray[np.float32]

# What a corner is.
CORNERS = ("shi-tomasi", "harris")
# Mean change of grey levels, over their mean, that is no other exposure. Corners are followed by their grey
# levels: a gain of 1.1 shifts them by 0.2 px (median, images of KITTI), one of 1.5 loses three of four.
_SAME_EXPOSURE = 0.1
# An image that has fewer of the corners before may be spoilt: black, white or smeared. On KITTI's images half
# or more are followed, also where it turns.
_SPOILT = 0.25
# Share of the lost corners that must be seen again at once: images of something else show up to 0.02, and a
# pose from a few corners would be a poor one. Images that may be spoilt in a row.
_SEEN_AGAIN, _MOST_SPOILT = 0.2, 5


@dataclass(frozen=True)
class KltSettings:
    """Settings of corner detection and tracking.

    Attributes
    ----------
    corners : str
        ``"shi-tomasi"`` or ``"harris"``.
    columns, rows : int
        Cells of the grid across and down the image.
    per_cell : int
        Tracks that a cell is filled up to.
    window_px : int
        Side of the square that is compared, odd [px].
    levels : int
        Halvings of the image above the full size; each doubles the motion that can be followed.
    forward_backward_px : float
        Farthest that a corner may come back from where it started [px].
    min_distance_px : int
        Least distance of a new corner from all others [px].
    quality : float
        Least response of a corner, as part of the strongest one's in the image; that of Harris goes with
        the square of the eigenvalues, and is compared with the square of this.
    max_residual : float
        Largest mean absolute difference of the two squares [grey levels].
    """

    corners: str = "shi-tomasi"
    columns: int = 12
    rows: int = 4
    per_cell: int = 5
    window_px: int = 21
    levels: int = 4
    forward_backward_px: float = 1.0
    min_distance_px: int = 10
    quality: float = 0.01
    max_residual: float = 40.0

    def __post_init__(self) -> None:
        require_one_of("corners", self.corners, CORNERS)
        for name in ("columns", "rows", "per_cell", "min_distance_px", "window_px"):
            require_count(name, getattr(self, name))
        require_count("levels", self.levels, at_least=0)
        for name in ("forward_backward_px", "max_residual"):
            require_positive(name, getattr(self, name))
        require_fraction("quality", self.quality)
        if self.window_px not in range(3, 256, 2):
            raise InvalidArgument(f"window_px = {self.window_px}: must be odd, from 3 to 255")


def follow_features(
    frames: Iterable[GreyImage], settings: KltSettings | None = None, mask: ArrayLike | None = None
) -> Iterator[View]:
    """Follow corners through images as they come; the same images give the same tracks.

    A copy of the last image and its corners are kept, and of one before spoilt ones.

    Parameters
    ----------
    frames : iterable of (height, width) uint8
        Images of one size; each is looked at when its features are asked for.
    settings : KltSettings, optional
        Default: that of a car's camera.
    mask : (height, width), optional
        Zero or False where nothing is followed, as on the bonnet of a car.

    Yields
    ------
    View
        Of each frame. Each new corner has a new track, numbered from 0. A track sees consecutive frames,
        but for some in which nearly all were lost, as in a black one.

    Raises
    ------
    InvalidArgument
        If a frame is not of uint8 numbers (height, width), or of another size than the first, or the mask is.
    ModuleNotFoundError
        If OpenCV is not installed.
    """
    tracker: _Tracker | None = None
    for number, image in enumerate(frames):
        _require_grey(number, image, tracker)
        if tracker is None:
            tracker = _Tracker(load_cv2(), settings or KltSettings(), _usable(mask, image.shape))
        # A copy: cameras give the same array again, with the next image in it.
        yield tracker.look_at(image.copy())


def find_corners(
    image: GreyImage, other: GreyImage, corners: Corners, guesses: Corners, settings: KltSettings
) -> tuple[Corners, BoolArray]:
    """Find corners of an image in another one of its size, as from one frame to the next.

    Parameters
    ----------
    image, other : (height, width) uint8
        Images.
    corners, guesses : (n, 2) float32
        Where `image` has the corners, and where in `other` they are looked for first [px].
    settings : KltSettings
        How they are followed.

    Returns
    -------
    corners : (n, 2) float32
        Where the other image has them [px].
    good : (n,) bool
        Which of these are found, and lead back to where they started.
    """
    tracker = _Tracker(load_cv2(), settings, np.full(other.shape, 255, np.uint8))
    if not len(corners):
        return corners, np.empty(0, np.bool_)
    return tracker.moved(_Seen(image, corners, np.empty(0, np.int32)), other, guesses)


class _Seen(NamedTuple):
    """An image, and the corners seen in it."""

    image: GreyImage
    corners: Corners
    tracks: IndexArray

    def only(self, those: BoolArray) -> _Seen:
        return _Seen(self.image, self.corners[those], self.tracks[those])


@dataclass(eq=False)
class _Tracker:
    """The last image and the corners followed in it; those that it may have lost as it is spoilt."""

    cv2: ModuleType
    settings: KltSettings
    usable: GreyImage  # 0 where nothing is followed
    last: _Seen | None = None
    lost: _Seen | None = None
    spoilt: int = 0  # images since `lost`
    next_track: int = 0

    def look_at(self, image: GreyImage) -> View:
        """Follow the corners into `image`, and fill up its cells."""
        seen = _Seen(image, np.empty((0, 2), np.float32), np.empty(0, np.int32))
        if self.last is not None:
            seen = self._with_lost(self._followed(self.last, image))
            self._remember_lost(self.last, seen)
        self.last = self._filled(seen)
        return View(self.last.tracks, self.last.corners.astype(np.float64))

    def _with_lost(self, seen: _Seen) -> _Seen:
        """What is seen, with the corners that an image before has lost, if this one shows them again."""
        if self.lost is None:
            return seen
        again = self._followed(self.lost, seen.image)
        self.spoilt += 1
        if len(again.tracks) < _SEEN_AGAIN * len(self.lost.tracks):
            self.lost = None if self.spoilt >= _MOST_SPOILT else self.lost
            return seen
        self.lost = None
        return _joined(again, seen.only(self._are_free(seen.corners, again.corners)))

    def _remember_lost(self, before: _Seen, seen: _Seen) -> None:
        """Remember the corners of `before` where most are lost: the image may be spoilt, as a black one."""
        if self.lost is None and len(seen.tracks) < _SPOILT * len(before.tracks):
            self.lost, self.spoilt = before.only(~np.isin(before.tracks, seen.tracks)), 0

    def _followed(self, before: _Seen, image: GreyImage) -> _Seen:
        """The corners of the image before that are followed into this one."""
        if not len(before.corners):
            return _Seen(image, before.corners, before.tracks)
        moved, good = self.moved(before, image)
        return _Seen(image, moved, before.tracks).only(good)

    def moved(
        self, before: _Seen, image: GreyImage, guesses: Corners | None = None
    ) -> tuple[Corners, BoolArray]:
        """Corners in `image`, and which are good; where its exposure differs, with that removed."""
        as_is = self._tracked(before.image, image, before.corners, guesses)
        alike = _exposed_alike(self.cv2, before.image, image)
        if alike is None:
            return as_is
        # What has come into the image changes its grey levels, too; then corners are followed better as is.
        exposed = self._tracked(*alike, before.corners, guesses)
        return max(exposed, as_is, key=lambda found: np.count_nonzero(found[1]))

    def _tracked(
        self, before: GreyImage, image: GreyImage, corners: Corners, guesses: Corners | None
    ) -> tuple[Corners, BoolArray]:
        moved, found, residual = self._flow(before, image, corners, guesses)
        # Back by the way that was guessed: from the corner itself it would always come back.
        way_back = None if guesses is None else moved - (guesses - corners)
        back, found_back, _ = self._flow(image, before, moved, way_back)
        distance = np.linalg.norm(back - corners, axis=1)
        good = found & found_back & (distance <= self.settings.forward_backward_px)
        return moved, good & (residual <= self.settings.max_residual) & self._inside(moved)

    def _flow(
        self, a: GreyImage, b: GreyImage, corners: Corners, guesses: Corners | None
    ) -> tuple[Corners, BoolArray, NDArray[np.float32]]:
        window = (self.settings.window_px,) * 2
        stop = (self.cv2.TERM_CRITERIA_EPS | self.cv2.TERM_CRITERIA_COUNT, 30, 0.005)
        start = None if guesses is None else guesses.copy()  # which OpenCV overwrites
        moved, found, residual = self.cv2.calcOpticalFlowPyrLK(
            a,
            b,
            corners,
            start,
            winSize=window,
            maxLevel=self.settings.levels,
            criteria=stop,
            flags=0 if start is None else self.cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        return moved, found[:, 0].astype(np.bool_), residual[:, 0]

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the images."""
        return self.usable.shape

    @property
    def _border_px(self) -> int:
        return self.settings.window_px // 2

    def _inside(self, corners: Corners) -> BoolArray:
        """Whether the square of each corner lies in the image and it is not masked."""
        height, width = self.shape
        last = np.array([width, height]) - 1 - self._border_px
        inside = np.asarray(((corners >= self._border_px) & (corners <= last)).all(axis=1))
        inside[inside] = self.usable[_rows_and_columns(corners[inside])] > 0
        return inside

    def _filled(self, seen: _Seen) -> _Seen:
        """What is seen, with new corners where cells lack some."""
        corners = self._new_corners(seen)
        numbers = np.arange(self.next_track, self.next_track + len(corners), dtype=np.int32)
        self.next_track += len(corners)
        return _joined(seen, _Seen(seen.image, corners, numbers))

    def _new_corners(self, seen: _Seen) -> Corners:
        """The strongest corners where cells lack some."""
        wanted = self.settings.per_cell - self._cell_counts(seen.corners)
        mask = self._free_pixels(seen.corners)
        if not (wanted > 0).any() or not mask.any():
            return np.empty((0, 2), np.float32)
        harris, quality = self.settings.corners == "harris", self.settings.quality
        # Each pixel of the half is centred on every other one of the image.
        found = self.cv2.goodFeaturesToTrack(
            self.cv2.pyrDown(seen.image),
            0,
            quality**2 if harris else quality,
            self.settings.min_distance_px / 2,
            mask=np.ascontiguousarray(mask[::2, ::2]),
            blockSize=3,
            useHarrisDetector=harris,
            k=HARRIS_K,
        )
        if found is None:
            return np.empty((0, 2), np.float32)
        corners: Corners = 2 * found.reshape(-1, 2)
        cells = self._cells(corners)
        return corners[rank_within(cells) < wanted[cells]]

    def _free_pixels(self, corners: Corners) -> GreyImage:
        """Mask of pixels for new corners: away from the border and from existing corners."""
        free = np.zeros(self.shape, np.uint8)
        edge = self._border_px
        inner = slice(edge, self.shape[0] - edge), slice(edge, self.shape[1] - edge)
        free[inner] = self.usable[inner]
        taken = np.full(self.shape, 255, np.uint8)
        taken[_rows_and_columns(corners)] = 0
        size = 2 * self.settings.min_distance_px + 1
        return np.asarray(free & self.cv2.erode(taken, np.ones((size, size), np.uint8)))

    def _are_free(self, corners: Corners, others: Corners) -> BoolArray:
        """Whether each of the corners is away from all of the others."""
        return np.asarray(self._free_pixels(others)[_rows_and_columns(corners)] > 0)

    def _cells(self, corners: Corners) -> NDArray[np.int64]:
        return cells_of(corners, self.shape, self.settings.columns, self.settings.rows)

    def _cell_counts(self, corners: Corners) -> NDArray[np.int64]:
        return np.bincount(self._cells(corners), minlength=self.settings.columns * self.settings.rows)


def _rows_and_columns(corners: Corners) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    columns, rows = np.round(corners).astype(np.int64).T
    return rows, columns


def _joined(some: _Seen, others: _Seen) -> _Seen:
    """What is seen of both, in the order of the tracks."""
    tracks = np.concatenate([some.tracks, others.tracks])
    order = np.argsort(tracks)
    return _Seen(some.image, np.concatenate([some.corners, others.corners])[order], tracks[order])


def _usable(mask: ArrayLike | None, shape: tuple[int, int]) -> GreyImage:
    """255 where corners are followed, 0 elsewhere."""
    if mask is None:
        return np.full(shape, 255, np.uint8)
    given = number_array("mask", mask)
    if given.shape != shape:
        raise InvalidArgument(f"mask has shape {given.shape}: must be {shape} as frames[0]")
    return np.where(given != 0, 255, 0).astype(np.uint8)


def _require_grey(number: int, image: GreyImage, tracker: _Tracker | None) -> None:
    image = number_array(f"frames[{number}]", image)
    if image.dtype != np.uint8 or image.ndim != 2:
        found = f"{image.dtype} {image.shape}"
        raise InvalidArgument(f"frames[{number}] is {found}: must be uint8 (height, width)")
    if not image.size:
        raise InvalidArgument(f"frames[{number}] has shape {image.shape}: must have pixels")
    if tracker is not None and image.shape != tracker.shape:
        rule = f"must be {tracker.shape} as the first"
        raise InvalidArgument(f"frames[{number}] has shape {image.shape}: {rule}")


def _exposed_alike(
    cv2: ModuleType, before: GreyImage, image: GreyImage
) -> tuple[GreyImage, GreyImage] | None:
    """Two images with the same grey levels at the same ranks; None if their own hardly differ.

    The one that tells more levels apart takes those of the other: what is saturated cannot be undone.
    """
    shares = [cv2.calcHist([one], [0], None, [256], [0, 256]).ravel() / one.size for one in (before, image)]
    levels = _levels_by_rank(*shares)
    mean, change = (shares[0] @ of for of in (np.arange(256), np.abs(levels - np.arange(256))))
    if change <= _SAME_EXPOSURE * mean:
        return None
    if shares[0] @ shares[0] <= shares[1] @ shares[1]:
        return _with_levels(before, levels), image
    return before, _with_levels(image, _levels_by_rank(shares[1], shares[0]))


def _levels_by_rank(share: FloatArray, other: FloatArray) -> FloatArray:
    """For each grey level of an image that of the same rank in another one, by their shares of the pixels."""
    there = other > 0
    ranks, others = (np.cumsum(one) - one / 2 for one in (share, other))
    return np.interp(ranks, others[there], np.flatnonzero(there))


def _with_levels(image: GreyImage, levels: FloatArray) -> GreyImage:
    return np.asarray(np.rint(levels).astype(np.uint8)[image])
