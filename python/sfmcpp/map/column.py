"""An array that grows at its end, by doubling: each row is moved a few times at most."""

from __future__ import annotations

from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import InvalidArgument

_Scalar = TypeVar("_Scalar", bound=np.generic)


class Column(Generic[_Scalar]):
    """Rows of one shape and dtype.

    Parameters
    ----------
    dtype : numpy scalar type
        Of every element.
    width : tuple of int
        Shape of a row.
    fill : scalar
        What a row holds that nothing is given for.
    """

    def __init__(self, dtype: type[_Scalar], width: tuple[int, ...] = (), fill: Any = 0) -> None:
        self._all: NDArray[_Scalar] = np.empty((0, *width), dtype=dtype)
        self._fill, self._count = fill, 0

    @property
    def rows(self) -> NDArray[_Scalar]:
        """View of all rows; a later `grow` may leave it behind."""
        return self._all[: self._count]

    def grow(self, count: int, values: ArrayLike | None = None, name: str = "values") -> None:
        """Append `count` rows: `values`, which `name` is the name of in messages, or the fill."""
        begin, end = self._count, self._count + count
        if end > len(self._all):
            more = np.empty((max(end, 2 * len(self._all)), *self._all.shape[1:]), dtype=self._all.dtype)
            more[:begin] = self.rows
            self._all = more
        if values is not None and np.shape(values) != (count, *self._all.shape[1:]):
            raise InvalidArgument(
                f"{name}: shape {np.shape(values)}, must be {(count, *self._all.shape[1:])}"
            )
        self._all[begin:end] = self._fill if values is None else values
        self._count = end
