"""EXIF facts of a photo: camera, focal length, position and time (CIPA DC-008, "Exif 2.32").

The accuracy of the position is that of an RTK drone of DJI, which stands in its XMP packet.

A value that is missing, damaged or out of its range counts as missing.
"""

from __future__ import annotations

import calendar
import math
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

Tags = Mapping[int, Any]

# Blocks that the first one points to.
EXIF_BLOCK, GPS_BLOCK = 0x8769, 0x8825

_PNG_BLOCKS = {"exif", "Raw profile type exif"}

_MAKE, _MODEL = 0x010F, 0x0110
# How to show the pixels: turned by quarters, and in these cases mirrored, too.
_ORIENTATION, _MIRRORED = 0x0112, (2, 4, 5, 7)
_TIMES = ((0x9003, 0x9291), (0x9004, 0x9292))  # taken, digitised: each with its parts of a second
_FOCAL_MM, _FOCAL_35MM = 0x920A, 0xA405
_LENS, _BODY_SERIAL = 0xA434, 0xA431
STORED_SIZE = (0xA002, 0xA003)
_PLANE_RESOLUTION, _PLANE_UNIT = (0xA20E, 0xA20F), 0xA210
_LATITUDE, _LONGITUDE, _ALTITUDE, _STATUS = 2, 4, 6, 9
# Below the sea, and in Exif 3.0 below the ellipsoid.
_BELOW = (1, b"\x01", "1", 3, b"\x03", "3")
# How a phone of Apple has made the image of several.
_CUSTOM_RENDERED, _JOINED = 0xA401, 6

_MM_PER_PLANE_UNIT = {1: 25.4, 2: 25.4, 3: 10.0, 4: 1.0, 5: 1e-3}
# Of a 36 mm × 24 mm film: CIPA DCG-001 compares by the diagonal of the field of view.
_FILM_DIAGONAL_MM = math.hypot(36, 24)
# In lengths of the longer side: a fish-eye has 0.3, a spotting scope 60; beyond is no camera.
_PLAUSIBLE_FOCAL = (0.2, 100.0)
# As an attribute or an element; metres.
_RTK = re.compile(rb"drone-dji:(Rtk\w+)\s*(?:=\s*[\"']|>)\s*([^<\"'\s]+)")
_RTK_SIGMAS = ("RtkStdLon", "RtkStdLat", "RtkStdHgt")
# Of Google's "Photo Sphere XMP Metadata", as an attribute or an element: equirectangular, cylindrical.
_PROJECTION = re.compile(rb"GPano:ProjectionType\s*(?:=\s*[\"']|>)\s*\w")
_XMP_SEGMENT = b"http://ns.adobe.com/xap/1.0/"
_WHEN = re.compile(r"\s*(\d{4}):(\d\d):(\d\d) (\d\d):(\d\d):(\d\d)")


@dataclass(frozen=True)
class ExifFacts:
    """EXIF facts of a file; see :class:`~sfmcpp.model.photos.Photo` for units and meaning."""

    focal_px: float | None = None
    camera: str = ""
    position: tuple[float, float, float] | None = None
    taken_s: float | None = None
    position_sigmas_m: tuple[float, float, float] | None = None
    is_mirrored: bool = False
    is_panorama: bool = False


def exif_facts(image: Any) -> ExifFacts:
    """EXIF facts of an image that Pillow has opened, without decoding it."""
    main, exif, gps = exif_blocks(image)
    width, height = image.size
    position, packet = _position(gps), _xmp_packet(image)
    return ExifFacts(
        focal_px=_focal_px(exif, (width, height)),
        camera=_camera(main, exif, (width, height)),
        position=position,
        taken_s=_taken_s(exif),
        position_sigmas_m=None if position is None else _position_sigmas_m(packet),
        # Of TIFF, Pillow gives the pixels as they are to be shown.
        is_mirrored=image.format != "TIFF" and main.get(_ORIENTATION) in _MIRRORED,
        is_panorama=exif.get(_CUSTOM_RENDERED) == _JOINED or _PROJECTION.search(packet) is not None,
    )


def exif_blocks(image: Any) -> tuple[Tags, Tags, Tags]:
    """The main block and those of EXIF and GPS, as far as they can be read."""
    found: list[Tags] = [{}, {}, {}]
    # Of PNG, Pillow would decode all pixels to look for a block behind them.
    if image.format == "PNG" and not _PNG_BLOCKS & image.info.keys():
        return found[0], found[1], found[2]
    # Pillow raises whatever its parser stumbles over: struct.error, SyntaxError, TypeError …
    with suppress(Exception):
        main = image.getexif()
        found[0] = dict(main)
        found[1] = dict(main.get_ifd(EXIF_BLOCK))
        found[2] = dict(main.get_ifd(GPS_BLOCK))
    return found[0], found[1], found[2]


def _focal_px(exif: Tags, size: tuple[int, int]) -> float | None:
    for focal in (_focal_from_film(exif, size), _focal_from_plane(exif, size)):
        if focal is not None and _PLAUSIBLE_FOCAL[0] <= focal / max(size) <= _PLAUSIBLE_FOCAL[1]:
            return focal
    return None


def _focal_from_film(exif: Tags, size: tuple[int, int]) -> float | None:
    focal_mm = _positive(exif.get(_FOCAL_35MM))
    return None if focal_mm is None else focal_mm / _FILM_DIAGONAL_MM * math.hypot(*size)


def _focal_from_plane(exif: Tags, size: tuple[int, int]) -> float | None:
    """Focal length by the pixels per length on the sensor, at the size in which the camera stored it."""
    focal_mm = _positive(exif.get(_FOCAL_MM))
    unit = _MM_PER_PLANE_UNIT.get(exif.get(_PLANE_UNIT, 2))
    resolution = next((r for tag in _PLANE_RESOLUTION if (r := _positive(exif.get(tag)))), None)
    if focal_mm is None or unit is None or resolution is None:
        return None
    stored = max((s for tag in STORED_SIZE if (s := _positive(exif.get(tag)))), default=float(max(size)))
    return focal_mm * resolution / unit * max(size) / stored


def _camera(main: Tags, exif: Tags, size: tuple[int, int]) -> str:
    """Empty unless the file tells the focal length: even without a model, two of them are two cameras."""
    focals = [_positive(exif.get(tag)) for tag in (_FOCAL_MM, _FOCAL_35MM)]
    if focals == [None, None]:
        return ""
    names = [main.get(_MAKE), main.get(_MODEL), exif.get(_BODY_SERIAL), exif.get(_LENS)]
    lengths = [f"{f:.6g} mm" for f in focals if f is not None]
    return " | ".join([word for name in names if (word := _text(name))] + lengths + [f"{size[0]}×{size[1]}"])


def _position(gps: Tags) -> tuple[float, float, float] | None:
    latitude = _degrees(gps.get(_LATITUDE), gps.get(_LATITUDE - 1), ("N", "S"), 90)
    longitude = _degrees(gps.get(_LONGITUDE), gps.get(_LONGITUDE - 1), ("E", "W"), 180)
    # Receivers write V, or zeros, before they know where they are.
    if latitude is None or longitude is None or latitude == longitude == 0 or _text(gps.get(_STATUS)) == "V":
        return None
    return latitude, longitude, _height(gps)


def _xmp_packet(image: Any) -> bytes:
    """XMP as it is in the file: Pillow's parser would need a further package."""
    packet = image.info.get("xmp", b"")  # of JPEG from Pillow 11 on
    if isinstance(text := image.info.get("XML:com.adobe.xmp"), str):  # of PNG
        return text.encode()
    segments = [data for _, data in getattr(image, "applist", ()) if data.startswith(_XMP_SEGMENT)]
    return packet if isinstance(packet, bytes) and packet else b"".join(segments)


def _position_sigmas_m(packet: bytes) -> tuple[float, float, float] | None:
    """East, north, up; None unless the receiver had a solution and tells all three."""
    told = {name.decode(): _number(value.decode("latin-1")) for name, value in _RTK.findall(packet)}
    sigmas = [_positive(told.get(name)) for name in _RTK_SIGMAS]
    if told.get("RtkFlag") == 0 or None in sigmas:
        return None
    east, north, up = (sigma for sigma in sigmas if sigma is not None)
    return east, north, up


def _height(gps: Tags) -> float:
    """Height [m]; not a number where it is missing."""
    height = _number(gps.get(_ALTITUDE))
    below = gps.get(_ALTITUDE - 1) in _BELOW
    return math.nan if height is None else -abs(height) if below else height


def _degrees(parts: Any, reference: Any, signs: tuple[str, str], limit: float) -> float | None:
    """Degrees, minutes and seconds as one number, negative in the south and in the west."""
    try:
        numbers = [_number(part) for part in parts]
    except TypeError:
        return None
    if not numbers or len(numbers) > 3 or numbers[0] is None:
        return None
    # Minutes and seconds that are left out are fractions with the denominator zero.
    degrees = sum((number or 0.0) / 60.0**power for power, number in enumerate(numbers))
    sign = _text(reference).upper()[:1]
    if sign not in signs or not 0 <= degrees <= limit:
        return None
    return -degrees if sign == signs[1] else degrees


def _taken_s(exif: Tags) -> float | None:
    """Time by the camera's clock; zones are left out, as some cameras of a set might not tell theirs."""
    for tag, fraction_tag in _TIMES:
        when = _WHEN.match(_text(exif.get(tag)))
        if when is None:
            continue
        year, month, *rest = (int(part) for part in when.groups())
        if year == 0 or not 1 <= month <= 12:
            continue
        digits = re.match(r"\d+", _text(exif.get(fraction_tag)))
        fraction = float(f"0.{digits[0]}") if digits else 0.0
        return float(calendar.timegm((year, month, *rest))) + fraction
    return None


def _text(value: Any) -> str:
    """Text without the zeros and blanks that fill it up."""
    if isinstance(value, bytes):
        value = value.decode("latin-1")
    return value.split("\0")[0].strip() if isinstance(value, str) else ""


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _positive(value: Any) -> float | None:
    number = _number(value)
    return None if number is None or number <= 0 else number
