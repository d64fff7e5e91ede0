"""Checkpoint files of long runs: two checksummed files in turn.

A file is an NPZ archive, without pickle: arrays, and ``metadata.npy``, UTF-8 JSON as bytes. The archive's
comment, its last bytes, holds the version of the format and the SHA-256 of all that precedes.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import shutil
import tempfile
import time
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba.checkpoints import Checkpoint, CheckpointStore, Where
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.arguments import checked
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.files import failures_named, is_folder, is_present, read_bytes, require_folder
from sfmcpp.sources.io.npz import METADATA, read_members, write_member

FORMAT_VERSION = 1

_NAMES = ("checkpoint-a.npz", "checkpoint-b.npz")
_RANK = "rank-"
_DIGEST_SIZE = 64
_SEAL = f"sfmcpp checkpoint {FORMAT_VERSION} sha256 ".encode()
_ANY_SEAL = re.compile(rb"sfmcpp checkpoint (\d+) sha256 [0-9a-f]{64}\Z")


class CheckpointFolder:
    """A folder for the checkpoints of one run; it keeps the last two.

    Parameters
    ----------
    path : path-like
        The folder, created if missing; its parent must exist.
    every_s : float
        Seconds between checkpoints; 0: one after each iteration. A run stopped by a limit, Ctrl-C or a
        callback always saves one.

    Raises
    ------
    InvalidArgument
        If `every_s` is negative or no number.
    """

    @checked()
    def __init__(self, path: str | PathLike[str], every_s: float = 60.0) -> None:
        if not every_s >= 0.0:
            raise InvalidArgument(f"every_s = {every_s!r}: must be a number of seconds, not negative")
        self.path = Path(path)
        self._every_s = every_s
        self._last_s = time.monotonic()
        self._failure: DatasetError | None = None
        self._newest = _Slot(number=1, sequence=0)
        self._of_rank: CheckpointFolder | None = None

    def __repr__(self) -> str:
        return f"CheckpointFolder({str(self.path)!r}, every_s={self._every_s})"

    @property
    def failure(self) -> DatasetError | None:
        """The last checkpoint that could not be saved."""
        return self._failure if self._of_rank is None else self._of_rank.failure

    def of_rank(self, rank: int) -> CheckpointFolder:
        """The folder inside it for one of several ranks, which save together.

        Raises
        ------
        DatasetError
            If this folder cannot be made.
        """
        with failures_named(self.path):
            self.path.mkdir(exist_ok=True)
        self._require_none_of_one_process()
        self._of_rank = CheckpointFolder(self.path / f"{_RANK}{rank:04d}", self._every_s)
        return self._of_rank

    def begin(self, resumed: CheckpointStore | None = None, least_bytes: int = 0) -> None:
        """Make the folder, and refuse what can be known to fail.

        Parameters
        ----------
        resumed : CheckpointStore, optional
            Where the run takes up. If it is the same folder, the checkpoint taken up is the last to go.
        least_bytes : int
            Size of a checkpoint, at least [bytes].

        Raises
        ------
        DatasetError
            If the folder cannot be written, has too little room, or holds checkpoints of another run.
        """
        require_folder(self.path)
        self._require_none_of_ranks()
        with failures_named(self.path):
            self.path.mkdir(exist_ok=True)
            with tempfile.TemporaryFile(dir=self.path):
                pass
            free = shutil.disk_usage(self.path).free
        if free < least_bytes:
            raise DatasetError(self.path, f"has room for {free} bytes, a checkpoint takes {least_bytes}")
        goes_on = isinstance(resumed, CheckpointFolder) and resumed.path.samefile(self.path)
        if goes_on:
            assert isinstance(resumed, CheckpointFolder)
            self._newest = resumed._newest
        elif self._files():
            raise DatasetError(
                self.path, "holds the checkpoints of an earlier run: resume it, or remove them"
            )
        self._failure = None
        self._last_s = time.monotonic()

    def is_due(self) -> bool:
        """Whether as many seconds have passed since the last one as are wanted."""
        return time.monotonic() - self._last_s >= self._every_s

    def save(self, facts: Mapping[str, Any], where: Where) -> bool:
        """Replace the older of the two files; on the disk when this returns.

        Parameters
        ----------
        facts : mapping
            What is run, fit for JSON.
        where : callable
            Gives the arrays of where it stands.

        Returns
        -------
        bool
            Whether that was possible; else `failure` says why not.
        """
        slot = self._newest.next()
        path = self.path / _NAMES[slot.number]
        try:
            with atomic_files(path) as (file,):
                file.write(_sealed(path, {"sequence": slot.sequence, "facts": facts}, where()))
            self._newest = slot
        except DatasetError as error:
            self._failure = error
        self._last_s = time.monotonic()
        return self._newest is slot

    def take_back(self, failure: DatasetError) -> None:
        """Let what was saved last be replaced by the next: another rank has failed to save its own."""
        self._newest, self._failure = self._newest.before(), failure

    def load(self, sequence: int | None = None) -> Checkpoint:
        """Read the newer of the two files, or the other if that one is damaged.

        Parameters
        ----------
        sequence : int, optional
            The one to read, whichever is newer.

        Returns
        -------
        Checkpoint
            Where the run stood.

        Raises
        ------
        DatasetError
            If there is none, or none that is whole.
        """
        self._require_none_of_ranks()
        found: list[tuple[_Slot, Checkpoint]] = []
        refused: list[DatasetError] = []
        for number, path in self._files():
            try:
                found.append(_read(path, number))
            except DatasetError as error:
                refused.append(error)
        found = [pair for pair in found if sequence in (None, pair[0].sequence)]
        if not found:
            raise refused[0] if refused else DatasetError(self.path, "holds no checkpoint")
        self._newest, newest = max(found, key=lambda pair: pair[0].sequence)
        remark = "".join(f"{error}; went on from {newest.path}" for error in refused)
        return replace(newest, remark=remark)

    def sequences(self) -> set[int]:
        """Sequence numbers of the checkpoints that are whole."""
        found = set()
        for name in _NAMES:
            with suppress(DatasetError):
                found.add(_read(self.path / name, 0)[0].sequence)
        return found

    def is_empty(self) -> bool:
        """Whether it holds no checkpoint file, of one process or of ranks, or is not there.

        Raises
        ------
        DatasetError
            If the folder cannot be searched.
        """
        with failures_named(self.path):
            return not self._files() and not any(any(self.path.glob(f"{_RANK}*/{name}")) for name in _NAMES)

    def _files(self) -> list[tuple[int, Path]]:
        """The files of this folder that are there, of two, with their numbers."""
        with failures_named(self.path):
            named = enumerate(self.path / name for name in _NAMES)
            return [(number, path) for number, path in named if is_present(path)]

    def _require_none_of_ranks(self) -> None:
        with failures_named(self.path):
            count = len([*self.path.glob(f"{_RANK}*")]) if is_folder(self.path) else 0
        if count:
            raise DatasetError(self.path, f"holds the checkpoints of {count} ranks, this is one process")

    def _require_none_of_one_process(self) -> None:
        if self._files():
            raise DatasetError(self.path, "holds the checkpoints of one process, these are several ranks")


@dataclass(frozen=True)
class _Slot:
    """One of the two files, and the number of the checkpoint in it, counted from the start of the run."""

    number: int
    sequence: int

    def next(self) -> _Slot:
        return _Slot(1 - self.number, self.sequence + 1)

    def before(self) -> _Slot:
        return _Slot(1 - self.number, self.sequence - 1)


def _sealed(path: Path, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> memoryview:
    content = io.BytesIO()
    text = np.frombuffer(json.dumps(header).encode("ascii"), np.uint8)
    with zipfile.ZipFile(content, "w") as archive:
        for name, array in {METADATA: text, **arrays}.items():
            write_member(archive, name, array, path)
        archive.comment = _SEAL + b"0" * _DIGEST_SIZE
    sealed = content.getbuffer()
    sealed[-_DIGEST_SIZE:] = hashlib.sha256(sealed[:-_DIGEST_SIZE]).hexdigest().encode("ascii")
    return sealed


def _read(path: Path, number: int) -> tuple[_Slot, Checkpoint]:
    _require_sealed(path, read_bytes(path))
    arrays = read_members(path)
    try:
        header = json.loads(arrays.pop(METADATA).tobytes())
        checkpoint = Checkpoint(str(path), dict(header["facts"]), arrays, int(header["sequence"]))
        return _Slot(number, checkpoint.sequence), checkpoint
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise DatasetError(path, f"is no checkpoint: metadata ({type(error).__name__}: {error})") from error


def _require_sealed(path: Path, content: bytes) -> None:
    seal = _ANY_SEAL.search(content[-len(_SEAL) - _DIGEST_SIZE - 8 :])
    if seal is None:
        raise DatasetError(path, "is no checkpoint, or is truncated: it does not end in a checksum")
    if int(seal[1]) != FORMAT_VERSION:
        raise DatasetError(
            path, f"is a checkpoint of format {int(seal[1])}, this version reads format {FORMAT_VERSION}"
        )
    digest = hashlib.sha256(memoryview(content)[:-_DIGEST_SIZE]).hexdigest()
    if digest.encode("ascii") != content[-_DIGEST_SIZE:]:
        raise DatasetError(path, "is damaged: its checksum differs")
