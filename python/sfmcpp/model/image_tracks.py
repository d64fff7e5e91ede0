"""Tracks of uncalibrated images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import ANY, FloatArray, IndexArray, as_stored, finite_array, number_array

LARGEST_INDEX = int(np.iinfo(np.int32).max) - 1


@dataclass(frozen=True, eq=False)
class ImageTracks:
    """M observations of N tracks by n images: what structure from motion without photos starts from.

    Attributes
    ----------
    names : list of str
        One for each image, all different.
    sizes : (n, 2) int64
        Width and height of each image [px]; 0 where unknown.
    centres : (n, 2) float64
        Centre of each image [px]: half its size, or the origin where the data set counts from there; not a
        number where unknown.
    image_index, track_index : (M,) int32
        Image and track of each observation; no image sees a track twice.
    pixels : (M, 2) float64
        Where the image sees the track [px], y down.
    """

    names: list[str]
    sizes: NDArray[np.int64]
    centres: FloatArray
    image_index: IndexArray
    track_index: IndexArray
    pixels: FloatArray

    @property
    def num_images(self) -> int:
        """Number of images, n."""
        return len(self.names)

    @property
    def num_tracks(self) -> int:
        """Number of tracks, N: one more than the largest index."""
        return int(self.track_index.max(initial=-1)) + 1

    def __len__(self) -> int:
        return len(self.image_index)

    def __repr__(self) -> str:
        return f"ImageTracks({self.num_images} images, {self.num_tracks} tracks, {len(self)} observations)"


def image_tracks(
    image_index: ArrayLike,
    track_index: ArrayLike,
    pixels: ArrayLike,
    *,
    names: Sequence[str] | None = None,
    sizes: ArrayLike | None = None,
    centred: bool = False,
) -> ImageTracks:
    """Tracks from arrays, checked.

    Parameters
    ----------
    image_index, track_index : (M,) int
        Image and track of each observation, counted from 0.
    pixels : (M, 2)
        Where the image sees the track [px], y down.
    names : sequence of str, optional
        One for each image. Default: ``image_000000`` and so on, up to the largest index.
    sizes : (n, 2) int, optional
        Width and height of each image [px], 0 where unknown, which is the default.
    centred : bool
        Whether pixels are counted from the centre of the image and not from its top left corner.

    Returns
    -------
    ImageTracks
        Observations in the order given.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a value is not finite, a pixel in no image, an index out of range, names are not
        different, or an image sees a track twice.
    """
    positions = finite_array("pixels", pixels, (ANY, 2))
    _require_of_an_image(positions)
    images = _index("image_index", image_index, len(positions))
    tracks = _index("track_index", track_index, len(positions))
    count = int(images.max(initial=-1)) + 1
    labels = [f"image_{number:06d}" for number in range(count)] if names is None else list(names)
    if len(labels) < count:
        raise InvalidArgument(f"image_index: its largest is {count - 1}, there are {len(labels)} names")
    if len(set(labels)) < len(labels):
        raise InvalidArgument("names: must all be different")
    _require_once(images, tracks, labels)
    known = _sizes(sizes, len(labels))
    return ImageTracks(labels, known, _centres(known, centred), images, tracks, positions)


def first_beyond_images(pixels: FloatArray) -> tuple[int, str] | None:
    """Place, in order, and fault of the first coordinate that is too large for any image, or None."""
    flat = pixels.reshape(-1)
    good = np.abs(flat) <= LARGEST_INDEX
    if good.all():
        return None
    worst = int(np.argmin(good))
    return worst, f"pixel {flat[worst]:g}: must be at most {LARGEST_INDEX} in magnitude"


def _require_of_an_image(pixels: FloatArray) -> None:
    fault = first_beyond_images(pixels)
    if fault is not None:
        raise InvalidArgument(f"pixels[{fault[0] // 2}]: {fault[1]}")


def _index(name: str, value: ArrayLike, count: int) -> IndexArray:
    array = number_array(name, value)
    if array.shape != (count,) or (count and array.dtype.kind not in "iu"):
        raise InvalidArgument(f"{name}: {array.dtype} {array.shape}, must be {count} integers as pixels")
    if count and not (array.min() >= 0 and array.max() <= LARGEST_INDEX):
        raise InvalidArgument(f"{name}: must be from 0 to {LARGEST_INDEX}")
    return as_stored(array, np.int32)


def _sizes(value: ArrayLike | None, count: int) -> NDArray[np.int64]:
    if value is None:
        return np.zeros((count, 2), dtype=np.int64)
    sizes = number_array("sizes", value)
    if sizes.shape != (count, 2) or (count and (sizes.dtype.kind not in "iu" or sizes.min() < 0)):
        raise InvalidArgument(f"sizes: {sizes.dtype} {sizes.shape}, must be ({count}, 2), not negative")
    return as_stored(sizes, np.int64)


def _centres(sizes: NDArray[np.int64], centred: bool) -> FloatArray:
    if centred:
        return np.zeros(sizes.shape)
    return np.asarray(np.where((sizes > 0).all(axis=1, keepdims=True), sizes / 2.0, np.nan))


def _require_once(images: IndexArray, tracks: IndexArray, names: list[str]) -> None:
    order = np.lexsort((tracks, images))
    same = (np.diff(images[order]) == 0) & (np.diff(tracks[order]) == 0)
    if same.any():
        second = int(order[1:][same].min())
        reason = f"image {names[images[second]]!r} sees track {tracks[second]} twice"
        raise InvalidArgument(f"track_index[{second}]: {reason}")
