"""Checks of scalar arguments shared by the scenes."""

from __future__ import annotations

import math

from sfmcpp.errors import InvalidArgument


def require_count(name: str, value: int, at_least: int = 1) -> None:
    """Raise InvalidArgument unless `value` is at least `at_least`."""
    if value < at_least:
        raise InvalidArgument(f"{name} = {value}: must be at least {at_least}")


def require_finite(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` is finite."""
    if not math.isfinite(value):
        raise InvalidArgument(f"{name} = {value}: must be finite")


def require_positive(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` is finite and positive."""
    if not (math.isfinite(value) and value > 0):
        raise InvalidArgument(f"{name} = {value}: must be finite and positive")


def require_not_negative(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` is finite and at least zero."""
    if not (math.isfinite(value) and value >= 0):
        raise InvalidArgument(f"{name} = {value}: must be finite and not negative")


def require_share(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` is between zero and one."""
    if not 0 <= value <= 1:
        raise InvalidArgument(f"{name} = {value}: must be between 0 and 1")


def require_above(name: str, value: float, limit: float, what: str) -> None:
    """Raise InvalidArgument unless `value` is finite and greater than `limit`, which is `what`."""
    if not (math.isfinite(value) and value > limit):
        raise InvalidArgument(f"{name} = {value}: must be finite and above {limit:g}, {what}")
