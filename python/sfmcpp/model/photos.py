"""Photos and their features as structure from motion takes them, and the order of their names."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from string import digits

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.arrays import FloatArray

# Pixels of photos: the centre of the top left one is at (0.5, 0.5), as COLMAP has it.


@dataclass(frozen=True)
class Photo:
    """One image of a set: what is known of it before anything is detected.

    Attributes
    ----------
    name : str
        Its path below the folder of the set, with forward slashes; unique in the set.
    path : Path or None
        Its file; None for images that are known by their tracks alone.
    size : tuple of int
        Width and height [px]; (0, 0) where unknown.
    focal_px : float or None
        Focal length that the file tells [px].
    camera : str
        What tells that two photos come from one camera at one focal length: maker, model, focal length and
        size; empty where the file does not tell.
    position : tuple of float or None
        Latitude, longitude [deg, WGS84] and height [m, not a number if it is missing] that the file tells.
    taken_s : float or None
        When it was taken [s], counted from any origin that the set shares.
    digest : str
        Of the file's bytes and its mask's: equal content, equal digest. Empty without a file.
    mask : Path or None
        Image in whose black parts nothing is detected.
    position_sigmas_m : tuple of float or None
        Standard deviations of the position, east, north and up [m].
    is_mirrored : bool
        Whether its file asks to be shown as its mirror image; pixels are as they are stored.
    is_panorama : bool
        Whether its file says that it was joined from several photos, or shows all around, or its pixels do:
        no camera's image.
    further_images : int
        Images of the same size that its file holds besides, as frames of an animation or pages; not read.
    """

    name: str
    path: Path | None = None
    size: tuple[int, int] = (0, 0)
    focal_px: float | None = None
    camera: str = ""
    position: tuple[float, float, float] | None = None
    taken_s: float | None = None
    digest: str = ""
    mask: Path | None = None
    position_sigmas_m: tuple[float, float, float] | None = None
    is_mirrored: bool = False
    is_panorama: bool = False
    further_images: int = 0


@dataclass(frozen=True, eq=False)
class Features:
    """Features detected in an image.

    Attributes
    ----------
    pixels : (n, 2) float64
        Positions [px]; the centre of the top left pixel is at (0.5, 0.5).
    scales : (n,) float64
        Size (standard deviation of the blur) of what was detected [px]; not a number where unknown.
    angles : (n,) float64
        Orientation, from x towards y [rad]; not a number where unknown.
    colors : (n, 3) uint8
        Red, green, blue.
    descriptors : (n, D) uint8
        Compared by the Euclidean distance; D is 0 where there are none.
    """

    pixels: FloatArray
    scales: FloatArray
    angles: FloatArray
    colors: NDArray[np.uint8]
    descriptors: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.pixels)


def words_and_numbers(name: str) -> list[tuple[int, str]]:
    """Parts of a name: (number, "") where it has the digits 0 to 9, (-1, text) elsewhere."""
    parts = re.findall(r"[0-9]+|[^0-9]+", name)
    return [(int(part), "") if part[0] in digits else (-1, part) for part in parts]


def natural_order(name: str) -> tuple[list[tuple[int, str]], str]:
    """Key by which image2 comes before image10; different names have different keys."""
    return words_and_numbers(name), name
