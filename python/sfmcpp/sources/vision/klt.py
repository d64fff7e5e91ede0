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
from dataclasses import dataclass, field
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

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


def follow_features(frames: Iterable[GreyImage], settings: KltSettings | None = None) -> Iterator[View]:
    """Follow corners through images as they come; the same images give the same tracks.

    Only the last image and its corners are kept.

    Parameters
    ----------
    frames : iterable of (height, width) uint8
        Images of one size; each is looked at when its features are asked for.
    settings : KltSettings, optional
        Default: that of a car's camera.

    Yields
    ------
    View
        Of each frame. Each new corner has a new track, numbered from 0; a track sees consecutive frames.

    Raises
    ------
    InvalidArgument
        If a frame is not of uint8 numbers (height, width), or of another size than the first.
    ModuleNotFoundError
        If OpenCV is not installed.
    """
    tracker: _Tracker | None = None
    for number, image in enumerate(frames):
        _require_grey(number, image, tracker)
        tracker = tracker or _Tracker(load_cv2(), settings or KltSettings(), image.shape)
        yield tracker.look_at(image)


@dataclass(eq=False)
class _Tracker:
    """The last image, and the corners followed in it."""

    cv2: ModuleType
    settings: KltSettings
    shape: tuple[int, int]
    corners: Corners = field(default_factory=lambda: np.empty((0, 2), np.float32))
    tracks: IndexArray = field(default_factory=lambda: np.empty(0, np.int32))
    image: GreyImage | None = None
    next_track: int = 0

    def look_at(self, image: GreyImage) -> View:
        """Follow the corners into `image`, and fill up its cells."""
        if self.image is not None and len(self.corners):
            moved, good = self._moved(self.image, image)
            self.corners, self.tracks = moved[good], self.tracks[good]
        self.image = image
        self._add(self._new_corners(image))
        return View(self.tracks, self.corners.astype(np.float64))

    def _moved(self, before: GreyImage, image: GreyImage) -> tuple[Corners, BoolArray]:
        """Corners in `image`, and which are good; where its exposure differs, with that removed."""
        as_is = self._tracked(before, image)
        alike = _exposed_alike(self.cv2, before, image)
        if alike is None:
            return as_is
        # What has come into the image changes its grey levels, too; then corners are followed better as is.
        return max(self._tracked(*alike), as_is, key=lambda found: np.count_nonzero(found[1]))

    def _tracked(self, before: GreyImage, image: GreyImage) -> tuple[Corners, BoolArray]:
        moved, found, residual = self._flow(before, image, self.corners)
        back, found_back, _ = self._flow(image, before, moved)
        distance = np.linalg.norm(back - self.corners, axis=1)
        good = found & found_back & (distance <= self.settings.forward_backward_px)
        return moved, good & (residual <= self.settings.max_residual) & self._inside(moved)

    def _flow(
        self, a: GreyImage, b: GreyImage, corners: Corners
    ) -> tuple[Corners, BoolArray, NDArray[np.float32]]:
        window = (self.settings.window_px,) * 2
        stop = (self.cv2.TERM_CRITERIA_EPS | self.cv2.TERM_CRITERIA_COUNT, 30, 0.005)
        levels = self.settings.levels
        moved, found, residual = self.cv2.calcOpticalFlowPyrLK(
            a, b, corners, None, winSize=window, maxLevel=levels, criteria=stop
        )
        return moved, found[:, 0].astype(np.bool_), residual[:, 0]

    @property
    def _border_px(self) -> int:
        return self.settings.window_px // 2

    def _inside(self, corners: Corners) -> BoolArray:
        """Those whose square lies in the image."""
        height, width = self.shape
        last = np.array([width, height]) - 1 - self._border_px
        return np.asarray(((corners >= self._border_px) & (corners <= last)).all(axis=1))

    def _new_corners(self, image: GreyImage) -> Corners:
        """The strongest where cells lack some."""
        wanted = self.settings.per_cell - self._cell_counts()
        mask = self._free_pixels()
        if not (wanted > 0).any() or not mask.any():
            return np.empty((0, 2), np.float32)
        harris, quality = self.settings.corners == "harris", self.settings.quality
        # Each pixel of the half is centred on every other one of the image.
        found = self.cv2.goodFeaturesToTrack(
            self.cv2.pyrDown(image),
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

    def _free_pixels(self) -> GreyImage:
        """Mask of pixels for new corners: away from the border and from existing corners."""
        free = np.zeros(self.shape, np.uint8)
        edge = self._border_px
        free[edge : self.shape[0] - edge, edge : self.shape[1] - edge] = 255
        taken = np.full(self.shape, 255, np.uint8)
        columns, rows = np.round(self.corners).astype(np.int64).T
        taken[rows, columns] = 0
        size = 2 * self.settings.min_distance_px + 1
        return np.asarray(free & self.cv2.erode(taken, np.ones((size, size), np.uint8)))

    def _cells(self, corners: Corners) -> NDArray[np.int64]:
        return cells_of(corners, self.shape, self.settings.columns, self.settings.rows)

    def _cell_counts(self) -> NDArray[np.int64]:
        return np.bincount(self._cells(self.corners), minlength=self.settings.columns * self.settings.rows)

    def _add(self, corners: Corners) -> None:
        numbers = np.arange(self.next_track, self.next_track + len(corners), dtype=np.int32)
        self.next_track += len(corners)
        self.corners = np.concatenate([self.corners, corners])
        self.tracks = np.concatenate([self.tracks, numbers])


def _require_grey(number: int, image: GreyImage, tracker: _Tracker | None) -> None:
    image = number_array(f"frames[{number}]", image)
    if image.dtype != np.uint8 or image.ndim != 2:
        found = f"{image.dtype} {image.shape}"
        raise InvalidArgument(f"frames[{number}] is {found}: must be uint8 (height, width)")
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
