"""Features of a photo: keypoints, descriptors and colours (thesis §3.1.1).

Descriptors are compared by the Hellinger distance, which is the Euclidean one of their roots (Arandjelović
and Zisserman, "Three things everyone should know to improve object retrieval", CVPR 2012).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_count, require_fraction, require_one_of
from sfmcpp.model.photos import Features, Photo
from sfmcpp.sources.vision.detectors import find_blobs, find_corners
from sfmcpp.sources.vision.images import load_cv2
from sfmcpp.sources.vision.keypoints import SearchImage
from sfmcpp.sources.vision.masks import read_mask
from sfmcpp.sources.vision.photos import read_color_and_opaque

FEATURE_KINDS = ("sift", "harris", "shi-tomasi")


@dataclass(frozen=True)
class FeatureSettings:
    """Settings of feature detection.

    Attributes
    ----------
    kind : str
        ``"sift"``: blobs of any size and orientation. ``"harris"`` and ``"shi-tomasi"``: corners, described
        like blobs of one size, so that a photo matches others from the same distance.
    max_features : int
        Of a photo: two thirds are the largest blobs, the others are strong and small and spread over the
        image by a grid; corners are strong and spread.
    max_size_px : int
        Longest side of the image in which is searched [px]; a larger photo is shrunk to it.
    contrast : float
        Least response of a blob, 3 times the difference of two blurs of grey levels from 0 to 1: OpenCV's.
    quality : float
        Least response of a corner, as part of the strongest one's in the image; that of Harris goes with
        the square of the eigenvalues, and is compared with the square of this.
    """

    kind: str = "sift"
    max_features: int = 12288
    max_size_px: int = 3200
    contrast: float = 0.0133
    quality: float = 0.002

    def __post_init__(self) -> None:
        require_one_of("kind", self.kind, FEATURE_KINDS)
        require_count("max_features", self.max_features, 1)
        require_count("max_size_px", self.max_size_px, 64)
        require_fraction("contrast", self.contrast)
        require_fraction("quality", self.quality)


@checked()
def detect(photo: Photo, settings: FeatureSettings | None = None) -> Features:
    """Detect and describe features; the same file and settings give the same features.

    Nothing is detected where the mask is black or, in a photo without one, where it is transparent.

    Parameters
    ----------
    photo : Photo
        One with a file.
    settings : FeatureSettings, optional
        Default: SIFT.

    Returns
    -------
    Features
        Strongest first. A blob with several orientations is there several times, at exactly the same place.

    Raises
    ------
    DatasetError
        If the photo or its mask cannot be decoded.
    ModuleNotFoundError
        If OpenCV or Pillow is not installed.
    """
    pixels, opaque = read_color_and_opaque(photo)
    mask = opaque if photo.mask is None else read_mask(photo.mask, photo.size, photo.name)
    return detect_in(pixels, mask, settings)


def detector_version() -> str:
    """Version of the library that detects: another one may find other features in the same photo."""
    return f"OpenCV {load_cv2().__version__}"


@checked()
def detect_in(
    color: NDArray[np.uint8], mask: BoolArray | None = None, settings: FeatureSettings | None = None
) -> Features:
    """Like :func:`detect`, in pixels that are at hand.

    Parameters
    ----------
    color : (height, width, 3) uint8
        Red, green, blue.
    mask : (height, width) bool, optional
        Where something may be detected.
    settings : FeatureSettings, optional
        Default: SIFT.

    Returns
    -------
    Features
        As of :func:`detect`.

    Raises
    ------
    InvalidArgument
        If `color` or `mask` is of another shape or type.
    """
    _require_image(color, mask)
    cv2, settings = load_cv2(), settings or FeatureSettings()
    image = _search_image(cv2, color, mask, settings.max_size_px)
    if settings.kind == "sift":
        found = find_blobs(cv2, image, settings.max_features, settings.contrast)
    else:
        found = find_corners(cv2, image, settings.kind, settings.max_features, settings.quality)
    # Pixels of the photo by those of the image that was searched, across and down.
    step = np.array(color.shape[1::-1]) / image.gray.shape[::-1]
    pixels = (found.pixels + 0.5) * step
    scales = found.scales * math.sqrt(step.prod())
    return Features(pixels, scales, found.angles, _colors(color, pixels), _root_normalised(found.descriptors))


def _require_image(color: NDArray[np.uint8], mask: BoolArray | None) -> None:
    if color.dtype != np.uint8 or color.ndim != 3 or color.shape[2] != 3 or not color.size:
        raise InvalidArgument(f"color: {color.dtype} {color.shape}, must be uint8 (height, width, 3)")
    if mask is not None and (mask.dtype != np.bool_ or mask.shape != color.shape[:2]):
        raise InvalidArgument(f"mask: {mask.dtype} {mask.shape}, must be bool {color.shape[:2]} as color")


def _search_image(
    cv2: ModuleType, color: NDArray[np.uint8], mask: BoolArray | None, max_size_px: int
) -> SearchImage:
    gray, factor = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), max_size_px / max(color.shape)
    if factor >= 1:
        return SearchImage(gray, mask)
    height, width = (max(1, round(factor * side)) for side in gray.shape)
    small = cv2.resize(gray, (width, height), interpolation=cv2.INTER_AREA)
    if mask is None:
        return SearchImage(small, None)
    small_mask = cv2.resize(mask.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    return SearchImage(small, small_mask > 0)


def _colors(color: NDArray[np.uint8], pixels: FloatArray) -> NDArray[np.uint8]:
    columns, rows = np.floor(pixels).astype(np.int64).T
    height, width = color.shape[:2]
    return np.asarray(color[rows.clip(0, height - 1), columns.clip(0, width - 1)])


def _root_normalised(descriptors: NDArray[np.uint8]) -> NDArray[np.uint8]:
    total = descriptors.sum(axis=1, keepdims=True, dtype=np.float32)
    roots = np.sqrt(descriptors / np.maximum(total, 1))
    return np.asarray(np.minimum(np.rint(512 * roots), 255), dtype=np.uint8)
