"""Validation of array arguments, and operations that arrays of indices are used for."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from sfmcpp.errors import InvalidArgument

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int32]
BoolArray = NDArray[np.bool_]

ANY = -1


def finite_array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """`value` as a C-contiguous float64 array.

    Parameters
    ----------
    name : str
        Name of the argument, for messages.
    value : array-like
        What the caller gave.
    shape : tuple of int
        Shape it must have; `ANY` stands for any length.

    Returns
    -------
    float64 array of that shape

    Raises
    ------
    InvalidArgument
        If the shape differs, or an element is no finite number.
    """
    array = shaped_array(name, value, shape)
    if not np.isfinite(array).all():
        where = np.argwhere(~np.isfinite(array))[0].tolist()
        raise InvalidArgument(f"{name}{where} = {array[tuple(where)]}: must be finite")
    return array


def as_stored(array: ArrayLike, dtype: DTypeLike) -> NDArray[Any]:
    """`array` C-contiguous and aligned as the core reads it; fields of packed records are neither."""
    stored = np.ascontiguousarray(array, dtype=dtype)
    return stored if stored.flags.aligned else stored.copy()


def require_unmasked(name: str, value: ArrayLike | None) -> None:
    """Raise InvalidArgument for an array with masked entries: NumPy would take what lies under the mask."""
    masks = sys.modules.get("numpy.ma")  # without it there are none
    # Another thread may be importing it: while its names are missing there are none either.
    if masks is not None and hasattr(masks, "is_masked") and masks.is_masked(value):
        count = int(masks.getmaskarray(value).sum())
        raise InvalidArgument(f"{name}: {count} entries are masked: must be filled in or left out")


def shaped_array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    """Like :func:`finite_array`, but any number passes, NaN too."""
    given = number_array(name, value)
    if np.iscomplexobj(given):  # of which NumPy would take the real parts
        raise InvalidArgument(f"{name}: must be an array of real numbers")
    try:
        array = as_stored(given, np.float64)
    except (TypeError, ValueError):
        raise InvalidArgument(f"{name} = {value!r}: must be an array of numbers") from None
    except OverflowError:  # integers of Python may have thousands of digits
        raise InvalidArgument(f"{name}: holds an integer beyond all numbers of float64") from None
    if array.ndim != len(shape) or any(n not in (ANY, m) for n, m in zip(shape, array.shape, strict=True)):
        wanted = ", ".join("any" if n == ANY else str(n) for n in shape)
        raise InvalidArgument(f"{name}: shape {array.shape}, must be ({wanted})")
    return array


def require_double(name: str, *values: ArrayLike | None) -> None:
    """Raise InvalidArgument for numbers of a function that has computed them in single precision or half."""
    for value in values:
        dtype = number_array(name, value).dtype if value is not None else np.dtype(np.float64)
        if dtype.kind == "f" and dtype.itemsize < 8:
            raise InvalidArgument(
                f"{name}: returns {dtype}, must compute in float64: a solve needs its digits "
                '(JAX: jax.config.update("jax_enable_x64", True))'
            )


def require_int32(name: str, array: NDArray[Any]) -> None:
    """Raise InvalidArgument at the largest or least number that does not fit in 32 bits: it would wrap."""
    if not array.size or np.can_cast(array.dtype, np.int32):
        return
    limits = np.iinfo(np.int32)
    for worst in (array.max(), array.min()):
        if not limits.min <= worst <= limits.max:
            raise InvalidArgument(f"{name}: value {worst} does not fit in 32 bits")


def index_array(name: str, value: ArrayLike) -> IndexArray:
    """`value` as a C-contiguous (any,) int32 array.

    Raises
    ------
    InvalidArgument
        If it has another shape, is not of whole numbers, or one of them does not fit in 32 bits.
    """
    array = number_array(name, value)
    if array.ndim != 1 or (array.size and not np.issubdtype(array.dtype, np.integer)):
        raise InvalidArgument(f"{name}: {array.dtype} {array.shape}, must be (any,) whole numbers")
    require_int32(name, array)
    return as_stored(array, np.int32)


def numbers_below(name: str, value: ArrayLike, count: int) -> NDArray[np.intp]:
    """`value` as a (any,) array of numbers of `count` things, from 0 on; or InvalidArgument."""
    numbers = index_array(name, value)
    if len(numbers) and not 0 <= numbers.min() <= numbers.max() < count:
        raise InvalidArgument(f"{name}: must be from 0 to {count - 1}")
    return numbers.astype(np.intp)


def number_array(name: str, value: ArrayLike) -> NDArray[Any]:
    """`value` as an array; InvalidArgument: rows differ in length, masked entries, or dates."""
    require_unmasked(name, value)
    try:
        array = np.asarray(value)
    except ValueError:
        raise InvalidArgument(f"{name} = {value!r}: must be an array of numbers") from None
    if array.dtype.kind in "mM":  # of which NumPy would take the counts, in whatever unit they are
        example = "(times - times[0]) / np.timedelta64(1, 's')"
        raise InvalidArgument(f"{name}: dtype {array.dtype}: must be numbers; seconds are {example}")
    return array


def typed_array(name: str, value: ArrayLike, dtype: DTypeLike, shape: tuple[int, ...]) -> NDArray[Any]:
    """`value` as a C-contiguous array of that dtype and shape (−1: any length), or InvalidArgument."""
    array = number_array(name, value)
    empty = [max(n, 0) for n in shape]
    if array.size == 0 and array.ndim <= 1 and 0 in empty:
        array = array.reshape(empty)
    if array.dtype != dtype and not np.can_cast(array.dtype, dtype, casting="same_kind"):
        raise InvalidArgument(f"{name}: dtype {array.dtype} cannot be used as {np.dtype(dtype).name}")
    if array.ndim != len(shape) or any(n not in (-1, m) for n, m in zip(shape, array.shape, strict=True)):
        wanted = ", ".join("any" if n == -1 else str(n) for n in shape)
        raise InvalidArgument(f"{name}: shape {array.shape}, must be ({wanted})")
    if np.dtype(dtype) == np.int32:
        require_int32(name, array)
    return as_stored(array, dtype)


def for_each(name: str, value: ArrayLike, count: int, shape: tuple[int, ...] = ()) -> FloatArray:
    """(count, *shape) float64 of as many values, or of one for all, of that shape; else InvalidArgument."""
    array = number_array(name, value)
    if array.shape == shape:
        array = np.tile(array, (count, *(1 for _ in shape)))
    return typed_array(name, array, np.float64, (count, *shape))


def chosen_rows(value: ArrayLike, count: int) -> NDArray[Any]:
    """The argument `chosen` as numbers from 0 to `count` − 1, or as a mask of `count`."""
    rows = number_array("chosen", value)
    if rows.dtype == np.bool_:
        if rows.shape != (count,):
            raise InvalidArgument(f"chosen: mask of shape {rows.shape}, must be ({count},)")
        return rows
    return numbers_below("chosen", rows, count)


def each_once(value: ArrayLike, count: int, what: str) -> NDArray[np.intp]:
    """The argument `chosen` as numbers of `count` things, by numbers or a mask; none is named twice."""
    rows: NDArray[np.intp] = np.arange(count)[chosen_rows(value, count)]
    if len(np.unique(rows)) < len(rows):
        raise InvalidArgument(f"chosen: a {what} is named twice")
    return rows


def new_numbers(kept: NDArray[Any], count: int) -> IndexArray:
    """(count,) place of each number in `kept`, all different; −1 where it is not there."""
    numbers = np.full(count, -1, dtype=np.int32)
    numbers[kept] = np.arange(len(kept), dtype=np.int32)
    return numbers


def largest_of_each(
    group: NDArray[np.integer[Any]], values: FloatArray, count: int, *, least: float = 0.0
) -> FloatArray:
    """(count,) or (count, K) largest of the values (n,) or (n, K) of each `group` (n,); or `least`."""
    largest = np.full((count, *values.shape[1:]), least)
    for column, numbers in zip(np.atleast_2d(largest.T), np.atleast_2d(values.T), strict=True):
        np.maximum.at(column, group, numbers)  # rows take it ten times as long
    return largest


def require_increasing(name: str, stamps: FloatArray) -> None:
    """Raise InvalidArgument at the first stamp [s] that does not come after the one before it."""
    late = np.flatnonzero(np.diff(stamps) <= 0)
    if not len(late):
        return
    row = int(late[0]) + 1
    before, after = float(stamps[row - 1]), float(stamps[row])
    what = "is a duplicate of the stamp" if before == after else f"is earlier than {before!r},"
    raise InvalidArgument(
        f"{name}[{row}] = {after!r} s {what} before it: time stamps must increase strictly "
        f"({len(late)} of {len(stamps)} do not)"
    )
