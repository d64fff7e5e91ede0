"""Atomic writing of one file or several: they appear complete or not at all.

Content goes to temporary files beside the targets and to the disk before it takes their names. A temporary
file is locked as long as its writer lives: one that is not was left by a process that was killed.
"""

from __future__ import annotations

import fcntl
import os
import secrets
import stat
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import IO

from sfmcpp.sources.io.files import (
    failures_named,
    is_folder,
    is_present,
    require_parent_folder,
    require_replaceable,
)

# Short names of their own: with a suffix, a target's could become too long.
_TEMPORARY, _BEFORE = ".sfmcpp-new-", ".sfmcpp-old-"
# Small pieces are written together: file systems keep, and bring to the disk, large ones in half the time.
_BUFFER_BYTES = 1 << 19


@contextmanager
def atomic_files(*targets: Path, durable: bool = True) -> Iterator[tuple[IO[bytes], ...]]:
    """Open one binary file for each target; all replace their targets when the block ends well.

    Until then they are temporary files in the targets' folders; if the block raises, or a target cannot be
    replaced, they are removed and the targets stay as they were. Several targets never stand beside what was
    there before: if the process is killed as they are replaced, one at least is missing. Symbolic links are
    followed. A file that is replaced hands on its permissions.

    Parameters
    ----------
    *targets : Path
        What to write.
    durable : bool
        Whether the content must survive a power failure from the end of the block on.

    Raises
    ------
    DatasetError
        If a target is a directory, a device or a pipe, or it is read-only, or its folder cannot be written.
    """
    resolved = [_resolved_target(target) for target in targets]
    for folder in {path.parent for path in resolved}:
        remove_leftovers(folder)
    temporaries = [_temporary_path(path, _TEMPORARY) for path in resolved]
    try:
        with failures_named(targets[0]), ExitStack() as stack:
            files = [
                stack.enter_context(_create(path, t)) for path, t in zip(temporaries, targets, strict=True)
            ]
            yield tuple(files)
            for file in files:
                _flush_file(file, durable)
            _replace_all(temporaries, resolved)
        if durable:
            _sync_folders({path.parent for path in resolved})
    finally:
        _remove(temporaries)


@contextmanager
def atomic_folder(folder: Path, names: Sequence[str]) -> Iterator[tuple[IO[bytes], ...]]:
    """Like :func:`atomic_files` for `names` in `folder`, made if missing (and removed on failure)."""
    made = _make_folder(folder)
    try:
        with atomic_files(*(folder / name for name in names)) as files:
            yield files
    except BaseException:
        if made:
            with suppress(OSError):
                folder.rmdir()
        raise


def _make_folder(folder: Path) -> bool:
    if is_folder(folder):
        return False
    with failures_named(folder):
        folder.mkdir()
    return True


def _resolved_target(target: Path) -> Path:
    with failures_named(target):
        require_replaceable(target)
        require_parent_folder(target)
        return Path(os.path.realpath(target))


def _temporary_path(target: Path, prefix: str) -> Path:
    return target.with_name(prefix + secrets.token_hex(8))


def _create(temporary: Path, target: Path) -> IO[bytes]:
    with failures_named(target):
        file = _created_and_locked(temporary)
        with suppress(OSError):
            _give_permissions_of(target, file)
        return file


def _created_and_locked(temporary: Path) -> IO[bytes]:
    """A new file; made again where another process took it for left over before it was locked."""
    while True:
        file = temporary.open("xb", buffering=_BUFFER_BYTES)
        with suppress(OSError):  # some file systems have no locks, and then nothing is swept
            fcntl.flock(file, fcntl.LOCK_EX)
        if os.fstat(file.fileno()).st_nlink:
            return file
        file.close()


def _give_permissions_of(target: Path, file: IO[bytes]) -> None:
    """Let a file have owner, group and mode of the one that it will replace, as far as allowed."""
    before = target.stat()
    with suppress(OSError):
        os.fchown(file.fileno(), before.st_uid, before.st_gid)
    os.fchmod(file.fileno(), stat.S_IMODE(before.st_mode))


def _flush_file(file: IO[bytes], durable: bool) -> None:
    file.flush()
    if durable:
        os.fsync(file.fileno())


def _replace_all(temporaries: Sequence[Path], targets: Sequence[Path]) -> None:
    """Rename all files to their targets, or restore the old ones: never new ones beside old ones."""
    if len(targets) == 1:
        temporaries[0].replace(targets[0])
        return
    with ExitStack() as undo, _alone_in({path.parent for path in targets}):
        kept = [(path, _temporary_path(path, _BEFORE)) for path in targets if is_present(path)]
        # What undoes a step is known before it: Ctrl-C may come between any two.
        for path, before in kept:
            undo.callback(_put_back, before, path)
            path.replace(before)
        for temporary, path in zip(temporaries, targets, strict=True):
            undo.callback(path.unlink, missing_ok=True)
            with failures_named(path):
                temporary.replace(path)
        undo.pop_all()
    _remove([before for _, before in kept])


def _put_back(before: Path, path: Path) -> None:
    """Give a file its name back; it still has it where it was not set aside."""
    with suppress(FileNotFoundError):
        before.replace(path)


class _FolderLocks(threading.local):
    """Folders that a thread has locked; it lets go of all at once.

    Ctrl-C can end a call before that, and what it raised can live on with the call's objects, as in an
    interactive session: the thread's next call would wait for itself for ever if it did not let go first.
    """

    def __init__(self) -> None:
        self._numbers: list[int] = []
        self._process = os.getpid()

    def take(self, folder: Path, how: int) -> None:
        self._numbers.append(os.open(folder, os.O_RDONLY))
        fcntl.flock(self._numbers[-1], how)

    def release(self) -> None:
        process = os.getpid()
        while self._numbers:
            if process == self._process:  # a process forked meanwhile shares the locks, which are not its own
                with suppress(OSError):
                    fcntl.flock(self._numbers[-1], fcntl.LOCK_UN)
            os.close(self._numbers.pop())
        self._process = process


_LOCKS = _FolderLocks()


@contextmanager
def _alone_in(folders: set[Path]) -> Iterator[None]:
    """Let others that replace several files in these folders wait: of each one's files some would be left."""
    _LOCKS.release()
    try:
        for folder in sorted(folders):  # in one order: two that wait for each other would wait for ever
            with suppress(OSError):
                _LOCKS.take(folder, fcntl.LOCK_EX)
        yield
    finally:
        _LOCKS.release()


def _remove(leftovers: Sequence[Path]) -> None:
    """Remove temporary files; what cannot be removed is removed by the next writer."""
    for path in leftovers:
        with suppress(OSError):
            path.unlink()


def _sync_folders(folders: set[Path]) -> None:
    """Synchronise folders, so that the names of files are on the disk too, where the file system can."""
    for folder in folders:
        with suppress(OSError):
            number = os.open(folder, os.O_RDONLY)
            try:
                os.fsync(number)
            finally:
                os.close(number)


@cache
def remove_leftovers(folder: Path) -> None:
    """Remove what killed processes have left in a folder; once for each, which may hold many files."""
    try:
        with suppress(OSError):
            _LOCKS.take(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)  # files set aside have no lock
            for path in folder.iterdir():
                if path.name.startswith((_TEMPORARY, _BEFORE)):
                    _remove_unless_locked(path)
    finally:
        _LOCKS.release()


def _remove_unless_locked(path: Path) -> None:
    with suppress(OSError), path.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        path.unlink()
