"""MATLAB files of version 5 to 7, read without trust: arrays of finite numbers.

SciPy's reader takes tags and sizes as they come, and a file with one wrong byte ends the process. What would
have to be checked before it is called is all that there is to reading a matrix. The layout: a header of 128
bytes, then elements of a tag, the type and the number of bytes, and their content, which is compressed or a
matrix: four elements or more, its flags, its shape, its name and its numbers (MathWorks, MAT-File Format).
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.files import expands_too_far, failures_named, largest_expansion, require_regular_file

_HEADER_BYTES, _TAG_BYTES, _ALIGNMENT = 128, 8, 8
_VERSION, _ENDIAN = slice(124, 126), slice(126, 128)
_ORDERS = {b"IM": "<", b"MI": ">"}
_MOST_DIMENSIONS, _PARTS = 32, 4

_UINT32, _INT32, _INT8, _MATRIX, _COMPRESSED = 6, 5, 1, 14, 15
_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_COMPLEX = 0x0800
_CLASSES = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4", 14: "i8", 15: "u8"}
_OTHER_CLASSES = {1: "a cell array", 2: "a structure", 3: "an object", 4: "text", 5: "a sparse matrix"}


class _Malformed(Exception):
    """Violation of the layout."""


@dataclass(frozen=True)
class _Element:
    """A tag's type and its content."""

    type: int
    content: memoryview

    def numbers(self, order: str) -> NDArray[Any]:
        """All numbers of the content, as stored."""
        if self.type not in _TYPES:
            raise _Malformed(f"numbers of the unknown type {self.type}")
        dtype = np.dtype(order + _TYPES[self.type])
        if len(self.content) % dtype.itemsize:
            raise _Malformed(f"{len(self.content)} bytes are no whole numbers of type {self.type}")
        return np.frombuffer(self.content, dtype)

    def numbers_of(self, type: int, what: str, order: str) -> NDArray[Any]:
        """The numbers, which must be of that type."""
        if self.type != type:
            raise _Malformed(f"{what} of a matrix are of type {self.type}, must be {type}")
        return self.numbers(order)


def read_matrices(
    path: Path, data: bytes, wanted: Callable[[str], bool], limit: int
) -> dict[str, NDArray[Any]]:
    """Arrays of numbers by the names of their variables.

    Parameters
    ----------
    path : Path
        The file, for messages.
    data : bytes
        Its content.
    wanted : callable
        Whether a name is to be read; the others may hold what they like.
    limit : int
        Bytes that compressed variables may expand to, all together.

    Returns
    -------
    dict of str to array
        In their shape and with the type that MATLAB gave them.

    Raises
    ------
    DatasetError
        If the content is no such file, or a wanted variable is no array of real numbers.
    """
    order = _ORDERS.get(data[_ENDIAN])
    if order is None or data[_VERSION] != struct.pack(order + "H", 0x0100):
        raise DatasetError(path, "not a MATLAB file of version 5 to 7")
    matrices = {}
    try:
        for element in _matrices_of(memoryview(data)[_HEADER_BYTES:], order, limit):
            name, parts = _named(element, order)
            if wanted(name):
                matrices[name] = _matrix(name, parts, order)
    except (_Malformed, zlib.error) as error:
        raise DatasetError(path, f"not a valid MATLAB file: {error}") from error
    return matrices


def _matrices_of(data: memoryview, order: str, limit: int) -> Iterator[_Element]:
    """The matrices of a file."""
    for element in _elements(data, order):
        if element.type != _COMPRESSED:
            yield element
            continue
        content = zlib.decompressobj().decompress(
            element.content, limit + 1
        )  # some end before their checksum
        limit -= len(content)
        if limit < 0:
            raise _Malformed(f"its content {expands_too_far(limit + len(content))}")
        yield from _elements(memoryview(content), order)


def _elements(data: memoryview, order: str) -> Iterator[_Element]:
    """The elements that follow one another; a small one has its content within its tag."""
    while data:
        if len(data) < _TAG_BYTES:
            raise _Malformed("it ends within a tag")
        type, size = struct.unpack(order + "II", data[:_TAG_BYTES])
        begin, small = _TAG_BYTES, type >> 16
        if small:
            type, size, begin = type & 0xFFFF, small, _TAG_BYTES // 2
        end = begin + size
        if end > (_TAG_BYTES if small else len(data)):
            raise _Malformed(f"an element claims {size} bytes, it has {len(data) - begin}")
        yield _Element(type, data[begin:end])
        padding = 0 if type == _COMPRESSED else -end % _ALIGNMENT
        data = data[end + padding :]


def _named(element: _Element, order: str) -> tuple[str, list[_Element]]:
    """Name and parts of a matrix: flags, shape, name, numbers."""
    if element.type != _MATRIX:
        raise _Malformed(f"a variable is of type {element.type}, must be a matrix")
    parts = list(islice(_elements(element.content, order), _PARTS + 1))  # a cell array may have millions
    if len(parts) < 3:
        raise _Malformed(f"a variable has {len(parts)} parts, must be 3 at least")
    return parts[2].numbers_of(_INT8, "name", order).tobytes().decode("utf-8", "replace"), parts


def _matrix(name: str, parts: list[_Element], order: str) -> NDArray[Any]:
    flags = parts[0].numbers_of(_UINT32, "flags", order)
    if len(flags) != 2:
        raise _Malformed(f"{name} has {len(flags)} flags, must be 2")
    kind = int(flags[0]) & 0xFF
    if kind not in _CLASSES or flags[0] & _COMPLEX:
        found = "complex" if kind in _CLASSES else _OTHER_CLASSES.get(kind, f"of the unknown class {kind}")
        raise _Malformed(f"{name} is {found}: must be an array of real numbers")
    shape = parts[1].numbers_of(_INT32, "sizes", order).tolist()
    values = parts[-1].numbers(order) if len(parts) == _PARTS else None
    if values is None or not 2 <= len(shape) <= _MOST_DIMENSIONS or not _fits_count(shape, len(values)):
        found = "no numbers" if values is None else f"{len(values)} numbers"
        raise _Malformed(f"{name} of shape {tuple(shape)} has {found}")
    with np.errstate(invalid="ignore"):  # whole numbers may be stored as any type that holds them
        return np.reshape(values.astype(_CLASSES[kind], copy=False), shape, order="F")


def _fits_count(shape: list[int], count: int) -> bool:
    product = 1
    for length in shape:
        product *= length
    return min(shape) >= 0 and product == count


def mat_variables(path: Path, names: Sequence[str]) -> dict[str, NDArray[Any]]:
    """Arrays of numbers of a MATLAB file by name, as they are.

    Raises
    ------
    DatasetError
        If the file cannot be read, is no MATLAB file of version 5 to 7, lacks one of `names`, or holds
        something else under it.
    """
    with failures_named(path):
        require_regular_file(path)
        data = path.read_bytes()
    content = read_matrices(path, data, names.__contains__, largest_expansion(len(data)))
    missing = [name for name in names if name not in content]
    if missing:
        raise DatasetError(path, f"lacks the variables {', '.join(missing)}")
    return content


def number_array(path: Path, name: str, value: Any, dimensions: int, shown: str) -> FloatArray:
    """A variable as float64; a DatasetError, with the wanted shape as `shown`, if it has other dimensions."""
    if value.ndim != dimensions:
        raise DatasetError(path, f"{name} is {value.dtype} {value.shape}: must be numbers, {shown}")
    return np.asarray(value, dtype=np.float64)


def require_finite(path: Path, name: str, array: FloatArray) -> None:
    """Raise a DatasetError at the first element that is not finite."""
    if not np.isfinite(array).all():
        where = np.argwhere(~np.isfinite(array))[0].tolist()
        raise DatasetError(path, f"{name}{where} is {array[tuple(where)]}: must be finite")
