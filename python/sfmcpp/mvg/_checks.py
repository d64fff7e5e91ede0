"""Checks of arguments shared by the geometry functions."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import finite_array
from sfmcpp.model.problem import FloatArray

_LARGEST_SEED = 2**63 - 1


def intrinsics_row(name: str, value: ArrayLike) -> FloatArray:
    """`value` as ``(f, aspect, cx, cy, skew)``, or InvalidArgument."""
    row = finite_array(name, value, (5,))
    for index, part in enumerate(("f", "aspect")):
        if row[index] <= 0:
            raise InvalidArgument(f"{name}[{index}] = {row[index]}: {part} must be positive")
    return row


def require_not_negative(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` is finite and at least zero."""
    if not (math.isfinite(value) and value >= 0):
        raise InvalidArgument(f"{name} = {value}: must be finite and not negative")


def require_at_least(name: str, value: int, least: int) -> None:
    """Raise InvalidArgument unless `value` is at least `least`."""
    if not value >= least:
        raise InvalidArgument(f"{name} = {value}: must be at least {least}")


def require_fraction(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` lies strictly between zero and one."""
    if not 0 < value < 1:
        raise InvalidArgument(f"{name} = {value}: must lie between 0 and 1")


def require_seed(value: object) -> None:
    """Raise InvalidArgument unless `value` can seed every generator in use."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 0 <= value <= _LARGEST_SEED:
        raise InvalidArgument(f"seed = {value!r}: must be an integer from 0 to {_LARGEST_SEED}")
