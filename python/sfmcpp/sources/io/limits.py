"""How much memory a small file may ask for; variables of the environment allow more, or less."""

from __future__ import annotations

import os

from sfmcpp.errors import InvalidArgument

MAX_EXPANDED, MAX_IMAGE = "SFMCPP_MAX_EXPANDED_MB", "SFMCPP_MAX_IMAGE_MPX"

# Tracks of a drive, mostly "not seen", shrink to an 86th; text shrinks to a tenth at best.
_EXPANSION = 100
_ALWAYS_READABLE_BYTES, _MOST_EXPANDED_BYTES = 64 << 20, 2 << 30
_MOST_DIGITS = 18
_MOST_PIXELS = 160_000_000  # the largest sensors have 150 million


def largest_expansion(size: int) -> int:
    """Bytes that `size` compressed bytes may expand to.

    They are 100 times as many, but 64 MB at least and 2 GB at most; or what `MAX_EXPANDED` says, in MB.

    Raises
    ------
    InvalidArgument
        If the variable is no positive whole number.
    """
    asked = _asked(MAX_EXPANDED)
    if asked is not None:
        return asked << 20
    return min(_MOST_EXPANDED_BYTES, max(_ALWAYS_READABLE_BYTES, _EXPANSION * size))


def expands_too_far(limit: int) -> str:
    """Why compressed data are refused."""
    return f"expands to more than {limit} bytes: refused; {MAX_EXPANDED} allows more"


def largest_image() -> int:
    """Pixels that an image may have: 160 million, or what `MAX_IMAGE` says, in millions."""
    asked = _asked(MAX_IMAGE)
    return _MOST_PIXELS if asked is None else asked * 1_000_000


def _asked(variable: str) -> int | None:
    text = os.environ.get(variable, "")
    if not text:
        return None
    if not text.isdecimal() or len(text) > _MOST_DIGITS or int(text) < 1:
        told = text if len(text) <= _MOST_DIGITS else f"{text[:_MOST_DIGITS]}…"
        raise InvalidArgument(f"{variable} = {told!r}: must be a positive whole number")
    return int(text)
