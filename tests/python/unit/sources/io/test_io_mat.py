"""MATLAB files: what SciPy writes reads back, and nothing that a file claims is believed."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import eye

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.sources.io.files import MAX_EXPANDED
from sfmcpp.sources.io.mat_files import mat_variables, read_matrices

TAGS_BYTES = 200  # the header and the tags of the first matrix


def written(folder: Path, *, compressed: bool = False, **variables: Any) -> Path:
    path = folder / "file.mat"
    savemat(path, variables, do_compression=compressed)
    return path


def refusal(path: Path, name: str = "a") -> str:
    with pytest.raises(DatasetError) as caught:
        mat_variables(path, [name])
    return str(caught.value)


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("dtype", ["f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8"])
def test_what_scipy_writes_reads_back(tmp_path: Path, compressed: bool, dtype: str) -> None:
    array = np.arange(24).reshape(2, 3, 4).astype(dtype)
    path = written(
        tmp_path, compressed=compressed, other="text", cells=np.array([[1], ["b"]], object), a=array
    )
    found = mat_variables(path, ["a"])["a"]
    assert found.dtype == array.dtype
    np.testing.assert_array_equal(found, array)


def test_other_byte_orders_and_small_elements_are_read(tmp_path: Path) -> None:
    path = written(tmp_path, a=np.array([[7]], np.int8))
    np.testing.assert_array_equal(mat_variables(path, ["a"])["a"], [[7]])
    tag = (14).to_bytes(4, "big"), (56).to_bytes(4, "big")
    flags = b"".join(n.to_bytes(4, "big") for n in (6, 8, 6, 0))
    shape = b"".join(n.to_bytes(4, "big") for n in (5, 8, 1, 1))
    name, number = b"\0\1\0\1a\0\0\0", b"".join(n.to_bytes(4, "big") for n in (9, 8))
    matrix = flags + shape + name + number + np.array(2.5, ">f8").tobytes()
    path.write_bytes(b" " * 124 + b"\1\0MI" + b"".join(tag) + matrix)
    np.testing.assert_array_equal(mat_variables(path, ["a"])["a"], [[2.5]])


@pytest.mark.parametrize(
    ("value", "what"),
    [
        (eye(3, format="csc"), "a sparse matrix"),
        (np.array([[1 + 2j]]), "complex"),
        ("text", "text"),
        ({"field": 1}, "a structure"),
        (np.array([[1], ["b"]], object), "a cell array"),
    ],
)
def test_what_holds_no_real_numbers_is_named(tmp_path: Path, value: Any, what: str) -> None:
    assert f"a is {what}: must be an array of real numbers" in refusal(written(tmp_path, a=value))


@pytest.mark.parametrize("compressed", [False, True])
def test_no_mutant_ends_in_anything_but_an_error_of_the_file(compressed: bool) -> None:
    stream, rng = BytesIO(), np.random.default_rng(0)
    savemat(stream, {"a": rng.random((30, 6))}, do_compression=compressed)
    refused = 0
    for _ in range(2000):
        mutant = np.frombuffer(stream.getvalue(), np.uint8).copy()
        where = rng.integers(0, TAGS_BYTES, rng.integers(1, 4))
        mutant[where] = rng.integers(0, 256, len(where))
        end = len(mutant) if rng.random() < 0.9 else rng.integers(len(mutant))
        try:
            read_matrices(Path("mutant.mat"), mutant.tobytes()[:end], lambda name: name == "a", 1 << 20)
        except DatasetError:
            refused += 1
    assert refused > 400


def test_variables_that_expand_too_far_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = written(tmp_path, compressed=True, a=np.zeros((1200, 1000)))
    assert mat_variables(path, ["a"])["a"].shape == (1200, 1000)
    monkeypatch.setenv(MAX_EXPANDED, "9")
    assert f"{MAX_EXPANDED} allows more" in refusal(path)


def test_a_limit_that_is_no_number_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(MAX_EXPANDED, "much")
    with pytest.raises(InvalidArgument, match=f"{MAX_EXPANDED} = 'much'"):
        mat_variables(written(tmp_path, a=np.ones((2, 2))), ["a"])


def test_other_versions_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "file.mat"
    savemat(path, {"a": np.ones((2, 2))}, format="4")
    assert "not a MATLAB file of version 5 to 7" in refusal(path)
