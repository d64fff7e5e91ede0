"""Degraded copies of photos: smaller, compressed, noisy, blurred, of other exposures, turned, cropped."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageFilter, ImageOps

QUALITY = 95
JPEG_QUALITY, NOISE_LEVELS, BLUR_PX, ROLL_DEG = 15, 20.0, 2.0, 15.0
GAMMAS = (0.5, 1.0, 2.0)
# What a roll of 15° leaves of an image, and which part of each side a crop keeps.
ROLL_MARGIN, CROP = 1 / 8, 5 / 6


@dataclass
class Photo:
    """A photo on its way to its copy.

    Attributes
    ----------
    picture : Image
        What it shows, in RGB.
    number : int
        Its place among the photos of the set.
    rng : Generator
        Of this photo alone, so that a copy does not depend on which others are made.
    middle : (float, float) or None
        Principal point over width and over height, where it is known.
    roll_deg : float
        By how much the picture has been turned so far, anticlockwise.
    """

    picture: Image.Image
    number: int
    rng: np.random.Generator
    middle: tuple[float, float] | None
    roll_deg: float = 0.0


FloatArray = np.ndarray[Any, np.dtype[np.float64]]
Degradation = Callable[[Photo], "Photo | None"]


def smaller(photo: Photo, factor: float) -> Photo:
    """The photo with each side divided by `factor`."""
    width, height = (max(1, int(side / factor)) for side in photo.picture.size)
    photo.picture = photo.picture.resize((width, height), Image.Resampling.LANCZOS)
    return photo


def compressed(photo: Photo) -> Photo:
    """As JPEG of a low quality leaves it."""
    data = io.BytesIO()
    photo.picture.save(data, "JPEG", quality=JPEG_QUALITY)
    photo.picture = Image.open(data).convert("RGB")
    return photo


def noisy(photo: Photo) -> Photo:
    """With normal noise on each colour of each pixel."""
    levels = np.asarray(photo.picture, dtype=np.float64)
    levels = levels + photo.rng.normal(0, NOISE_LEVELS, levels.shape)
    photo.picture = Image.fromarray(np.clip(levels, 0, 255).astype(np.uint8))
    return photo


def blurred(photo: Photo) -> Photo:
    """Out of focus."""
    photo.picture = photo.picture.filter(ImageFilter.GaussianBlur(BLUR_PX))
    return photo


def exposed(photo: Photo) -> Photo:
    """Brighter, as it is, or darker, by turns."""
    gamma = GAMMAS[photo.number % len(GAMMAS)]
    photo.picture = photo.picture.point([int(255 * (level / 255) ** gamma) for level in range(256)] * 3)
    return photo


def grey(photo: Photo) -> Photo:
    """Without its colours."""
    photo.picture = ImageOps.grayscale(photo.picture)
    return photo


def rolled(photo: Photo) -> Photo:
    """Turned a little to one side, not at all, or to the other, by turns, without the corners this leaves."""
    photo.roll_deg += ROLL_DEG * (photo.number % 3 - 1)
    width, height = photo.picture.size
    turned = photo.picture.rotate(photo.roll_deg, Image.Resampling.BICUBIC)
    left, top = int(width * ROLL_MARGIN), int(height * ROLL_MARGIN)
    photo.picture = turned.crop((left, top, width - left, height - top))
    return photo


def turned(photo: Photo) -> Photo:
    """Every second one by a quarter turn, its pixels moved: no EXIF tells of it."""
    if photo.number % 2:
        photo.picture = photo.picture.transpose(Image.Transpose.ROTATE_90)
        photo.roll_deg += 90.0
    return photo


def cropped(photo: Photo) -> Photo:
    """The upper left part: the principal point is a tenth of the side from the middle of what is left."""
    width, height = photo.picture.size
    photo.picture = photo.picture.crop((0, 0, int(width * CROP), int(height * CROP)))
    return photo


def centred(photo: Photo) -> Photo | None:
    """The largest part with the principal point in its middle, to less than half a pixel, if it is known."""
    if photo.middle is None:
        return None
    width, height = photo.picture.size
    x, y = photo.middle[0] * width, photo.middle[1] * height
    half_width, half_height = int(min(x, width - x)), int(min(y, height - y))
    left, top = round(x) - half_width, round(y) - half_height
    photo.picture = photo.picture.crop((left, top, left + 2 * half_width, top + 2 * half_height))
    return photo


def _half(then: Degradation) -> Degradation:
    return lambda photo: then(smaller(photo, 2))


DEGRADATIONS: dict[str, Degradation] = {
    "half": lambda photo: smaller(photo, 2),
    "quarter": lambda photo: smaller(photo, 4),
    "jpeg15": _half(compressed),
    "noise20": _half(noisy),
    "blur": _half(blurred),
    "exposure": _half(exposed),
    "grey": _half(grey),
    "sizes": lambda photo: smaller(photo, (3 + photo.number % 3) / 2),
    "rolled": _half(rolled),
    "turned": _half(turned),
    "alternate": lambda photo: None if photo.number % 2 else smaller(photo, 2),
    "crop": _half(cropped),
    "centred": _half(centred),
}


def degrade(
    photos: Sequence[Path],
    name: str,
    folder: Path,
    *,
    seed: int = 0,
    matrix: Sequence[Sequence[float]] | None = None,
) -> dict[str, float]:
    """Write a degraded copy of each photo, without EXIF.

    Parameters
    ----------
    photos : sequence of Path
        The photos, in their order.
    name : str
        One of `DEGRADATIONS`.
    folder : Path
        Where the copies go, with the stems of the photos and the suffix .jpg.
    seed : int
        Same seed, same copies.
    matrix : 3×3, optional
        Calibration matrix of all photos, for those that are cut around the principal point. The first pixel
        has its centre at (0, 0).

    Returns
    -------
    dict
        By the file name of each copy, the angle [°] by which its picture is turned anticlockwise.
    """
    folder.mkdir(parents=True, exist_ok=True)
    rolls: dict[str, float] = {}
    for number, path in enumerate(photos):
        with Image.open(path) as opened:
            picture = ImageOps.exif_transpose(opened.convert("RGB"))
        middle = None if matrix is None else _middle(matrix, picture.size)
        copy = DEGRADATIONS[name](Photo(picture, number, np.random.default_rng([seed, number]), middle))
        if copy is not None:
            copy.picture.save(folder / f"{path.stem}.jpg", quality=QUALITY)
            rolls[f"{path.stem}.jpg"] = copy.roll_deg
    return rolls


def camera_turns(rolls: Sequence[float]) -> FloatArray:
    """Rotations (n, 3, 3) that bring directions in the cameras of turned pictures to those as they were.

    x is to the right and y down, so that what turns a picture anticlockwise turns x towards −y.
    """
    turns = np.tile(np.eye(3), (len(rolls), 1, 1))
    for turn, roll in zip(turns, np.radians(rolls), strict=True):
        turn[:2, :2] = [[math.cos(roll), -math.sin(roll)], [math.sin(roll), math.cos(roll)]]
    return turns


def _middle(matrix: Sequence[Sequence[float]], size: tuple[int, int]) -> tuple[float, float]:
    return (matrix[0][2] + 0.5) / size[0], (matrix[1][2] + 0.5) / size[1]
