"""Positions as exiftool prints them without ``-n``: ``48 deg 6' 12.50" N``, ``500 m Above Sea Level``.

An angle without its hemisphere is none: south and west would be lost.
"""

from __future__ import annotations

import re

_ANGLE = re.compile(r"(\d{1,3}) deg (\d{1,2})' (\d{1,2}(?:\.\d+)?)\" ?([NSEW])[a-z]*", re.IGNORECASE)
_HEIGHT = re.compile(r"(-?\d+(?:\.\d+)?) m(?: (above|below) sea level)?", re.IGNORECASE)
_SIXTY = 60


def number_of_exif_text(text: str) -> float | None:
    """Degrees, south and west negative, or metres, below the sea negative; None of another text."""
    if angle := _ANGLE.fullmatch(text.strip()):
        degrees = int(angle[1]) + (int(angle[2]) + float(angle[3]) / _SIXTY) / _SIXTY
        return -degrees if angle[4].upper() in "SW" else degrees
    if height := _HEIGHT.fullmatch(text.strip()):
        return -float(height[1]) if (height[2] or "").lower() == "below" else float(height[1])
    return None
