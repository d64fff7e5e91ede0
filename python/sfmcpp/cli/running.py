"""The folder that a command that runs long writes."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sfmcpp.sources.io.files import failures_named, require_folder, require_regular_file


def require_results_folder(folder: Path, files: Iterable[str], model: str) -> None:
    """Raise a DatasetError if `folder` or its `model` cannot be a folder, or one of its `files` is one."""
    for path in (folder, folder / model):
        require_folder(path)
    for name in files:
        require_regular_file(folder / name)


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
