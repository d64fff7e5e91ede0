"""The folder that a command that runs long writes."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.files import failures_named


def require_folder(folder: Path) -> None:
    """Raise a DatasetError if `folder` is a file."""
    if folder.exists() and not folder.is_dir():
        raise DatasetError(folder, "is a file, a folder is wanted")


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make a folder that can be written; a run that fails leaves none that is empty."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    with failures_named(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    try:
        yield
    except BaseException:
        for path in missing:
            with suppress(OSError):
                path.rmdir()
        raise
