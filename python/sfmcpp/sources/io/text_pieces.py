"""Texts of any size in pieces, in memory that a solve finds again."""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sfmcpp import _core
from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.files import (
    BLANKS,
    content_chunks,
    failures_named,
    is_plain,
    require_regular_file,
    without_byte_order_mark,
)

ByteArray = NDArray[np.uint8]

_PIECE_BYTES, _CHUNK_BYTES = 16 << 20, 1 << 20


def read_pieces(path: Path) -> Iterator[ByteArray]:
    """Content as of :func:`read_text_bytes` in pieces of some megabytes, all but the last end with a blank.

    A piece is (n,) uint8, in memory whose pages the next solve finds again.

    Raises
    ------
    DatasetError
        As :func:`read_text_bytes`, but not before the fault is reached.
    """
    require_regular_file(path)
    is_empty = True
    with failures_named(path):
        for piece in _plain_pieces(path) if is_plain(path) else _gathered_pieces(path):
            yield _behind_byte_order_mark(path, piece) if is_empty else piece
            is_empty = False
    if is_empty:
        raise DatasetError(path, "the file is empty")


def _plain_pieces(path: Path) -> Iterator[ByteArray]:
    begin, size, room = 0, path.stat().st_size, _PIECE_BYTES
    with path.open("rb") as file:
        while begin < size:
            memory = _core.text_memory(min(size - begin, room))
            piece = memory[: file.readinto(memory.data)]
            is_last = begin + len(piece) >= size or len(piece) < len(memory)
            end = len(piece) if is_last else _behind_last_blank(piece)
            if end:
                yield piece[:end]
            if is_last:
                return
            begin = file.seek(begin + end)
            room = _PIECE_BYTES if end else 2 * room  # for a word that is longer


def _gathered_pieces(path: Path) -> Iterator[ByteArray]:
    """Of content that comes in chunks."""
    waiting, size = [], 0
    for chunk in (np.frombuffer(chunk, np.uint8) for chunk in content_chunks(path) if chunk):
        waiting.append(chunk)
        size += len(chunk)
        if size >= _PIECE_BYTES and (end := _behind_last_blank(chunk)):
            yield _joined([*waiting[:-1], chunk[:end]])
            waiting, size = [chunk[end:]], len(chunk) - end
    if waiting:
        yield _joined(waiting)


def _joined(parts: list[ByteArray]) -> ByteArray:
    memory: ByteArray = _core.text_memory(sum(map(len, parts)))
    return np.concatenate(parts, out=memory)


def _behind_byte_order_mark(path: Path, piece: ByteArray) -> ByteArray:
    head = piece[: len(codecs.BOM_UTF8)].tobytes()
    return piece[len(head) - len(without_byte_order_mark(path, head)) :]


def _behind_last_blank(piece: ByteArray) -> int:
    """Where the last word begins, or 0 if it is longer than a chunk."""
    tail = piece[-_CHUNK_BYTES:].tobytes()
    place = max(map(tail.rfind, BLANKS)) + 1
    return len(piece) - len(tail) + place if place else 0
