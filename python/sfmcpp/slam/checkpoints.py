"""Checkpoints of a run: the loop between two frames as plain arrays, without pickle; what it was run on."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba.checkpoints import CheckpointStore, RunCheckpoints, digest, facts_of_run
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.map.table import Table
from sfmcpp.map.tracks import Tracks
from sfmcpp.model import Gap
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame, RightView, View
from sfmcpp.model.weight_selection import ConflictReport, WeightSelection
from sfmcpp.sensors import RateBias, Slip, Turn
from sfmcpp.sensors.rate_drift import RateDrift
from sfmcpp.slam.experience import Experience
from sfmcpp.slam.measurement import Measurement, MotionSensor
from sfmcpp.slam.path import Path
from sfmcpp.slam.rate_biases import RateBiases
from sfmcpp.slam.result import FinalAdjustment, KeyframeRecord, SlamResult
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.standstill import Standstill
from sfmcpp.slam.world_map import Keyframe, WeightedMeasurement, WorldMap
from sfmcpp.sources.frames import FrameSource

Order = Literal["C", "F"]

_PLAIN = (type(None), bool, int, float, str)
_SEQUENCES: dict[str, type] = {kind.__name__: kind for kind in (list, tuple, set, frozenset)}
_TREE = "tree"
_JSON = json.JSONEncoder().encode
_CLASSES = (
    ConflictReport,
    Experience,
    FinalAdjustment,
    Frame,
    Gap,
    Keyframe,
    KeyframeRecord,
    Measurement,
    Path,
    RateBias,
    RateBiases,
    RateDrift,
    RightView,
    SlamResult,
    Slip,
    Standstill,
    Table,
    Tracks,
    Turn,
    View,
    WeightSelection,
    WeightedMeasurement,
    WorldMap,
)
State = dict[str, Any]


def flatten(value: Any) -> dict[str, NDArray[Any]]:
    """Convert an object, with all that it refers to, to a few arrays.

    Parameters
    ----------
    value : object
        Numbers, texts, arrays, lists, tuples, sets, dictionaries, and objects that hold such in their
        attributes. What is referred to twice is so again afterwards.

    Returns
    -------
    dict of str to array
        An array for all numbers of each dtype, and ``tree``, UTF-8 JSON as bytes, which says what they are.
    """
    flattening = _Flattening()
    text = flattening.node(value).encode()
    arrays = {name: np.concatenate(pieces) for name, pieces in flattening.pieces.items()}
    return {**arrays, _TREE: np.frombuffer(text, np.uint8)}


def unflatten(arrays: Mapping[str, NDArray[Any]], classes: Iterable[type]) -> Any:
    """Restore an object from the arrays of :func:`flatten`.

    Parameters
    ----------
    arrays : mapping of str to array
        What it gave.
    classes : iterable of type
        The only classes of which objects are made.

    Returns
    -------
    object

    Raises
    ------
    InvalidArgument
        If these are no such arrays, or name another class.
    """
    try:
        tree = json.loads(arrays[_TREE].tobytes())
        return _Unflattening(arrays, {cls.__name__: cls for cls in classes}).value(tree)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise InvalidArgument(f"arrays: hold no such object ({type(error).__name__}: {error})") from error


@cache
def _fields_of(cls: type) -> tuple[str, ...] | None:
    return tuple(field.name for field in fields(cls)) if is_dataclass(cls) else None


@cache
def _name_of(dtype: np.dtype[Any]) -> str:
    return str(dtype.name)


def _attributes_of(value: Any) -> dict[str, Any]:
    """The attributes of an object: of a data class its fields, not what was computed from them and kept."""
    kind: Any = type(value)
    names = _fields_of(kind)
    if names is not None:
        return {name: getattr(value, name) for name in names}
    # From Python 3.11 on, every object has this method, which may give None.
    get = getattr(value, "__getstate__", None)
    return dict((get and get()) or vars(value))


class _Flattening:
    """Writes the tree as text at once: at lists in lists the garbage collector would look again and again."""

    def __init__(self) -> None:
        self.pieces: dict[str, list[NDArray[Any]]] = {}
        self._sizes: dict[str, int] = {}
        # Numbers by identity; what is met stays alive, so that no other object takes its place in memory.
        self._met: dict[int, int] = {}
        self._alive: list[Any] = []

    def node(self, value: Any) -> str:
        kind = type(value)
        if kind in _PLAIN:
            return str(value) if kind is int else _JSON(value)
        if isinstance(value, np.generic):
            return self._piece("scalar", np.asarray(value))
        if kind.__name__ in _SEQUENCES:
            ordered = sorted(value) if isinstance(value, set | frozenset) else value
            return f'["{kind.__name__}",[{",".join(map(self.node, ordered))}]]'
        if isinstance(value, dict):
            return f'["dict",{self._pairs(value)}]'
        if id(value) in self._met:
            return f'["same",{self._met[id(value)]}]'
        self._met[id(value)] = len(self._met)
        self._alive.append(value)
        if isinstance(value, np.ndarray):
            return self._piece("array", value)
        return f'["object","{kind.__name__}",{self._pairs(_attributes_of(value))}]'

    def _pairs(self, values: Mapping[Any, Any]) -> str:
        return f"[{','.join(f'[{self.node(k)},{self.node(x)}]' for k, x in values.items())}]"

    def _piece(self, kind: str, array: NDArray[Any]) -> str:
        """Dtype, where it begins among all numbers of it, shape, and order in memory."""
        order: Order = "C" if array.flags.c_contiguous or not array.flags.f_contiguous else "F"
        name = _name_of(array.dtype)
        begin = self._sizes.get(name, 0)
        self._sizes[name] = begin + array.size
        self.pieces.setdefault(name, []).append(array.ravel(order))
        shape = ",".join(map(str, array.shape))
        return f'["{kind}","{name}",{begin},[{shape}],"{order}"]'


class _Unflattening:
    def __init__(self, arrays: Mapping[str, NDArray[Any]], classes: Mapping[str, type]) -> None:
        self._arrays, self._classes = arrays, classes
        self._met: list[Any] = []

    def value(self, node: Any) -> Any:
        if not isinstance(node, list):
            return node
        kind, *rest = node
        if kind == "same":
            return self._met[rest[0]]
        if kind == "scalar":
            return self._array(*rest)[()]
        if kind == "dict":
            return {self.value(k): self.value(x) for k, x in rest[0]}
        if kind == "array":
            self._met.append(self._array(*rest))
            return self._met[-1]
        if kind == "object":
            return self._object(*rest)
        return _SEQUENCES[kind](self.value(x) for x in rest[0])

    def _array(self, name: str, begin: int, shape: list[int], order: Order) -> NDArray[Any]:
        size = int(np.prod(shape, dtype=np.int64))
        return np.reshape(self._arrays[name][begin : begin + size].copy(), shape, order=order)

    def _object(self, name: str, state: list[list[Any]]) -> Any:
        made: Any = object.__new__(self._classes[name])
        self._met.append(made)
        for attribute, node in state:
            object.__setattr__(made, attribute, self.value(node))
        return made


class SlamCheckpoints:
    """Saving and resuming of a run over frames.

    Parameters
    ----------
    save, resume : CheckpointStore, optional
        Where to save, and where to take up.
    source : FrameSource
        What the camera sees.
    settings : SlamSettings
        What steers the run.
    sensors : sequence of MotionSensor
        What measures the motion beside the camera.
    begin : dict
        State of the loop before the first frame.

    Raises
    ------
    DatasetError
        If `resume` has no checkpoint of this run, or `save` cannot be written.
    """

    def __init__(
        self,
        save: CheckpointStore | None,
        resume: CheckpointStore | None,
        source: FrameSource,
        settings: SlamSettings,
        sensors: Sequence[MotionSensor],
        begin: State,
    ) -> None:
        self._run = RunCheckpoints(save, resume, lambda: _run_facts(source, settings, sensors, begin))
        # Of each pass so far what gives its state, and of each of the saved run that is to come its state.
        self._states: list[Callable[[], State]] = []
        self._last, self._to_come = self._taken()

    def _taken(self) -> tuple[Frame | None, list[State]]:
        """The last frame of the saved run, and the state of each of its passes."""
        taken = self._run.taken
        if taken is None:
            return None, []
        try:
            last, states = unflatten(taken.arrays, _CLASSES)
        except (InvalidArgument, ValueError) as error:
            raise DatasetError(taken.path, f"is no checkpoint of a run over frames: {error}") from error
        return last, list(states)

    def begin_pass(self, state: Callable[[], State]) -> State | None:
        """Begin the next pass over the frames, whose state is asked for; give that of the saved run, if any.

        Those before are finished, and their states do not change any more.
        """
        self._states.append(state)
        if not self._to_come:
            self._last = None
            return None
        return self._to_come.pop(0)

    @property
    def has_finished(self) -> bool:
        """Whether the saved run has finished this pass."""
        return bool(self._to_come)

    def has_passed(self, frame: Frame) -> bool:
        """Whether the saved run took a frame in this pass; DatasetError if it was another one."""
        last, taken = self._last, self._run.taken
        if last is None or taken is None or (frame.number > last.number and not self.has_finished):
            return False
        if frame.number == last.number and not _is_same_frame(frame, last):
            raise DatasetError(taken.path, f"is of other images: frame {frame.number} sees something else")
        return True

    def offer(self, frame: Frame, last: bool) -> None:
        """Save the states after a frame, once, asked for only if it is time or the run ends there."""
        if frame is not self._last:
            self._run.offer(lambda: self._saved(frame), last)

    def _saved(self, frame: Frame) -> dict[str, NDArray[Any]]:
        self._last = frame
        return flatten((frame, [state() for state in self._states]))

    @property
    def warnings(self) -> list[str]:
        """Failures of checkpoints, in sentences."""
        return self._run.warnings


def _run_facts(
    source: FrameSource, settings: SlamSettings, sensors: Sequence[MotionSensor], begin: State
) -> dict[str, Any]:
    digests = {f"frames: {name}": digest(value) for name, value in source.identity().items()}
    digests |= {f"sensor {sensor.name!r}": digest(flatten(sensor)) for sensor in sensors}
    return facts_of_run(
        "slam", problem=digests, options=asdict(settings), layout=_layout(source.intrinsics, begin)
    )


def _layout(intrinsics: FloatArray, begin: State) -> str:
    """Digest of the names of all classes, attributes and entries of what is saved."""
    names = {cls.__name__: [f.name for f in fields(cls)] for cls in _CLASSES if is_dataclass(cls)}
    return digest(flatten((names, WorldMap(intrinsics), begin)))


def _is_same_frame(a: Frame, b: Frame) -> bool:
    return (
        a.t_s == b.t_s
        and np.array_equal(a.view.tracks, b.view.tracks)
        and np.array_equal(a.view.pixels, b.view.pixels)
    )
