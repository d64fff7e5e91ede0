"""Normalised and sorted tracks with missing data, the input of batch factorisation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba.projective import image_frames
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray

Indices = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Measurements:
    """M observations of N tracks by C images, sorted by image and then by track.

    Attributes
    ----------
    num_images, num_tracks : int
        C and N.
    image, track : (M,) int64
        Of each observation.
    pixels : (M, 2) float64
        Where it is [px].
    frames : (C, 3) float64
        ``scale, cx, cy`` of each image: isotropic normalisation (thesis eq. 4.3).
    """

    num_images: int
    num_tracks: int
    image: Indices
    track: Indices
    pixels: FloatArray
    frames: FloatArray

    @cached_property
    def first(self) -> Indices:
        """(C + 1,) where the observations of each image begin."""
        return np.searchsorted(self.image, np.arange(self.num_images + 1))

    @cached_property
    def rays(self) -> FloatArray:
        """(M, 3) homogeneous positions in the frames of the images, the third coordinate one."""
        frames = self.frames[self.image]
        position = (self.pixels - frames[:, 1:]) / frames[:, :1]
        return np.concatenate([position, np.ones((len(position), 1))], axis=1)

    def rows_of(self, image: int, kept: BoolArray | None = None) -> Indices:
        """Observations of an image, of those that are `kept`, by track."""
        rows = np.arange(self.first[image], self.first[image + 1])
        return rows if kept is None else rows[kept[rows]]

    def common_rows(self, images: list[int], kept: BoolArray | None = None) -> Indices:
        """(s, n) observations of the tracks that all of `images` see, by track."""
        rows = [self.rows_of(image, kept) for image in images]
        shared = self.track[rows[0]]
        for other in rows[1:]:
            shared = np.intersect1d(shared, self.track[other], assume_unique=True)
        found = [r[np.searchsorted(self.track[r], shared)] for r in rows]
        return np.asarray(found).reshape(len(images), len(shared))

    def shared_counts(self) -> Indices:
        """(C, C) number of tracks that each pair of images shares."""
        from scipy.sparse import csr_array

        ones = np.ones(len(self.image), dtype=np.int64)
        shape = (self.num_images, self.num_tracks)
        seen = csr_array((ones, (self.image, self.track)), shape=shape)
        return np.asarray((seen @ seen.T).todense())


def normalised_measurements(
    image_index: IndexArray, track_index: IndexArray, pixels: FloatArray, num_images: int
) -> tuple[Measurements, Indices]:
    """Sort the observations; the second result is the row of the input of each."""
    order = np.lexsort((track_index, image_index))
    image, track = image_index[order].astype(np.int64), track_index[order].astype(np.int64)
    positions = pixels[order]
    count = int(track.max(initial=-1)) + 1
    frames = image_frames(image, positions, num_images)
    return Measurements(num_images, count, image, track, positions, frames), order
