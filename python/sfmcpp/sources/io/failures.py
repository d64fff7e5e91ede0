"""The one exception of this package: whatever goes wrong with a file becomes a DatasetError."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sfmcpp.errors import DatasetError


@contextmanager
def failures_named(path: Path) -> Iterator[None]:
    """Turn failures of the operating system inside the block into a DatasetError that names `path`."""
    try:
        yield
    except OSError as error:
        raise DatasetError(path, (error.strerror or str(error)).lower()) from error
    except MemoryError as error:
        raise DatasetError(path, "does not fit in memory") from error
