"""Variables of MATLAB files, as arrays of finite numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.files import failures_named, require_regular_file


def mat_variables(path: Path, names: Sequence[str]) -> dict[str, Any]:
    """Variables of a MATLAB file by name, as they are.

    Raises
    ------
    DatasetError
        If the file cannot be read, is no MATLAB file, or lacks one of `names`.
    """
    with failures_named(path):
        require_regular_file(path)
        with path.open("rb") as stream:
            content = _loaded(path, stream, names)
    missing = [name for name in names if name not in content]
    if missing:
        raise DatasetError(path, f"lacks the variables {', '.join(missing)}")
    return content


def number_array(path: Path, name: str, value: Any, dimensions: int, shown: str) -> FloatArray:
    """A variable as float64; a DatasetError, with the wanted shape as `shown`, if it holds no numbers."""
    if value.dtype.kind not in "fiu" or value.ndim != dimensions:
        raise DatasetError(path, f"{name} is {value.dtype} {value.shape}: must be numbers, {shown}")
    return np.asarray(value, dtype=np.float64)


def require_finite(path: Path, name: str, array: FloatArray) -> None:
    """Raise a DatasetError at the first element that is not finite."""
    if not np.isfinite(array).all():
        where = np.argwhere(~np.isfinite(array))[0].tolist()
        raise DatasetError(path, f"{name}{where} is {array[tuple(where)]}: must be finite")


def _loaded(path: Path, stream: Any, names: Sequence[str]) -> dict[str, Any]:
    """All variables; the parser fails in many ways, all of which mean a bad file."""
    from scipy.io import loadmat

    try:
        content: dict[str, Any] = loadmat(stream, variable_names=list(names))
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else ""
        raise DatasetError(path, f"not a MATLAB file ({type(error).__name__}: {reason})") from error
    return content
