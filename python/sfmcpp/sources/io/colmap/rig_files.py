"""Rigs and frames in COLMAP's files, text and binary."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeVar

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.colmap.binary import Records
from sfmcpp.sources.io.colmap.text import is_comment, read_lines
from sfmcpp.sources.io.files import is_present
from sfmcpp.sources.io.number_text import number_of

TEXT_FILES, BINARY_FILES = ("rigs.txt", "frames.txt"), ("rigs.bin", "frames.bin")
CAMERA = "CAMERA"
_KINDS = {0: CAMERA, 1: "IMU"}
_NUMBER_OF_KIND = {name: number for number, name in _KINDS.items()}
# Digits of a number, and letters of a wrong word that a message tells, at most.
_MOST_DIGITS, _LONGEST_QUOTE = 20, 40
_COUNT, _NUMBER, _WIDE = struct.Struct("<Q"), struct.Struct("<I"), struct.Struct("<Q")
_KIND, _FLAG, _POSE = struct.Struct("<i"), struct.Struct("<B"), struct.Struct("<7d")

Pose = tuple[float, ...]
"""Quaternion wxyz and translation."""
_IDENTITY: Pose = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_Item = TypeVar("_Item")


@dataclass(frozen=True)
class Sensor:
    """A sensor of a rig: its kind, its number among those, and sensor_from_rig, None if unknown."""

    kind: str
    id: int
    pose: Pose | None = _IDENTITY


@dataclass(frozen=True)
class Rig:
    """A rig; its first sensor is the one that the others are relative to."""

    id: int
    sensors: tuple[Sensor, ...]


@dataclass(frozen=True)
class Frame:
    """A frame: rig_from_world, and kind, number of the sensor and number of the image of each of its data."""

    id: int
    rig_id: int
    pose: Pose
    data: tuple[tuple[str, int, int], ...]


@dataclass(frozen=True)
class RigModel:
    """All rigs and frames, and the files they are from."""

    rigs: tuple[Rig, ...]
    frames: tuple[Frame, ...]
    rigs_path: Path
    frames_path: Path


def read_text_rigs(folder: Path, *, alone: bool = False) -> RigModel | None:
    """Rigs and frames of rigs.txt and frames.txt; None if no rig has several sensors (`alone`: if any)."""
    rigs, frames = (folder / name for name in TEXT_FILES)
    mounted = _wanted_rigs(_lines(rigs, _rig), alone) if _wanted_files(rigs, frames, alone) else ()
    return RigModel(mounted, tuple(_lines(frames, _frame)), rigs, frames) if mounted else None


def read_binary_rigs(folder: Path, *, alone: bool = False) -> RigModel | None:
    """Rigs and frames of rigs.bin and frames.bin; None if no rig has several sensors (`alone`: if any)."""
    rigs, frames = (folder / name for name in BINARY_FILES)
    mounted = _wanted_rigs(_records(rigs, _rig), alone) if _wanted_files(rigs, frames, alone) else ()
    return RigModel(mounted, tuple(_records(frames, _frame)), rigs, frames) if mounted else None


def _wanted_files(rigs: Path, frames: Path, alone: bool) -> bool:
    """Whether there are rigs to read; those of one sensor say nothing without frames."""
    return is_present(rigs) and (is_present(frames) or not alone)


def _wanted_rigs(rigs: Iterable[Rig], alone: bool) -> tuple[Rig, ...]:
    """All rigs if any has several sensors or, with `alone`, if none has; else none."""
    found = tuple(rigs)
    return found if any(len(rig.sensors) > 1 for rig in found) != alone else ()


class _Fields(Protocol):
    """The numbers of a file, taken one after the other."""

    def number(self) -> int: ...
    def wide(self) -> int: ...
    def flag(self) -> int: ...
    def kind(self) -> str: ...
    def pose(self) -> Pose: ...


def _rig(fields: _Fields) -> Rig:
    rig_id, count = fields.number(), fields.number()
    first = [Sensor(fields.kind(), fields.number())] if count else []
    return Rig(rig_id, (*first, *[_sensor(fields) for _ in range(count - 1)]))


def _sensor(fields: _Fields) -> Sensor:
    kind, number = fields.kind(), fields.number()
    return Sensor(kind, number, fields.pose() if fields.flag() else None)


def _frame(fields: _Fields) -> Frame:
    frame_id, rig_id, pose = fields.number(), fields.number(), fields.pose()
    data = [(fields.kind(), fields.number(), fields.wide()) for _ in range(fields.number())]
    return Frame(frame_id, rig_id, pose, tuple(data))


class _Words:
    """The fields of a line of text."""

    def __init__(self, line: bytes) -> None:
        self._words = line.decode("ascii", "backslashreplace").split()[::-1]

    def kind(self) -> str:
        if not self._words:
            raise ValueError("it ends too early")
        return self._words.pop()

    def number(self) -> int:
        return self._whole(2**32)

    def wide(self) -> int:
        return self._whole(2**64)

    flag = number

    def _whole(self, end: int) -> int:
        word = self.kind()
        value = int(word) if word.isdecimal() and len(word) <= _MOST_DIGITS else -1
        if not 0 <= value < end:
            raise ValueError(f"{word[:_LONGEST_QUOTE]} must be a whole number from 0 to {end - 1}")
        return value

    def pose(self) -> Pose:
        return tuple(self._finite() for _ in _IDENTITY)

    def _finite(self) -> float:
        word = self.kind()
        if not math.isfinite(number := number_of(word)):
            raise ValueError(f"{word[:_LONGEST_QUOTE]} is not a finite number")
        return number

    def require_end(self) -> None:
        if self._words:
            raise ValueError("words are left over")


def _lines(path: Path, parse: Callable[[_Fields], _Item]) -> Iterator[_Item]:
    for row, line in enumerate(read_lines(path)):
        if is_comment(line):
            continue
        try:
            words = _Words(line)
            item = parse(words)
            words.require_end()
        except ValueError as error:
            raise DatasetError(path, f"a line that cannot be read: {error}", row + 1) from error
        yield item


class _Binary:
    """The fields of a binary file."""

    def __init__(self, records: Records) -> None:
        self._records = records

    def _one(self, layout: struct.Struct) -> int:
        return int(self._records.unpack(layout)[0])

    def number(self) -> int:
        return self._one(_NUMBER)

    def wide(self) -> int:
        return self._one(_WIDE)

    def flag(self) -> int:
        return self._one(_FLAG)

    def kind(self) -> str:
        number = self._one(_KIND)
        return _KINDS.get(number, str(number))

    def pose(self) -> Pose:
        return self._records.unpack(_POSE)


def _records(path: Path, parse: Callable[[_Fields], _Item]) -> Iterator[_Item]:
    records = Records(path, 2 * _NUMBER.size)
    fields = _Binary(records)
    for _ in range(records.count):
        yield parse(fields)
    records.require_end()


class _Sink(Protocol):
    def add(self, layout: struct.Struct, *values: float) -> None: ...
    def kind(self, name: str) -> None: ...


class _TextSink:
    def __init__(self) -> None:
        self._words: list[str] = []

    def add(self, _: struct.Struct, *values: float) -> None:
        self._words += map(repr, values)

    def kind(self, name: str) -> None:
        self._words.append(name)

    def content(self) -> bytes:
        return " ".join(self._words).encode("ascii") + b"\n"


class _BinarySink:
    def __init__(self) -> None:
        self._content = bytearray()

    def add(self, layout: struct.Struct, *values: float) -> None:
        self._content += layout.pack(*values)

    def kind(self, name: str) -> None:
        self.add(_KIND, _NUMBER_OF_KIND[name])

    def content(self) -> bytes:
        return bytes(self._content)


def text_rig_files(model: RigModel) -> Iterator[Iterator[bytes]]:
    """Content of rigs.txt and frames.txt, in pieces."""
    yield _text("RIG_ID NUM_SENSORS TYPE ID, SENSORS[] as (TYPE ID HAS_POSE [Q T])", model.rigs, _put_rig)
    yield _text("FRAME_ID RIG_ID Q T NUM_DATA DATA[] as (TYPE ID IMAGE_ID)", model.frames, _put_frame)


def binary_rig_files(model: RigModel) -> Iterator[Iterator[bytes]]:
    """Content of rigs.bin and frames.bin, in pieces."""
    yield _binary(model.rigs, _put_rig)
    yield _binary(model.frames, _put_frame)


def _text(head: str, items: tuple[_Item, ...], put: Callable[[_Sink, _Item], None]) -> Iterator[bytes]:
    yield f"# {head}\n".encode("ascii")
    for item in items:
        sink = _TextSink()
        put(sink, item)
        yield sink.content()


def _binary(items: tuple[_Item, ...], put: Callable[[_Sink, _Item], None]) -> Iterator[bytes]:
    yield _COUNT.pack(len(items))
    for item in items:
        sink = _BinarySink()
        put(sink, item)
        yield sink.content()


def _put_rig(sink: _Sink, rig: Rig) -> None:
    sink.add(_NUMBER, rig.id)
    sink.add(_NUMBER, len(rig.sensors))
    for k, sensor in enumerate(rig.sensors):
        sink.kind(sensor.kind)
        sink.add(_NUMBER, sensor.id)
        if k > 0:
            sink.add(_FLAG, int(sensor.pose is not None))
        if k > 0 and sensor.pose is not None:
            sink.add(_POSE, *sensor.pose)


def _put_frame(sink: _Sink, frame: Frame) -> None:
    sink.add(_NUMBER, frame.id)
    sink.add(_NUMBER, frame.rig_id)
    sink.add(_POSE, *frame.pose)
    sink.add(_NUMBER, len(frame.data))
    for kind, sensor, image in frame.data:
        sink.kind(kind)
        sink.add(_NUMBER, sensor)
        sink.add(_WIDE, image)
