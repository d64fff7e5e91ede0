"""Photo files with EXIF blocks (CIPA DC-008, "Exif 2.32")."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from sfmcpp.sources.io.files import failures_named
from sfmcpp.sources.synthetic.photos.rendering import Picture
from sfmcpp.sources.vision.exif import EXIF_BLOCK, GPS_BLOCK
from sfmcpp.sources.vision.images import load_pillow

_FOCAL_MM = 8
_QUALITY = 95


@dataclass(frozen=True)
class ExifContent:
    """EXIF contents of the file of a photo.

    Attributes
    ----------
    focal_px : float or None
        Focal length [px].
    position : (float, float, float) or None
        Latitude, longitude [deg, WGS84] and height [m].
    """

    focal_px: float | None = None
    position: tuple[float, float, float] | None = None


def write_photo(path: Path, picture: Picture, content: ExifContent) -> None:
    """Write one photo, as JPEG or PNG by the suffix of its name.

    Raises
    ------
    DatasetError
        If the file cannot be written.
    """
    pillow = load_pillow()
    exif = pillow.Exif()
    if content.focal_px is not None:
        exif.update({0x010F: "sfmcpp", 0x0110: "synthetic"})
        exif.get_ifd(EXIF_BLOCK).update(_focal_tags(content.focal_px))
    if content.position is not None:
        exif.get_ifd(GPS_BLOCK).update(_position_tags(*content.position))
    with failures_named(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        pillow.fromarray(picture).save(path, exif=exif, quality=_QUALITY)


def _focal_tags(focal_px: float) -> dict[int, Any]:
    """A focal length, and how many pixels a millimetre of the sensor holds."""
    per_mm = _rational(focal_px / _FOCAL_MM)
    return {0x920A: float(_FOCAL_MM), 0xA20E: per_mm, 0xA20F: per_mm, 0xA210: 4}


def _position_tags(latitude: float, longitude: float, height_m: float) -> dict[int, Any]:
    return {
        1: "N" if latitude >= 0 else "S",
        2: _degrees(abs(latitude)),
        3: "E" if longitude >= 0 else "W",
        4: _degrees(abs(longitude)),
        5: b"\0" if height_m >= 0 else b"\1",
        6: _rational(abs(height_m)),
    }


def _degrees(angle: float) -> tuple[Any, Any, Any]:
    minutes, seconds = divmod(round(angle * 3600, 6), 60)
    whole, minutes = divmod(minutes, 60)
    return _rational(whole), _rational(minutes), _rational(seconds)


def _rational(value: float) -> Any:
    from PIL.TiffImagePlugin import IFDRational

    found = Fraction(value).limit_denominator(100_000)
    return IFDRational(found.numerator, found.denominator)
