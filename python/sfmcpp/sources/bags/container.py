"""Bags of ROS 1 (``.bag``) and ROS 2 (folders, ``.db3``, ``.mcap``), read without trust.

The library is an extra, ``pip install 'sfmcpp[ros]'``, and imported only here. It makes Python of the message
definitions that a bag brings along, so messages are decoded by ROS's own definitions, and a topic whose
definition is another one is refused.
"""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Callable, Collection, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import IO, Any

from sfmcpp.errors import DatasetError, SfmcppError
from sfmcpp.model.process_state import SharedChange
from sfmcpp.sources.bags.remedies import for_damaged, for_no_bag
from sfmcpp.sources.io.files import (
    expands_too_far,
    failures_named,
    is_folder,
    is_regular_file,
    largest_expansion,
    require_present,
    require_regular_file,
)
from sfmcpp.sources.io.sqlite_tables import log_beside, quote_path, read_only_uri, require_stored

_ROS1, _ROS2 = (".bag",), (".db3", ".mcap")
_METADATA = "metadata.yaml"
_LARGEST_METADATA_BYTES = 4 << 20
# An anchor of YAML: a few of them stand for any number of parts.
_ANCHOR = re.compile(rb"(?:^|[\s\[{,:\-\"'])&\w")
_TRANSFORMS = "tf2_msgs/msg/TFMessage"  # not among the definitions that the library has
_TABLES = ("messages", "topics", "schema", "message_definitions")
_MOST_WORDS = 200


@dataclass(frozen=True)
class Topic:
    """A topic of a bag.

    Attributes
    ----------
    name : str
        ``/camera/image_raw``.
    type : str
        ``sensor_msgs/msg/Image``, also where ROS 1 leaves ``msg`` out.
    count : int
        Number of its messages.
    """

    name: str
    type: str
    count: int


class Bag:
    """An open bag, as :func:`open_bag` makes it.

    Parameters
    ----------
    path : Path
        The file or the folder.
    reader : Any
        Its reader of the library.

    Attributes
    ----------
    ros : int
        Version of ROS, 1 or 2.
    """

    def __init__(self, path: Path, reader: Any) -> None:
        self.path, self._reader = path, reader
        self.ros = 1 if _is_ros1(path) else 2

    @cached_property
    def topics(self) -> tuple[Topic, ...]:
        """All topics, by name."""
        counts: dict[tuple[str, str], int] = {}
        for known in self._reader.connections:
            key = (known.topic, known.msgtype)
            counts[key] = counts.get(key, 0) + known.msgcount
        return tuple(Topic(*key, count) for key, count in sorted(counts.items()))

    @cached_property
    def duration_s(self) -> float:
        """From the first message to the last, as they were recorded [s]."""
        with _faults_named(self.path):
            # The library counts one nanosecond more, to the end of an open interval.
            return float(max(self._reader.duration - 1, 0) * 1e-9)

    def messages(self, names: Collection[str]) -> Iterator[tuple[str, Any]]:
        """Give the messages of topics as they were recorded: the topic's name and the message.

        Raises
        ------
        DatasetError
            If the bag is damaged, or a topic's messages are not as ROS defines them.
        """
        with _faults_named(self.path):
            chosen = [known for known in self._reader.connections if known.topic in names]
            for known in chosen:
                self._require_known_definition(known)
            stream = iter(self._reader.messages(chosen)) if chosen else iter(())
        while True:
            with _faults_named(self.path):
                found = next(stream, None)
                if found is None:
                    return
                known, _, data = found
                message = self._decode(data, known.msgtype)
            yield known.topic, message

    @cached_property
    def _decode(self) -> Callable[[bytes, str], Any]:
        definitions = _definitions(self.ros)
        decode: Callable[[bytes, str], Any] = (
            definitions.deserialize_ros1 if self.ros == 1 else definitions.deserialize_cdr
        )
        return decode

    def _require_known_definition(self, known: Any) -> None:
        definitions, type = _definitions(self.ros), known.msgtype
        ours = definitions.generate_msgdef(type)[1] if self.ros == 1 else definitions.hash_rihs01(type)
        if known.digest not in (ours, "", "*"):
            reason = f"{known.topic} has messages by another definition of {type} than ROS's"
            raise DatasetError(self.path, reason)


def is_bag(path: Path) -> bool:
    """Whether a file's name, or what a folder holds, says that it is a bag.

    Parameters
    ----------
    path : Path
        The file or the folder.
    """
    if is_folder(path):
        return is_regular_file(path / _METADATA)
    return path.suffix in (*_ROS1, *_ROS2)


@contextmanager
def open_bag(path: str | os.PathLike[str]) -> Iterator[Bag]:
    """Open a bag; its index is read, and no message.

    Parameters
    ----------
    path : path-like
        ``.bag`` of ROS 1; of ROS 2 a folder with ``metadata.yaml``, or one ``.db3`` or ``.mcap`` file.

    Raises
    ------
    DatasetError
        If there is no such file, it is damaged or no bag, or the library is not installed; and from what is
        done with the bag, where it expands further than other files may.
    """
    source = Path(path)
    make = _reader_of(source)
    with _BOUNDED_EXPANSION.made():
        with _faults_named(source):
            reader = make(source)
            reader.open()
        try:
            with _faults_named(source):
                _require_named_topics(reader)
            yield Bag(source, reader)
        finally:
            reader.close()


def _require_named_topics(reader: Any) -> None:
    for known in reader.connections:
        if not (isinstance(known.topic, str) and isinstance(known.msgtype, str)):
            raise ValueError(f"topic {known.topic!r} is of type {known.msgtype!r}: both must be text")


def _reader_of(path: Path) -> Callable[[Path], Any]:
    """Class of the library that reads `path`, once it is clear that nothing in it blocks or explodes."""
    try:
        import yaml  # noqa: F401
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
    except ImportError as error:
        raise DatasetError(path, f"bags need {error.name}: pip install 'sfmcpp[ros]'") from None
    with failures_named(path):
        require_present(path)
    if not is_bag(path):
        rule = f"must be a .bag, .db3 or .mcap file, or a folder of ROS 2 with {_METADATA}"
        with failures_named(path):
            raise DatasetError(path, f"is no bag: {rule}{for_no_bag(path)}")
    if is_folder(path):
        with failures_named(path):
            for file in path.iterdir():
                if not is_folder(file):
                    require_regular_file(file)
        _require_plain_metadata(path / _METADATA)
    else:
        require_regular_file(path)
    return Reader1 if _is_ros1(path) else Reader2


def _is_ros1(path: Path) -> bool:
    """Whether a bag is of ROS 1, whose bags are no folders, whatever these are called."""
    return path.suffix in _ROS1 and not is_folder(path)


def _require_plain_metadata(path: Path) -> None:
    with failures_named(path), path.open("rb") as file:
        data = file.read(_LARGEST_METADATA_BYTES + 1)
    if len(data) > _LARGEST_METADATA_BYTES:
        raise DatasetError(path, f"holds more than {_LARGEST_METADATA_BYTES} bytes: refused")
    if _ANCHOR.search(data):
        raise DatasetError(path, "has anchors (&): must be written out")


@contextmanager
def _faults_named(path: Path) -> Iterator[None]:
    """Turn whatever the library raises for a damaged bag into a DatasetError of one line."""
    try:
        with failures_named(path):
            try:
                yield
            except MemoryError:  # a length that is damaged asks for any number of bytes
                raise DatasetError(path, "is damaged, or does not fit in memory") from None
    except SfmcppError:
        raise
    except Exception as error:  # as its parsers fail in many ways
        words = " ".join(str(error).split())[:_MOST_WORDS] or type(error).__name__
        reason = f"is damaged, or no bag: {words.rstrip('.')}{for_damaged(path)}"
        raise DatasetError(path, reason) from error


@cache
def _definitions(ros: int) -> Any:
    """Messages as ROS defines them."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.LATEST)
    if _TRANSFORMS not in store.fielddefs:
        text = "geometry_msgs/TransformStamped[] transforms\n"
        store.register(get_types_from_msg(text, _TRANSFORMS))
    return store


def _bound_expansion() -> Callable[[], None]:
    """Bound what the library decompresses and parses, until the function returned is called."""
    tables = _bounded_tables()
    before = [(table, {name: table[name] for name in bounded}) for table, bounded in tables]
    for table, bounded in tables:
        table.update(bounded)

    def restore() -> None:
        for table, own in before:
            table.update(own)

    return restore


_BOUNDED_EXPANSION = SharedChange(_bound_expansion)


def _bounded_tables() -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Where the library looks up how it decompresses, parses and opens databases, and what it shall find."""
    import bz2
    from types import SimpleNamespace

    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag1 import reader as reader1
    from rosbags.rosbag2 import reader as reader2
    from rosbags.rosbag2 import storage_mcap, storage_sqlite3

    names = vars(reader2)
    zstd = names["zstd"]

    def of(make: Callable[[], Any]) -> Callable[..., bytes]:
        return lambda data, _=0: _expanded(make(), data)

    zstd_file = SimpleNamespace(
        decompress=of(zstd.ZstdDecompressor), open=lambda raw, mode: _bounded_file(zstd.open(raw, mode), raw)
    )
    return [
        (reader1.decompressors, {"bz2": of(bz2.BZ2Decompressor), "lz4": of(LZ4FrameDecompressor)}),
        (storage_mcap.DECOMPRESSORS, {"zstd": of(zstd.ZstdDecompressor), "lz4": of(LZ4FrameDecompressor)}),
        (names, {"zstd": zstd_file, "YAML": _PlainYaml}),
        # Qualities of service, a document of YAML for each topic, concern nobody who reads.
        *((vars(module), {"parse_qos": lambda _: []}) for module in (reader2, storage_mcap, storage_sqlite3)),
        (names["DirectoryReader"].STORAGE_PLUGINS, {"sqlite3": _sqlite_reader}),
        (names["Reader"].STORAGE_PLUGINS, {".db3": _sqlite_reader}),
    ]


class _PlainYaml:
    """In place of the library's loader, which is in Python alone and takes ten times as long."""

    def __init__(self, *, typ: str) -> None:
        pass

    def load(self, text: str) -> Any:
        import yaml

        class Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
            """Loads YAML without numbers to the base of 60, which take the square of their length."""

        for kind in (int, float):
            Loader.add_constructor(f"tag:yaml.org,2002:{kind.__name__}", _scalar_to(kind))
        return yaml.load(text, Loader=Loader)


def _scalar_to(kind: Callable[[str], Any]) -> Callable[[Any, Any], Any]:
    return lambda loader, node: kind(loader.construct_scalar(node))


def _sqlite_reader(path: Path) -> Any:
    """Reader of the library for a ``.db3`` file: it makes a URI of the path, and does not quote it."""
    from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

    if (log := log_beside(path)) is not None:  # which the library leaves out
        merge = f"`sqlite3 {path.name} 'PRAGMA journal_mode=DELETE'` writes it into the bag"
        raise DatasetError(path, f"was not closed: {log.name} beside it belongs to it; {merge}")
    with closing(sqlite3.connect(read_only_uri(path), uri=True)) as connection:
        require_stored(connection, path, _TABLES)
    return Sqlite3Reader(Path(quote_path(path)))


def _expanded(stream: Any, data: bytes) -> bytes:
    limit = largest_expansion(len(data))
    content: bytes = stream.decompress(data, max_length=limit + 1)
    if len(content) > limit:
        raise ValueError(expands_too_far(limit))
    if not stream.eof:
        raise ValueError("compressed data end before their end mark")
    return content


@contextmanager
def _bounded_file(file: IO[bytes], raw: IO[bytes]) -> Iterator[Any]:
    """A file that is decompressed as it is copied."""
    limit = largest_expansion(os.fstat(raw.fileno()).st_size)
    with file:
        yield _Bounded(file, limit)


class _Bounded:
    def __init__(self, file: IO[bytes], limit: int) -> None:
        self._file, self._limit, self._size = file, limit, 0

    def read(self, size: int) -> bytes:
        data = self._file.read(size)
        self._size += len(data)
        if self._size > self._limit:
            raise ValueError(expands_too_far(self._limit))
        return data
