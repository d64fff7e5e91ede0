"""Doubts about the keypoints of other programs, which may be no pixels of the images they are said to be of.

Detectors that work on smaller copies of photos must scale their keypoints back. Where this was forgotten, or
where the sizes are those of the copies, a focal length is estimated that fits the mistake.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sfmcpp.model.arrays import BoolArray
from sfmcpp.model.photos import Features, Photo

# No detector finds anything outside of an image. So much of the larger side is no rounding and no padding,
# and so many keypoints are no outliers.
_MARGIN, _SHARE = 0.02, 0.01
# So many keypoints reach to the right and the lower part of some image, as long as they are of these images.
_FEWEST, _REACH = 1000, 0.75


def warnings_about_keypoints(features: Sequence[Features], photos: Sequence[Photo]) -> list[str]:
    """Warn of keypoints outside of their images, or that fill only the upper left corner of all images.

    Parameters
    ----------
    features : sequence of Features
        Of each image, with pixels that count from the upper left corner.
    photos : sequence of Photo
        With the sizes that the images are said to have.

    Returns
    -------
    list of str
    """
    return [*_of_larger_images(features, photos), *_of_smaller_images(features, photos)]


def _of_larger_images(features: Sequence[Features], photos: Sequence[Photo]) -> Iterator[str]:
    outside = [_are_outside(one, photo) for one, photo in zip(features, photos, strict=True)]
    bad = [i for i, them in enumerate(outside) if np.count_nonzero(them) > _SHARE * len(them)]
    if bad:
        worst = max(bad, key=lambda i: (float(np.mean(outside[i])), -i))
        x, y = features[worst].pixels[int(np.argmax(outside[worst]))]
        width, height = photos[worst].size
        yield (
            f"keypoints of {len(bad)} of {len(photos)} images lie outside of them, "
            f"{np.mean(outside[worst]):.0%} of those of {photos[worst].name}, one at {x:.0f}, {y:.0f} in "
            f"{width} × {height} px: the sizes must be those of the images of the keypoints, else the "
            "calibration is wrong"
        )


def _are_outside(features: Features, photo: Photo) -> BoolArray:
    margin = _MARGIN * max(photo.size)
    pixels = features.pixels
    return np.asarray(((pixels < -margin) | (pixels > np.array(photo.size) + margin)).any(axis=1))


def _of_smaller_images(features: Sequence[Features], photos: Sequence[Photo]) -> Iterator[str]:
    if sum(len(one) for one in features) < _FEWEST:
        return
    reach = np.max(
        [
            one.pixels.max(axis=0) / photo.size
            for one, photo in zip(features, photos, strict=True)
            if len(one)
        ],
        axis=0,
    )
    if (reach < _REACH).all():
        yield (
            f"the keypoints fill only the upper left part of the images, {reach[0]:.0%} of their width and "
            f"{reach[1]:.0%} of their height: were they detected in smaller copies? They must be scaled to "
            "the sizes of the images, else the calibration is wrong"
        )
