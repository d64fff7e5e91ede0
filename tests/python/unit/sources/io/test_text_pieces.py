"""Texts in pieces: nothing lost at their ends, in memory that is used again."""

from __future__ import annotations

import bz2
from pathlib import Path

import numpy as np
import pytest

from sfmcpp import _core
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.sources.io import text_pieces
from sfmcpp.sources.io.text_pieces import read_pieces


def test_memory_of_a_text_is_that_of_the_text_before() -> None:
    memory = _core.text_memory(1 << 20)
    memory[:] = 7
    place = memory.ctypes.data
    del memory
    assert _core.text_memory(1 << 20).ctypes.data == place
    with pytest.raises(InvalidArgument, match=r"bytes = -1: must be at least 0"):
        _core.text_memory(-1)


@pytest.mark.parametrize("suffix", ["", ".bz2"])
@pytest.mark.parametrize("room", [1, 5, 16, 1000])
def test_pieces_end_behind_a_blank_and_are_the_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int, suffix: str
) -> None:
    text = b"1 22\n 333 4444 " + b"5" * 70 + b" 6\n7"
    path = tmp_path / f"x.txt{suffix}"
    path.write_bytes(bz2.compress(text) if suffix else text)
    monkeypatch.setattr(text_pieces, "_PIECE_BYTES", room)
    monkeypatch.setattr(text_pieces, "_CHUNK_BYTES", 4)
    pieces = [piece.tobytes() for piece in read_pieces(path)]
    assert b"".join(pieces) == text
    assert all(piece[-1:].isspace() for piece in pieces[:-1])
    assert suffix or room > 5 or len(pieces) > 3


def test_a_byte_order_mark_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "x.txt"
    path.write_bytes(b"\xef\xbb\xbf1 2")
    assert [piece.tobytes() for piece in read_pieces(path)] == [b"1 2"]
    path.write_bytes("1 2".encode("utf-16"))
    with pytest.raises(DatasetError, match="UTF-16"):
        list(read_pieces(path))


def test_numbers_are_read_from_bytes_and_views_of_them_alike() -> None:
    text = b"1 2\n3 x"
    for data in (text, memoryview(text), np.frombuffer(text, np.uint8).data):
        assert _core.read_numbers(data)[1] == 6
    for no_text in (np.zeros(3).data, memoryview(text)[::2], np.zeros((2, 2), np.uint8).data):
        with pytest.raises(InvalidArgument, match="text: must be bytes one after another"):
            _core.read_numbers(no_text)
