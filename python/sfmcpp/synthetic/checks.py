"""Checks of scalar arguments shared by the scenes."""

from __future__ import annotations

import math

from sfmcpp.errors import InvalidArgument


def require_count(name: str, value: int) -> None:
    """Raise InvalidArgument unless `value` is at least one."""
    if value < 1:
        raise InvalidArgument(f"{name} = {value}: must be at least 1")


def require_positive(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` is finite and positive."""
    if not (math.isfinite(value) and value > 0):
        raise InvalidArgument(f"{name} = {value}: must be finite and positive")


def require_not_negative(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` is finite and at least zero."""
    if not (math.isfinite(value) and value >= 0):
        raise InvalidArgument(f"{name} = {value}: must be finite and not negative")
