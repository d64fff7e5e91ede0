"""NPZ: every array of the problem and its metadata, without pickle; the only format that loses nothing.

A zip archive of ``.npy`` members. ``metadata.npy`` is UTF-8 JSON as bytes; arrays in ``metadata.extra``
have members of their own, ``extra.NAME.npy``.
"""

from __future__ import annotations

import ast
import io
import json
import math
import struct
import zipfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba.parts import COLORS, OBSERVATION_ROWS, POINT_ROWS
from sfmcpp.ba.ranks import Ranks
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Metadata, Problem, Rigs
from sfmcpp.model.process_state import without_warnings
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import require_image_sizes, require_metadata_length, require_valid
from sfmcpp.sources.io.files import expands_too_far, largest_expansion, open_content
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.shares import Share

VERSION = 1

_ZIP_MAGIC = b"PK"
_PIECE_BYTES = 1 << 20
_OLDEST_ZIP_DATE = (1980, 1, 1, 0, 0, 0)
METADATA, _EXTRA, _RIGS = "metadata", "extra.", "rigs."
_NOT_ARRAYS = ("camera_model", METADATA, "rigs")
_ARRAYS = tuple(f.name for f in fields(Problem) if f.name not in _NOT_ARRAYS)
_RIG_ARRAYS = tuple(f.name for f in fields(Rigs))
_NEEDED_OF_RIGS = tuple(f.name for f in fields(Rigs) if f.default is MISSING)
_OPTIONAL = ("sigma_px", "covariance_px2")
_LOCAL_LENGTHS = 26  # where the local header of a zip archive's member tells how long its name is
_METADATA_ARRAYS: dict[str, np.dtype[Any]] = {
    "image_sizes": np.dtype(np.int64),
    "point_colors": np.dtype(np.uint8),
}
# Types of what has a row for each point or each observation.
_ROWS: dict[str, np.dtype[Any]] = {name: np.dtype(np.float64) for name in (*POINT_ROWS, *OBSERVATION_ROWS)}
_ROWS |= {"fixed_points": np.dtype(np.bool_), COLORS: _METADATA_ARRAYS[COLORS]}
_ROWS |= {"camera_index": np.dtype(np.int32), "point_index": np.dtype(np.int32)}


def read_npz(path: Path) -> Problem:
    """Read a problem that :func:`write_npz` has written.

    Raises
    ------
    DatasetError
        If the file is no such archive, an array is missing or has a wrong shape, or a value is impossible.
    """
    return problem_of_members(path, read_members(path))


def read_npz_share(path: Path, ranks: Ranks) -> Share | None:
    """Read all cameras of such a file, and as many of its points and observations as is a rank's turn.

    The rest is not read, so that the checksums of these members are not compared.

    Returns
    -------
    Share or None
        None if rows cannot be picked from the file: a member is compressed (as by ``np.savez_compressed``),
        stored by columns, or not of a problem's types and lengths.
    """
    with open_content(path) as file, zipfile.ZipFile(file) as archive:
        infos = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        if len(infos) < len(archive.infolist()) or any(
            info.compress_type != zipfile.ZIP_STORED for info in infos.values()
        ):
            return None
        members = {name: _array(archive, info) for name, info in infos.items() if name not in _ROWS}
        stored = {name: _StoredRows.of(file, info) for name, info in infos.items() if name in _ROWS}
        if not all(rows.are_like(stored, name) for name, rows in stored.items()):
            return None
        count = stored["points"].shape[0]
        begins = [ranks.turn(stored[name].shape[0])[0] for name in ("points", "pixels")]
        for name, rows in stored.items():
            members[name] = rows.read(file, *ranks.turn(rows.shape[0]))
    return Share.of(_problem_of_arrays(path, members), count, *begins)


@dataclass(frozen=True)
class _StoredRows:
    """An array of an archive that is not compressed: where it begins, and what it is."""

    begin: int
    shape: tuple[int, ...]
    by_columns: bool
    dtype: np.dtype[Any]

    @classmethod
    def of(cls, file: IO[bytes], info: zipfile.ZipInfo) -> _StoredRows:
        """Find it behind the local header of its member, whose lengths may differ from the central one's."""
        file.seek(info.header_offset + _LOCAL_LENGTHS)
        file.seek(sum(struct.unpack("<HH", file.read(4))), io.SEEK_CUR)
        shape, by_columns, dtype = _read_npy_header(file)
        return cls(file.tell(), shape, by_columns, dtype)

    def are_like(self, others: dict[str, _StoredRows], name: str) -> bool:
        """Whether they have the type of rows of that name, and are as many as others of their kind."""
        first = others["points" if name in POINT_ROWS else "pixels"]
        return not self.by_columns and self.dtype == _ROWS[name] and self.shape[:1] == first.shape[:1]

    def read(self, file: IO[bytes], begin: int, end: int) -> NDArray[Any]:
        """Rows from `begin` to `end`."""
        row = self.dtype.itemsize * math.prod(self.shape[1:])
        file.seek(self.begin + begin * row)
        return np.frombuffer(file.read((end - begin) * row), self.dtype).reshape(-1, *self.shape[1:])


def problem_of_members(path: Path, members: dict[str, NDArray[Any]]) -> Problem:
    """The problem that :func:`members_of_problem` has made arrays of, or a DatasetError that names `path`."""
    problem = _problem_of_arrays(path, members)
    _require_consistent(problem, path)
    return problem


def _problem_of_arrays(path: Path, members: dict[str, NDArray[Any]]) -> Problem:
    missing = [name for name in (*_ARRAYS, METADATA) if name not in members and name not in _OPTIONAL]
    if missing:
        raise DatasetError(path, f"is no sfmcpp problem: it lacks {', '.join(missing)}")
    header = _json(path, members.pop(METADATA))
    metadata = _metadata(header, members)
    arrays = {name: members.get(name) for name in _ARRAYS}
    try:
        rigs = _rigs(path, members)
        return Problem(header["camera_model"], metadata=metadata, rigs=rigs, **arrays)  # type: ignore[arg-type]
    except InvalidArgument as error:
        raise DatasetError(path, str(error)) from error


def _rigs(path: Path, members: Mapping[str, NDArray[Any]]) -> Rigs | None:
    found = {name: members[_RIGS + name] for name in _RIG_ARRAYS if _RIGS + name in members}
    if missing := found and ", ".join(_RIGS + name for name in _NEEDED_OF_RIGS if name not in found):
        raise DatasetError(path, f"its rigs lack {missing}")
    return Rigs(**found) if found else None


def write_npz(problem: Problem, path: Path) -> None:
    """Write everything in `problem`: the same problem always gives the same bytes.

    Raises
    ------
    DatasetError
        If a value is impossible, something in ``metadata.extra`` is neither an array of numbers nor fit
        for JSON, or the file cannot be written.
    """
    write_members(members_of_problem(problem, path), path)


def members_of_problem(problem: Problem, path: Path) -> dict[str, NDArray[Any]]:
    """Arrays by name that are the problem, or a DatasetError that names `path`."""
    _require_consistent(problem, path)
    extra = problem.metadata.extra
    arrays: dict[str, Any] = {name: getattr(problem, name) for name in _ARRAYS}
    arrays |= {_RIGS + name: getattr(problem.rigs, name, None) for name in _RIG_ARRAYS}
    arrays |= {name: getattr(problem.metadata, name) for name in _METADATA_ARRAYS}
    arrays |= {_EXTRA + key: value for key, value in extra.items() if isinstance(value, np.ndarray)}
    arrays[METADATA] = _header(problem, path)
    return {name: array for name, array in arrays.items() if array is not None}


def write_members(arrays: Mapping[str, NDArray[Any]], path: Path) -> None:
    """Write arrays as an archive: the same arrays always give the same bytes."""
    with atomic_files(path) as (stream,), zipfile.ZipFile(stream, "w") as archive:
        for name, array in arrays.items():
            write_member(archive, name, array, path)


def _header(problem: Problem, path: Path) -> NDArray[np.uint8]:
    metadata = problem.metadata
    header = {
        "sfmcpp_problem": VERSION,
        "camera_model": problem.camera_model,
        "source_format": metadata.source_format,
        "image_names": list(metadata.image_names),
        "extra": {k: v for k, v in metadata.extra.items() if not isinstance(v, np.ndarray)},
    }
    try:
        text = json.dumps(header, allow_nan=False, sort_keys=True)
    except (TypeError, ValueError, RecursionError) as error:
        raise DatasetError(path, f"metadata cannot be written as JSON: {error}") from error
    return np.frombuffer(text.encode("ascii"), np.uint8)


def write_member(archive: zipfile.ZipFile, name: str, array: NDArray[Any], path: Path) -> None:
    """Add an array to an archive that becomes `path`: the same array always gives the same bytes."""
    if array.dtype.hasobject:
        raise DatasetError(path, f"metadata {name!r} is an array of objects: must be of numbers")
    info = zipfile.ZipInfo(f"{name}.npy", _OLDEST_ZIP_DATE)
    with archive.open(info, "w", force_zip64=True) as member:
        np.lib.format.write_array(member, np.asarray(array), version=None, allow_pickle=False)


def read_members(path: Path) -> dict[str, NDArray[Any]]:
    """All arrays of an archive by name; none holds objects.

    Raises
    ------
    DatasetError
        If the file is no such archive: zip and npy parsers fail in many ways, all of which mean a bad file.
    """
    with open_content(path) as file:
        size = file.seek(0, io.SEEK_END)
        limit = largest_expansion(size)
        file.seek(0)
        if file.read(len(_ZIP_MAGIC)) != _ZIP_MAGIC:
            raise DatasetError(path, "wrong magic: an .npz file is a zip archive and starts with 'PK'")
        try:
            with zipfile.ZipFile(file) as archive:
                _require_plausible_sizes(path, archive, size, limit)
                _require_each_once(path, archive)
                return {
                    info.filename.removesuffix(".npy"): _array(archive, info) for info in archive.infolist()
                }
        except DatasetError:
            raise
        except Exception as error:
            reason = f"not a valid .npz archive ({type(error).__name__}: {error})".splitlines()[0]
            raise DatasetError(path, reason) from error


def _require_plausible_sizes(path: Path, archive: zipfile.ZipFile, size: int, limit: int) -> None:
    stored = sum(info.file_size for info in archive.infolist() if info.compress_type == zipfile.ZIP_STORED)
    compressed = sum(info.file_size for info in archive.infolist()) - stored
    if stored > size:
        raise DatasetError(path, f"its members claim {stored} bytes, it has {size}: refused")
    if compressed > limit:
        raise DatasetError(path, expands_too_far(limit))


def _require_each_once(path: Path, archive: zipfile.ZipFile) -> None:
    """Refuse two members of one name: which of them counts would depend on the reader."""
    counts = Counter(info.filename.removesuffix(".npy") for info in archive.infolist())
    for name, count in counts.most_common(1):
        if count > 1:
            raise DatasetError(path, f"has {count} members called {name!r}: each must be there once")


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    """One member; its size is compared with what its header promises before anything is allocated."""
    with archive.open(info) as member:
        shape, fortran, dtype = _read_npy_header(member)
        present, count = info.file_size - member.tell(), 1
        for length in shape:
            count *= length
        if dtype.hasobject or min(shape, default=0) < 0 or present != count * dtype.itemsize:
            raise ValueError(f"{info.filename}: {present} bytes are not {shape} of {dtype}")
        array: NDArray[Any] = np.empty(count, dtype)
        _read_into(array.view(np.uint8) if count else np.empty(0, np.uint8), member)
    return np.reshape(array, shape, order="F" if fortran else "C")


def _read_into(target: NDArray[np.uint8], member: IO[bytes]) -> None:
    """Fill `target` with all that is left of a member, in pieces: its checksum is compared at its end."""
    done = 0
    while piece := member.read(_PIECE_BYTES):
        target[done : done + len(piece)] = np.frombuffer(piece, np.uint8)
        done += len(piece)
    if done != len(target):
        raise ValueError(f"{done} bytes instead of {len(target)}")


def _read_npy_header(member: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(member)
    read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in read:
        raise ValueError(f"a member of npy version {'.'.join(map(str, version))}: must be 1.0 or 2.0")
    length = member.read(2 if version == (1, 0) else 4)
    header = member.read(int.from_bytes(length, "little"))
    with without_warnings():  # of escapes in damaged headers, and of what is refused here
        found = read[version](io.BytesIO(length + header))
        try:
            ast.literal_eval(header.decode("latin1"))
        except SyntaxError:
            raise ValueError("an array has a header of Python 2") from None
    return found


def _json(path: Path, array: NDArray[Any]) -> dict[str, Any]:
    try:
        header = json.loads(array.tobytes().decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise DatasetError(path, f"metadata is not JSON ({error})") from error
    if not isinstance(header, dict) or header.get("sfmcpp_problem") != VERSION:
        raise DatasetError(path, f"is no sfmcpp problem of version {VERSION}")
    kinds = {"camera_model": str, "source_format": str, "image_names": list, "extra": dict}
    for key, kind in kinds.items():
        if not isinstance(header.get(key), kind):
            raise DatasetError(path, f"metadata {key!r} must be a {kind.__name__}")
    if not all(isinstance(name, str) for name in header["image_names"]):
        raise DatasetError(path, "metadata 'image_names' must be a list of str")
    return header


def _metadata(header: dict[str, Any], members: dict[str, NDArray[Any]]) -> Metadata:
    extra = dict(header["extra"])
    extra |= {name.removeprefix(_EXTRA): a for name, a in members.items() if name.startswith(_EXTRA)}
    arrays = {name: members.get(name) for name in _METADATA_ARRAYS}
    return Metadata(header["source_format"], header["image_names"], extra=extra, **arrays)


def _require_consistent(problem: Problem, path: Path) -> None:
    require_valid(problem, path)
    metadata = problem.metadata
    if metadata.image_names:
        require_metadata_length("image_names", metadata.image_names, problem.num_cameras, path)
    wanted = {"image_sizes": (problem.num_cameras, 2), "point_colors": (problem.num_points, 3)}
    for name, dtype in _METADATA_ARRAYS.items():
        array = getattr(metadata, name)
        if array is not None and (array.shape != wanted[name] or array.dtype != dtype):
            found = f"{array.dtype.name} {array.shape}"
            raise DatasetError(path, f"metadata {name} is {found}: must be {dtype.name} {wanted[name]}")
    require_image_sizes(problem, path)


FORMAT = Format(
    "npz",
    "NumPy archive: the whole problem, without loss",
    (".npz",),
    read_npz,
    write_npz,
    share_reader=read_npz_share,
    holds_every_model=True,
)
