"""Variables of MATLAB files, as arrays of finite numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.files import failures_named, require_regular_file
from sfmcpp.sources.io.limits import largest_expansion
from sfmcpp.sources.io.mat5 import read_matrices


def mat_variables(path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Arrays of numbers of a MATLAB file by name, as they are.

    Raises
    ------
    DatasetError
        If the file cannot be read, is no MATLAB file of version 5 to 7, lacks one of `names`, or holds
        something else under it.
    """
    with failures_named(path):
        require_regular_file(path)
        data = path.read_bytes()
    content = read_matrices(path, data, names.__contains__, largest_expansion(len(data)))
    missing = [name for name in names if name not in content]
    if missing:
        raise DatasetError(path, f"lacks the variables {', '.join(missing)}")
    return content


def number_array(path: Path, name: str, value: Any, dimensions: int, shown: str) -> FloatArray:
    """A variable as float64; a DatasetError, with the wanted shape as `shown`, if it has other dimensions."""
    if value.ndim != dimensions:
        raise DatasetError(path, f"{name} is {value.dtype} {value.shape}: must be numbers, {shown}")
    return np.asarray(value, dtype=np.float64)


def require_finite(path: Path, name: str, array: FloatArray) -> None:
    """Raise a DatasetError at the first element that is not finite."""
    if not np.isfinite(array).all():
        where = np.argwhere(~np.isfinite(array))[0].tolist()
        raise DatasetError(path, f"{name}{where} is {array[tuple(where)]}: must be finite")
