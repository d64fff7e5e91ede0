"""Whole files, plain or compressed; the suffix says which."""

from __future__ import annotations

import bz2
import gzip
import lzma
import zlib
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import IO, Protocol, cast

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.failures import failures_named

COMPRESSED_SUFFIXES = (".bz2", ".gz", ".xz")
READABLE_EXPANSION = 1000
ALWAYS_READABLE_BYTES = 64 << 20

_PIECE_BYTES = 4096
_GZIP_HEADER = 16 + zlib.MAX_WBITS
_XZ_MEMORY_BYTES = 256 << 20


class _Decompressor(Protocol):
    @property
    def eof(self) -> bool: ...
    @property
    def unused_data(self) -> bytes: ...
    def decompress(self, data: bytes, /) -> bytes: ...


_DECOMPRESSORS: dict[str, Callable[[], _Decompressor]] = {
    ".bz2": lambda: bz2.BZ2Decompressor(),
    ".gz": lambda: cast(_Decompressor, zlib.decompressobj(_GZIP_HEADER)),
    ".xz": lambda: lzma.LZMADecompressor(memlimit=_XZ_MEMORY_BYTES),
}


def read_bytes(path: Path) -> bytes:
    """Content of a file, decompressed if its suffix is one of `COMPRESSED_SUFFIXES`.

    Raises
    ------
    DatasetError
        If `path` is no regular file, cannot be read, is empty, is not what its suffix says, ends early,
        has anything after the compressed data, or expands more than `READABLE_EXPANSION` times.
    """
    with failures_named(path):
        require_regular_file(path)
        data = path.read_bytes()
        make = _DECOMPRESSORS.get(path.suffix.lower())
        if data and make is not None:
            data = _decompress(path, data, make)
    if not data:
        raise DatasetError(path, "the file is empty")
    return data


def require_regular_file(path: Path) -> None:
    """Refuse what is missing, a directory, or a device or pipe that might never end."""
    if path.is_dir():
        raise DatasetError(path, "is a directory, a file is wanted")
    if path.exists() and not path.is_file():
        raise DatasetError(path, "is not a regular file")


def compressed_writer(raw: IO[bytes], path: Path) -> AbstractContextManager[IO[bytes]]:
    """Open a stream into `raw` that compresses as the suffix of `path` asks; same content, same bytes."""
    suffix = path.suffix.lower()
    if suffix == ".bz2":
        return cast(AbstractContextManager[IO[bytes]], bz2.BZ2File(raw, "wb"))
    if suffix == ".gz":
        return cast(AbstractContextManager[IO[bytes]], gzip.GzipFile("", "wb", fileobj=raw, mtime=0))
    if suffix == ".xz":
        return cast(AbstractContextManager[IO[bytes]], lzma.LZMAFile(raw, "wb"))
    return nullcontext(raw)


def _decompress(path: Path, data: bytes, make: Callable[[], _Decompressor]) -> bytes:
    limit = max(ALWAYS_READABLE_BYTES, READABLE_EXPANSION * len(data))
    chunks: list[bytes] = []
    start = 0
    while start < len(data):
        start = _decompress_stream(path, data, start, make(), chunks, limit)
    return b"".join(chunks)


def _decompress_stream(
    path: Path, data: bytes, start: int, stream: _Decompressor, chunks: list[bytes], limit: int
) -> int:
    """Append one stream's content to `chunks`, in pieces so that no bomb goes off; return where it ends."""
    kind, begin, size = path.suffix.lower(), start, sum(map(len, chunks))
    while not stream.eof:
        if start >= len(data):
            raise DatasetError(path, f"truncated: the {kind} data end before their end mark")
        chunks.append(_next_piece(path, stream, data[start : start + _PIECE_BYTES], begin))
        start += min(_PIECE_BYTES, len(data) - start)
        size += len(chunks[-1])
        if size > limit:
            raise DatasetError(path, f"expands to more than {limit} bytes: refused")
    return start - len(stream.unused_data)


def _next_piece(path: Path, stream: _Decompressor, piece: bytes, begin: int) -> bytes:
    try:
        return stream.decompress(piece)
    except (OSError, EOFError, ValueError, zlib.error, lzma.LZMAError) as error:
        kind = path.suffix.lower()
        if begin:
            reason = f"garbage after the {kind} data, at byte {begin}"
        else:
            reason = f"not valid {kind} data ({error})"
        raise DatasetError(path, reason) from error
