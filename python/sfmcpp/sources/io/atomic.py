"""Files that appear complete or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import IO

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.compression import require_regular_file
from sfmcpp.sources.io.failures import failures_named


@contextmanager
def atomic_files(*targets: Path) -> Iterator[tuple[IO[bytes], ...]]:
    """Open one binary file for each target; all replace their targets when the block ends well.

    Until then they are temporary files in the targets' folders; if the block raises, they are removed
    and the targets stay as they were. Symbolic links are followed.

    Raises
    ------
    DatasetError
        If a target is a directory, a device or a pipe, or its folder cannot be written.
    """
    resolved = [_replaceable(target) for target in targets]
    temporaries = [path.with_name(f".{path.name}.{secrets.token_hex(4)}.tmp") for path in resolved]
    try:
        with ExitStack() as stack:
            yield tuple(
                stack.enter_context(_create(path, t)) for path, t in zip(temporaries, targets, strict=True)
            )
        _replace_all(temporaries, resolved)
    finally:
        for temporary in temporaries:
            temporary.unlink(missing_ok=True)


@contextmanager
def atomic_folder(folder: Path, names: Sequence[str]) -> Iterator[tuple[IO[bytes], ...]]:
    """Like :func:`atomic_files` for `names` in `folder`, made if missing (and removed on failure)."""
    made = _make_folder(folder)
    try:
        with atomic_files(*(folder / name for name in names)) as files:
            yield files
    except BaseException:
        if made:
            folder.rmdir()
        raise


def _make_folder(folder: Path) -> bool:
    if folder.is_dir():
        return False
    with failures_named(folder):
        folder.mkdir()
    return True


def _replaceable(target: Path) -> Path:
    with failures_named(target):
        require_regular_file(target)
        if not target.parent.is_dir():
            raise DatasetError(target, f"the folder {str(target.parent)!r} does not exist")
        return Path(os.path.realpath(target))


def _create(temporary: Path, target: Path) -> IO[bytes]:
    with failures_named(target):
        return temporary.open("xb")


def _replace_all(temporaries: Sequence[Path], targets: Sequence[Path]) -> None:
    for temporary, target in zip(temporaries, targets, strict=True):
        with failures_named(target):
            temporary.replace(target)
