"""What a run leaves behind to go on from, and how it is told that it is the same run that goes on."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sfmcpp import _core
from sfmcpp.ba.options import SolveOptions
from sfmcpp.errors import DatasetError

# They say how far a run goes and what it may use, and nothing of its steps.
_MAY_CHANGE = ("threads", "max_iterations", "max_seconds")


@dataclass(frozen=True)
class Checkpoint:
    """Where a run stood.

    Attributes
    ----------
    path : str
        The file that it was in.
    facts : mapping
        What was run, as plain values.
    arrays : mapping of str to array
        Where it stood.
    sequence : int
        The how manieth of its run it is, from 1 on.
    remark : str
        What was wrong with a newer checkpoint, if there was one.
    """

    path: str
    facts: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]
    sequence: int
    remark: str = ""


class CheckpointStore(Protocol):
    """Where checkpoints are kept; :class:`sfmcpp.CheckpointFolder` is one."""

    @property
    def failure(self) -> DatasetError | None:
        """The last checkpoint that could not be saved."""

    def begin(self, resumed: CheckpointStore | None, least_bytes: int) -> None:
        """Refuse what can be known to fail, before a run that takes `resumed` up."""

    def is_due(self) -> bool:
        """Whether it is time for another."""

    def save(self, facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        """Save a checkpoint; where that fails, `failure` says so and the run goes on."""

    def load(self) -> Checkpoint:
        """Give the newest."""


class SolveCheckpoints:
    """The checkpoints of one solve: saved in one store, taken up from one, or both.

    Parameters
    ----------
    save, resume : CheckpointStore, optional
        Where to save, and where to take up.
    arrays : mapping
        Problem and constraints as the core takes them.
    options : SolveOptions
        Options of the solve.

    Raises
    ------
    DatasetError
        If `resume` has no checkpoint of this solve, or `save` cannot be written.
    """

    def __init__(
        self,
        save: CheckpointStore | None,
        resume: CheckpointStore | None,
        arrays: Mapping[str, Any],
        options: SolveOptions,
    ) -> None:
        self._save = save
        self._facts: dict[str, Any] = {}
        self._taken: Checkpoint | None = None
        if save is None and resume is None:
            return
        self._facts = facts_of_run("solve", problem=_digests(arrays), options=options.to_dict())
        if resume is not None:
            self._taken = resume.load()
            require_same_run(self._taken, self._facts)
        if save is not None:
            save.begin(resume, sum(arrays[name].nbytes for name in ("cameras", "intrinsics", "points")))

    @property
    def resumed(self) -> dict[str, NDArray[Any]] | None:
        """Where an earlier solve stood, for the core."""
        return None if self._taken is None else dict(self._taken.arrays)

    @property
    def listener(self) -> Callable[[Callable[[], Mapping[str, NDArray[Any]]], bool], None] | None:
        """What the core calls after each iteration."""
        return None if self._save is None else self._heed

    @property
    def warnings(self) -> list[str]:
        """What went wrong with them."""
        remark = "" if self._taken is None else self._taken.remark
        failure = None if self._save is None else self._save.failure
        return [text for text in (remark, failure and f"no checkpoint: {failure}") if text]

    def _heed(self, where: Callable[[], Mapping[str, NDArray[Any]]], last: bool) -> None:
        assert self._save is not None
        if last or self._save.is_due():
            self._save.save(self._facts, where())


def facts_of_run(run: str, *, problem: Mapping[str, Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """What must be the same for a run to go on with the same bits.

    Parameters
    ----------
    run : str
        What is run.
    problem : mapping of str to str
        Digests of its input, by name.
    options : mapping
        All its options.

    Returns
    -------
    dict
        Plain values.
    """
    return {
        "run": run,
        "version": _core.__version__,
        "instruction_set": _core.INSTRUCTION_SET,
        "problem": dict(problem),
        "options": dict(options),
    }


def require_same_run(checkpoint: Checkpoint, facts: Mapping[str, Any]) -> None:
    """See to it that a checkpoint is of this run.

    Parameters
    ----------
    checkpoint : Checkpoint
        Of some run.
    facts : mapping
        Of this run.

    Raises
    ------
    DatasetError
        If it is not; it says in what they differ.
    """
    for complaint in _differences(checkpoint.facts, facts):
        raise DatasetError(checkpoint.path, complaint)


def _differences(then: Mapping[str, Any], now: Mapping[str, Any]) -> Iterable[str]:
    for name, noun in (("run", "command"), ("version", "version"), ("instruction_set", "instruction set")):
        if then.get(name) != now[name]:
            yield f"is a checkpoint of another {noun}: {then.get(name)!r}, this is {now[name]!r}"
    if differing := _differing(then, now, "problem"):
        yield (
            f"is a checkpoint of another problem: {', '.join(differing)} differ "
            "(a run goes on from the problem as it was at its start)"
        )
    for name in _differing(then, now, "options"):
        if name not in _MAY_CHANGE:
            yield (
                "is a checkpoint of other options: "
                f"{name} = {then['options'].get(name)!r}, this is {now['options'].get(name)!r}"
            )


def _differing(then: Mapping[str, Any], now: Mapping[str, Any], part: str) -> list[str]:
    before, after = dict(then.get(part, {})), now[part]
    return sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))


def _digests(arrays: Mapping[str, Any]) -> dict[str, str]:
    """One for each array of the problem and each group of constraints."""
    named = {name: value for name, value in arrays.items() if name != "constraints"}
    named |= {f"constraints {group['name']!r}": group for group in arrays["constraints"]}
    return {name: _digest(value) for name, value in named.items()}


def _digest(value: Any) -> str:
    digest = hashlib.sha256()
    parts = value.items() if isinstance(value, Mapping) else [("", value)]
    for name, part in parts:
        array = np.ascontiguousarray(part) if isinstance(part, np.ndarray) else np.array(repr(part))
        digest.update(f"{name} {array.dtype.str} {array.shape} ".encode())
        digest.update(array.data if array.size else b"")
    return digest.hexdigest()
