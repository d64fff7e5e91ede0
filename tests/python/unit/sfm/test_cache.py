"""What is kept comes back bit by bit; what is damaged counts as not there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sfm.cache import Cache, cache_key

ARRAYS = {
    "numbers": np.array([[1.5, np.nan], [-0.0, np.inf]]),
    "bytes": np.arange(6, dtype=np.uint8).reshape(2, 3),
    "none": np.empty((0, 128), np.uint8),
    "text": np.array("rotation"),
    "flags": np.array([True, False]),
}


def only_file(folder: Path) -> Path:
    (file,) = (path for path in folder.rglob("*") if path.is_file())
    return file


def test_arrays_come_back_as_they_were(tmp_path: Path) -> None:
    Cache(tmp_path / "new").save("features", "k", **ARRAYS)
    found = Cache(tmp_path / "new").load("features", "k")
    assert found is not None
    assert list(found) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert (found[name].dtype, found[name].shape) == (array.dtype, array.shape)
        assert found[name].tobytes() == array.tobytes()


def test_what_was_not_saved_is_absent(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    assert cache.load("features", "k") is None
    cache.save("features", "k", **ARRAYS)
    assert cache.load("features", "other") is None
    assert cache.load("matches", "k") is None


def test_a_damaged_entry_counts_as_absent_and_can_be_saved_again(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    cache.save("features", "k", **ARRAYS)
    file = only_file(tmp_path)
    data = file.read_bytes()
    damaged = [data[:length] for length in range(0, len(data), 7)] + [data + b"x"]
    damaged += [data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :] for at in range(0, len(data), 11)]
    for content in damaged:
        file.write_bytes(content)
        assert cache.load("features", "k") is None
    cache.save("features", "k", **ARRAYS)
    assert only_file(tmp_path).read_bytes() == data


def test_an_entry_under_the_name_of_another_counts_as_absent(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    cache.save("features", "k", **ARRAYS)
    only_file(tmp_path).rename(tmp_path / "features" / "other")
    assert cache.load("features", "other") is None


def test_an_entry_is_never_there_in_part(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    with pytest.raises(ValueError, match="allow_pickle"):
        cache.save("features", "k", good=np.ones(3), objects=np.array([object()]))
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(DatasetError, match="file"):
        Cache(tmp_path / "file").save("features", "k", **ARRAYS)


@dataclass(frozen=True)
class Settings:
    size: int = 3


def test_keys_differ_where_any_part_differs() -> None:
    same = lambda: cache_key("a", 1, Settings(), np.array([1.0, 2.0]), None)  # noqa: E731
    assert same() == same()
    parts = [
        ("a", 1, Settings(), np.array([1.0, 2.0]), None),
        ("b", 1, Settings(), np.array([1.0, 2.0]), None),
        ("a", "1", Settings(), np.array([1.0, 2.0]), None),
        ("a", 1, Settings(4), np.array([1.0, 2.0]), None),
        ("a", 1, Settings(), np.array([1.0, 2.5]), None),
        ("a", 1, Settings(), np.array([[1.0], [2.0]]), None),
        ("a", 1, Settings(), np.array([1.0, 2.0], np.float32), None),
        ("a", 1, Settings(), np.array([1.0, 2.0])),
        ("ab", 1), ("a", "b1"), ("a1", 1), ("a", 11), (("a", 1), 1),
    ]  # fmt: skip
    assert len({cache_key(*some) for some in parts}) == len(parts)
