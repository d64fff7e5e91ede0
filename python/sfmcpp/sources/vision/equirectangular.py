"""Photos that show all around, told by their pixels where their files say nothing.

An equirectangular image is twice as wide as high; its first and last column are neighbours, and all of its
first row is one point, as is all of its last.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.sources.vision.images import load_pillow
from sfmcpp.sources.vision.photo_pixels import decoded, opened_image

# Compared at this height [px]; less tells nothing.
_HEIGHT = 128
# Across the seam, levels differ as between other neighbours, here at most so many times as much.
_MOST_OF_SEAM = 2.0
# Scatter of levels over that of the image: of a pole at most, of the seam, which crosses the scene, at least.
_MOST_OF_POLE, _LEAST_OF_SEAM = 0.3, 0.3


def shows_all_around(file: Path, data: bytes, size: tuple[int, int]) -> bool:
    """Whether the image in a file's bytes, of that width and height, seems to be equirectangular.

    Only one of such a size is decoded; what cannot be is none.
    """
    width, height = size
    if width != 2 * height or height < _HEIGHT:
        return False
    small = (2 * _HEIGHT, _HEIGHT)
    with suppress(DatasetError), opened_image(file, data) as image:
        image.draft("L", small)  # of JPEG, only as many pixels are decoded as are needed
        return is_closed_around(_levels(file, image, small))
    return False


def _levels(file: Path, image: Any, size: tuple[int, int]) -> NDArray[np.float64]:
    """Grey levels at a size; the mean of what a pixel covers, so that noise does not count."""
    pixels = np.asarray(decoded(file, image), dtype=np.float32)
    grey = pixels if pixels.ndim == 2 else pixels.mean(axis=2)
    pillow = load_pillow()
    return np.asarray(pillow.fromarray(grey).resize(size, pillow.Resampling.BOX), dtype=np.float64)


def is_closed_around(grey: NDArray[np.float64]) -> bool:
    """Whether grey levels (height, width) meet at both sides, and are one each at the top and the bottom."""
    scatter = float(grey.std())
    seam = float(np.abs(grey[:, 0] - grey[:, -1]).mean())
    step = float(np.abs(np.diff(grey, axis=1)).mean())
    poles = max(float(grey[row].std()) for row in (0, -1))
    return (
        seam <= _MOST_OF_SEAM * step
        and poles <= _MOST_OF_POLE * scatter
        and float(grey[:, 0].std()) >= _LEAST_OF_SEAM * scatter
    )
