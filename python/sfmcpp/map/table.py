"""Tables of growing columns, with capacity doubled as needed."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from sfmcpp.errors import InvalidArgument


class Table:
    """Named columns, each of one dtype and one shape of a row.

    Parameters
    ----------
    **columns : (dtype, shape of a row, fill)
        The fill is what a row holds that nothing is given for.
    """

    def __init__(self, **columns: tuple[DTypeLike, tuple[int, ...], Any]) -> None:
        self._all: dict[str, NDArray[Any]] = {
            name: np.empty((0, *shape), dtype=dtype) for name, (dtype, shape, _) in columns.items()
        }
        self._fill = {name: fill for name, (_, _, fill) in columns.items()}
        self._count = self._room = 0

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, name: str) -> NDArray[Any]:
        """View of a column; a later `grow` may leave it behind."""
        return self._all[name][: self._count]

    def __getstate__(self) -> dict[str, Any]:
        """Give what is saved of it: the rows without the room behind them."""
        rows = {name: self[name] for name in self._all}
        return {"_all": rows, "_fill": self._fill, "_count": self._count, "_room": self._count}

    def check(self, count: int, **given: ArrayLike | None) -> dict[str, NDArray[Any]]:
        """Arrays of what is given to `grow`, or InvalidArgument where a shape is wrong."""
        values = {name: np.asarray(value) for name, value in given.items() if value is not None}
        for name, value in values.items():
            shape = (count, *self._all[name].shape[1:])
            if value.shape != shape:
                raise InvalidArgument(f"{name}: shape {value.shape}, must be {shape}")
        return values

    def grow(self, count: int, **given: ArrayLike | None) -> NDArray[np.intp]:
        """Append `count` rows of what is given, by name, and return their numbers; all of it, or nothing."""
        values = self.check(count, **given)
        begin, end = self._count, self._count + count
        if end > self._room:
            self._room = max(end, 2 * self._room)
            self._all = {name: _copied_to_capacity(old, self._room) for name, old in self._all.items()}
        for name, column in self._all.items():
            column[begin:end] = values.get(name, self._fill[name])
        self._count = end
        return np.arange(begin, end)


def _copied_to_capacity(old: NDArray[Any], room: int) -> NDArray[Any]:
    new = np.empty((room, *old.shape[1:]), dtype=old.dtype)
    new[: len(old)] = old
    return new
