"""Reading and writing of whole files, plain or compressed, with limits of memory.

Whatever goes wrong with a file becomes a DatasetError.
"""

from __future__ import annotations

import bz2
import codecs
import errno
import gzip
import io
import lzma
import os
import stat
import tempfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path
from typing import IO, Protocol, cast

from sfmcpp.errors import DatasetError, InvalidArgument

COMPRESSED_SUFFIXES = (".bz2", ".gz", ".xz")

BLANKS = b" \t\n\r\v\f"

_COMPRESSED_BYTES = 4096
_GZIP_HEADER = 16 + zlib.MAX_WBITS
_XZ_MEMORY_BYTES = 256 << 20
MAX_EXPANDED, MAX_IMAGE = "SFMCPP_MAX_EXPANDED_MB", "SFMCPP_MAX_IMAGE_MPX"
# Tracks of a drive, mostly "not seen", shrink to an 86th; text shrinks to a tenth at best.
_EXPANSION = 100
_ALWAYS_READABLE_BYTES, _MOST_EXPANDED_BYTES = 64 << 20, 2 << 30
_MOST_DIGITS = 18
_MOST_PIXELS = 160_000_000  # the largest sensors have 150 million


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


@contextmanager
def failures_named(path: Path) -> Iterator[None]:
    """Turn failures of the operating system inside the block into a DatasetError that names `path`."""
    if "\0" in str(path):  # as C ends a text
        raise DatasetError(path, "a path cannot hold a NUL")
    try:
        yield
    except OSError as error:
        raise DatasetError(path, (error.strerror or str(error)).lower()) from error
    except MemoryError as error:
        raise DatasetError(path, "does not fit in memory") from error
    except UnicodeEncodeError as error:  # a name that is no text
        unfit = error.object[error.start : error.end]
        raise DatasetError(path, f"{unfit!a} cannot be written as UTF-8: {error.reason}") from error


def read_bytes(path: Path, *, may_be_empty: bool = False) -> bytes:
    """Content of a file, decompressed if its suffix is one of `COMPRESSED_SUFFIXES`.

    Raises
    ------
    DatasetError
        If `path` is no regular file, cannot be read, is empty though it may not be, is not what its suffix
        says, ends early, has anything after the compressed data, or expands further than `largest_expansion`
        allows.
    """
    data = b"".join(content_chunks(path))
    if not (data or may_be_empty):
        raise DatasetError(path, "the file is empty")
    return data


def read_text_bytes(path: Path, *, may_be_empty: bool = False) -> bytes:
    """Content of a text file as of :func:`read_bytes`, without a byte order mark.

    Lines that end with CR alone end with LF: all would be one line, which a comment makes an empty text.

    Raises
    ------
    DatasetError
        As :func:`read_bytes`, and for UTF-16.
    """
    data = without_byte_order_mark(path, read_bytes(path, may_be_empty=may_be_empty))
    return data if b"\n" in data else data.replace(b"\r", b"\n")


def without_byte_order_mark(path: Path, data: bytes) -> bytes:
    """A text, or its beginning, without the mark; a DatasetError for UTF-16."""
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise DatasetError(path, "is text in UTF-16: must be UTF-8")
    return data.removeprefix(codecs.BOM_UTF8)


def read_own_bytes(path: Path, rank: int, ranks: int) -> bytes:
    """One of so many shares of a plain file, cut behind white space: together they are the file."""
    with failures_named(path):
        require_regular_file(path)
        size = path.stat().st_size
        with path.open("rb") as file:
            begin, end = (_next_boundary(file, size, size * r // ranks) for r in (rank, rank + 1))
            file.seek(begin)
            share = file.read(end - begin)
    return share if begin else without_byte_order_mark(path, share)


def _next_boundary(file: IO[bytes], size: int, place: int) -> int:
    """The first place from `place` on that is behind white space, or either end."""
    if place == 0:
        return 0
    file.seek(place - 1)
    while chunk := file.read(_COMPRESSED_BYTES):
        blanks = [found for blank in BLANKS if (found := chunk.find(blank)) >= 0]
        if blanks:
            return file.tell() - len(chunk) + min(blanks) + 1
    return size


@contextmanager
def open_content(path: Path) -> Iterator[IO[bytes]]:
    """Content as of :func:`read_bytes`, as a seekable stream; a plain file is not read in advance."""
    with failures_named(path), ExitStack() as stack:
        require_regular_file(path)
        yield stack.enter_context(path.open("rb") if is_plain(path) else io.BytesIO(read_bytes(path)))


def is_plain(path: Path) -> bool:
    """Whether a file is read as it is, and has a size: what the system makes up as it is read has none."""
    return path.suffix.lower() not in COMPRESSED_SUFFIXES and path.stat().st_size > 0


def largest_content(path: Path) -> int:
    """No fewer bytes than :func:`read_bytes` gives."""
    with failures_named(path):
        size = path.stat().st_size
    return largest_expansion(size) if path.suffix.lower() in _DECOMPRESSORS else size


def is_present(path: Path) -> bool:
    """Whether there is something. An OSError if that is not told, as in a closed folder; so the next ones.

    Path.exists and the like have given False there since Python 3.14: what is closed would be missing.
    """
    return _mode(path) is not None


def require_present(path: Path) -> None:
    """Raise a DatasetError where there is nothing; OSErrors as :func:`is_present`."""
    if not is_present(path):
        raise DatasetError(path, "no such file or directory")


def is_folder(path: Path) -> bool:
    """Whether it is a folder, or a link to one."""
    mode = _mode(path)
    return mode is not None and stat.S_ISDIR(mode)


def is_regular_file(path: Path) -> bool:
    """Whether it is a regular file, or a link to one."""
    mode = _mode(path)
    return mode is not None and stat.S_ISREG(mode)


def _mode(path: Path) -> int | None:
    try:
        return path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError, ValueError):  # the last of a NUL
        return None
    except OSError as error:
        if error.errno == errno.ELOOP:
            return None
        raise


def require_regular_file(path: Path) -> None:
    """Refuse a directory, a device or pipe that might never end, and names that no file can have."""
    with failures_named(path):
        try:
            mode = path.stat().st_mode
        except FileNotFoundError:
            return
    if stat.S_ISDIR(mode):
        raise DatasetError(path, "is a directory, a file is wanted")
    if not stat.S_ISREG(mode):
        raise DatasetError(path, "is not a regular file")


def require_replaceable(path: Path) -> None:
    """Refuse a target as :func:`require_regular_file`, and one that is there and must not be written.

    A file that is replaced is not opened: nothing else would heed what its permissions protect. The name that
    elsewhere means the output is refused, too.
    """
    _refuse_standard_output(path, "a file is wanted")
    require_regular_file(path)
    with failures_named(path):
        is_protected = is_present(path) and not os.access(path, os.W_OK)
    if is_protected:
        raise DatasetError(path, "permission denied: the file that is there is read-only")


def _refuse_standard_output(path: Path, wanted: str) -> None:
    if path == Path("-"):
        raise DatasetError(path, f"nothing is written to the standard output, {wanted}")


def require_folder(path: Path, purpose: str = "") -> None:
    """Refuse what cannot become a folder of results: a file, and the name that elsewhere means the output."""
    wanted = f"a folder is wanted{purpose}"
    _refuse_standard_output(path, wanted)
    with failures_named(path):
        is_file = is_present(path) and not is_folder(path)
    if is_file:
        raise DatasetError(path, f"is a file, {wanted}")


def require_parent_folder(path: Path) -> None:
    """Refuse a target in a folder that is not there."""
    with failures_named(path):
        is_there = is_folder(path.parent)
    if not is_there:
        raise DatasetError(path, f"the folder {str(path.parent)!r} does not exist")


def scratch_folder_beside(path: Path) -> tempfile.TemporaryDirectory[str]:
    """A hidden folder beside a target, which goes at the end: what lies in it can take the target's name."""
    with failures_named(path):
        return tempfile.TemporaryDirectory(prefix=".sfmcpp-", dir=path.parent)


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


def content_chunks(path: Path) -> Iterator[bytes]:
    """Content of a file as of :func:`read_bytes`, in chunks of any size."""
    with failures_named(path):
        require_regular_file(path)
        make = _DECOMPRESSORS.get(path.suffix.lower())
        if make is not None:
            yield from _decompressed(path, path.read_bytes(), make)
        else:
            yield path.read_bytes()


def _decompressed(path: Path, data: bytes, make: Callable[[], _Decompressor]) -> Iterator[bytes]:
    """All streams of `data`, in pieces so that no bomb goes off."""
    kind, limit, start, size = path.suffix.lower(), largest_expansion(len(data)), 0, 0
    while start < len(data):
        stream, begin = make(), start
        while not stream.eof:
            if start >= len(data):
                raise DatasetError(path, f"truncated: the {kind} data end before their end mark")
            chunk = _next_piece(path, stream, data[start : start + _COMPRESSED_BYTES], begin)
            start += min(_COMPRESSED_BYTES, len(data) - start)
            size += len(chunk)
            if size > limit:
                raise DatasetError(path, expands_too_far(limit))
            yield chunk
        start -= len(stream.unused_data)


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


def largest_expansion(size: int) -> int:
    """Bytes that `size` compressed bytes may expand to.

    They are 100 times as many, but 64 MB at least and 2 GB at most; or what `MAX_EXPANDED` says, in MB.

    Raises
    ------
    InvalidArgument
        If the variable is no positive whole number.
    """
    asked = _limit_from_environment(MAX_EXPANDED)
    if asked is not None:
        return asked << 20
    return min(_MOST_EXPANDED_BYTES, max(_ALWAYS_READABLE_BYTES, _EXPANSION * size))


def expands_too_far(limit: int) -> str:
    """Why compressed data are refused."""
    return f"expands to more than {limit} bytes: refused; {MAX_EXPANDED} allows more"


def largest_image() -> int:
    """Pixels that an image may have: 160 million, or what `MAX_IMAGE` says, in millions."""
    asked = _limit_from_environment(MAX_IMAGE)
    return _MOST_PIXELS if asked is None else asked * 1_000_000


def _limit_from_environment(variable: str) -> int | None:
    text = os.environ.get(variable, "")
    if not text:
        return None
    if not text.isdecimal() or len(text) > _MOST_DIGITS or int(text) < 1:
        shown = text if len(text) <= _MOST_DIGITS else f"{text[:_MOST_DIGITS]}…"
        raise InvalidArgument(f"{variable} = {shown!r}: must be a positive whole number")
    return int(text)
