"""What commands share that run long and write a folder: the folder, and a Ctrl-C that ends them in order."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.files import failures_named


def require_folder(folder: Path) -> None:
    """Raise a DatasetError if `folder` is a file."""
    if folder.exists() and not folder.is_dir():
        raise DatasetError(folder, "is a file, a folder is wanted")


@contextmanager
def made(folder: Path) -> Iterator[None]:
    """Make a folder; a run that fails leaves none that is empty."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    with failures_named(folder):
        folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        for path in missing:
            with suppress(OSError):
                path.rmdir()
        raise


@contextmanager
def ctrl_c_noted() -> Iterator[Callable[[], bool]]:
    """Take note of the first Ctrl-C, so that nothing is left half done; the second one ends at once."""
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    asked = threading.Event()

    def note(number: int, frame: FrameType | None) -> None:
        asked.set()
        signal.signal(signal.SIGINT, before)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield asked.is_set
    finally:
        signal.signal(signal.SIGINT, before)
