"""Validation of scalar arguments and rotations."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import TypeVar

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import BoolArray, FloatArray

_LARGEST_SEED, _LARGEST_COUNT = 2**63 - 1, 2**31 - 1

Known = TypeVar("Known")


# Of a rotation in memory, and of one read from a file that prints few digits.
ROTATION_TOLERANCE, PRINTED_ROTATION_TOLERANCE = 1e-6, 1e-3
# Stamps of one run that follow each other are no further apart.
LONGEST_PAUSE_S = 86_400.0


def _is_finite(name: str, value: float) -> bool:
    try:
        return math.isfinite(value)
    except (TypeError, ValueError, OverflowError):
        raise InvalidArgument(f"{name} = {value!r}: must be a number") from None


def require_text(name: str, value: object) -> None:
    """Raise InvalidArgument unless `value` is text that the core can hold, in UTF-8."""
    try:
        if isinstance(value, str) and value.encode() is not None:
            return
    except UnicodeEncodeError:
        pass
    raise InvalidArgument(f"{name} = {value!a}: must be text that UTF-8 can hold")


def require_finite(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` is finite."""
    if not _is_finite(name, value):
        raise InvalidArgument(f"{name} = {value}: must be finite")


def require_positive(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` is finite and positive."""
    if not (_is_finite(name, value) and value > 0):
        raise InvalidArgument(f"{name} = {value}: must be finite and positive")


def require_not_negative(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` is finite and at least zero."""
    if not (_is_finite(name, value) and value >= 0):
        raise InvalidArgument(f"{name} = {value}: must be finite and not negative")


def require_above(name: str, value: float, limit: float, what: str) -> None:
    """Raise InvalidArgument unless `value` is finite and greater than `limit`, which is `what`."""
    if not (_is_finite(name, value) and value > limit):
        raise InvalidArgument(f"{name} = {value}: must be finite and above {limit:g}, {what}")


def require_at_most(name: str, value: float, limit: float) -> None:
    """Raise InvalidArgument if `value` is greater than `limit`."""
    if value > limit:
        raise InvalidArgument(f"{name} = {value}: must be at most {limit:g}")


def require_share(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` is from zero to one."""
    if not (_is_finite(name, value) and 0 <= value <= 1):
        raise InvalidArgument(f"{name} = {value}: must be between 0 and 1")


def require_fraction(name: str, value: float) -> None:
    """Raise InvalidArgument unless `value` lies strictly between zero and one."""
    if not (_is_finite(name, value) and 0 < value < 1):
        raise InvalidArgument(f"{name} = {value}: must lie between 0 and 1")


def require_count(name: str, value: float, at_least: int = 1) -> None:
    """Raise InvalidArgument unless `value` is a whole number, at least `at_least`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise InvalidArgument(f"{name} = {value!r}: must be a whole number")
    if not value >= at_least:
        raise InvalidArgument(f"{name} = {value}: must be at least {at_least}")
    if value > _LARGEST_COUNT:
        raise InvalidArgument(f"{name} = {value}: must be at most {_LARGEST_COUNT}")


def require_seed(value: object) -> None:
    """Raise InvalidArgument unless `value` can seed every generator in use."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 0 <= value <= _LARGEST_SEED:
        raise InvalidArgument(f"seed = {value!r}: must be an integer from 0 to {_LARGEST_SEED}")


def require_one_of(name: str, value: object, known: Collection[str]) -> None:
    """Raise InvalidArgument, with all that is `known`, unless `value` is among it."""
    if not isinstance(value, str) or value not in known:
        raise InvalidArgument(f"{name} = {value!r}: must be one of {', '.join(known)}")


def looked_up(name: str, value: str, known: Mapping[str, Known]) -> Known:
    """Value of `known` with the key `value`; InvalidArgument, with all keys, if there is none."""
    require_one_of(name, value, known)
    return known[value]


def is_rotation(matrices: FloatArray, tolerance: float = ROTATION_TOLERANCE) -> BoolArray:
    """Whether each matrix (…, 3, 3) is orthonormal to `tolerance` and right-handed."""
    with np.errstate(all="ignore"):  # what is no number is no rotation either
        gram = matrices @ np.swapaxes(matrices, -1, -2)
        orthonormal = (np.abs(gram - np.eye(3)) <= tolerance).all(axis=(-1, -2))
        return np.asarray(orthonormal & (np.linalg.det(matrices) > 0))


def require_rotation(name: str, matrix: FloatArray) -> None:
    """Raise InvalidArgument unless a matrix (3, 3) is a rotation."""
    if not is_rotation(matrix):
        raise InvalidArgument(f"{name}: must be orthonormal and right-handed")


def require_near(name: str, before_s: float, time_s: float) -> None:
    """Refuse a stamp of a run that comes more than a day after the one before: it is in another unit."""
    if time_s - before_s > LONGEST_PAUSE_S:
        raise InvalidArgument(
            f"{name} = {time_s:.9g} s: must be within a day of {before_s:.9g} s, the one before; "
            "was it given in ms, us or ns?"
        )
