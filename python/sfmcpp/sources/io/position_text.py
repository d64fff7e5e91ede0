"""Coordinates with their hemisphere or unit: ``48° 6' 12.50" N``, ``500 m Above Sea Level``.

As exiftool prints them without ``-n`` (``48 deg 6' 12.50" N``) or with a format (``48.103472 N``), and as
maps and receivers have them. An angle without its hemisphere is none: south and west would be lost.
"""

from __future__ import annotations

import re

_NUMBER = r"(\d{1,3}(?:\.\d+)?)"
_HEMISPHERE = r"([NSEW])(?:orth|outh|ast|est)?"
_ANGLE = re.compile(
    rf"(?:{_HEMISPHERE} ?)?{_NUMBER} ?(?:deg|[°º])?(?: ?{_NUMBER} ?['′’](?: ?{_NUMBER} ?(?:[\"″”]|''))?)?"
    rf"(?: ?{_HEMISPHERE})?",
    re.IGNORECASE,
)
_HEIGHT = re.compile(r"(-?\d+(?:\.\d+)?) m(?: (above|below) sea level)?", re.IGNORECASE)
_SIXTY = 60
_SOUTH_AND_WEST = "SW"


def degrees_of_text(text: str, hemispheres: str) -> float | None:
    """Degrees, south and west negative, of an angle with one of the `hemispheres`, ``"NS"`` or ``"EW"``.

    None of another text, of minutes or seconds of 60 and more, and of whole units before smaller ones that
    are none.
    """
    found = _ANGLE.fullmatch(" ".join(text.split()))
    if found is None:
        return None
    before, *parts, behind = found.groups()
    given = [part for part in parts if part is not None]
    if (before is None) == (behind is None) or any("." in part for part in given[:-1]):
        return None
    degrees, minutes, seconds = (float(part or 0) for part in parts)
    letter = (before or behind).upper()
    if letter not in hemispheres or max(minutes, seconds) >= _SIXTY:
        return None
    angle = degrees + (minutes + seconds / _SIXTY) / _SIXTY
    return -angle if letter in _SOUTH_AND_WEST else angle


def metres_of_text(text: str) -> float | None:
    """Metres, below the sea negative, of a height with its unit; None of another text."""
    height = _HEIGHT.fullmatch(text.strip())
    if height is None:
        return None
    return -float(height[1]) if (height[2] or "").lower() == "below" else float(height[1])
