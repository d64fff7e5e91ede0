"""Cache of intermediate results in a folder, addressed by a hash of their inputs."""

from __future__ import annotations

import json
from hashlib import blake2b
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.files import failures_named

Arrays = dict[str, NDArray[Any]]

# A file is this line, the digest of its stage, its key and what follows, a JSON line of names, and the arrays
# as NumPy writes them.
_FIRST_LINE = b"sfmcpp cache 2\n"
_DIGEST_BYTES = 20


class Cache:
    """Arrays in a folder, each entry a file that is there complete or not at all.

    Entries of another format, damaged, cut short or renamed count as absent. Nothing is ever removed: the
    folder as a whole may be, at any time.

    Parameters
    ----------
    folder : Path
        Where entries are kept; made when the first one is saved.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def load(self, stage: str, key: str) -> Arrays | None:
        """Look an entry up.

        Parameters
        ----------
        stage : str
            What was computed.
        key : str
            What :func:`cache_key` gives of all that it was computed from.

        Returns
        -------
        dict or None
            The arrays by their names; None if there are none.
        """
        try:
            data = self._file(stage, key).read_bytes()
        except OSError:
            return None
        return _unpacked(data, f"{stage} {key}")

    def save(self, stage: str, key: str, **arrays: NDArray[Any]) -> None:
        """Keep an entry.

        Parameters
        ----------
        stage, key : str
            As for :meth:`load`.
        **arrays : array
            Of numbers or text; no objects.

        Raises
        ------
        DatasetError
            If the folder cannot be written.
        """
        path = self._file(stage, key)
        with failures_named(path.parent):
            path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_files(path, durable=False) as (file,):
            file.write(_packed(arrays, f"{stage} {key}"))

    def _file(self, stage: str, key: str) -> Path:
        return self.folder / stage / key


def cache_key(*parts: Any) -> str:
    """Hash of all that a result was computed from.

    Parameters
    ----------
    *parts : array, or anything whose ``repr`` tells all of it
        Digests of files, settings, versions.

    Returns
    -------
    str
        Equal parts, equal key, in every process.
    """
    total = blake2b(digest_size=_DIGEST_BYTES)
    for part in parts:
        of_array = isinstance(part, np.ndarray)
        description = f"{part.dtype.str} {part.shape}" if of_array else repr(part)
        content = np.ascontiguousarray(part).tobytes() if of_array else b""
        total.update(f"{len(description)} {len(content)} {description}".encode() + content)
    return total.hexdigest()


def _packed(arrays: Arrays, entry: str) -> bytes:
    written = BytesIO()
    written.write(json.dumps(list(arrays)).encode() + b"\n")
    for array in arrays.values():
        np.save(written, np.asarray(array), allow_pickle=False)
    content = written.getvalue()
    return _FIRST_LINE + _digest(entry, content) + content


def _unpacked(data: bytes, entry: str) -> Arrays | None:
    start = len(_FIRST_LINE) + _DIGEST_BYTES
    content = data[start:]
    if data[:start] != _FIRST_LINE + _digest(entry, content):
        return None
    reader = BytesIO(content)
    return {name: np.load(reader, allow_pickle=False) for name in json.loads(reader.readline())}


def _digest(entry: str, content: bytes) -> bytes:
    return blake2b(entry.encode() + b"\n" + content, digest_size=_DIGEST_BYTES).digest()
