"""Checkpoints of a run, and the check that a resumed run solves the same problem with the same options."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from sfmcpp import _core
from sfmcpp.ba.ranks import Ranks
from sfmcpp.errors import DatasetError, InvalidArgument

# Limits of a run, which do not change its steps.
_MAY_CHANGE = ("threads", "max_iterations", "max_seconds")

# Gives the arrays of where a run stands.
Where = Callable[[], Mapping[str, NDArray[Any]]]


@dataclass(frozen=True)
class Checkpoint:
    """State of a run at a checkpoint.

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


@runtime_checkable
class CheckpointStore(Protocol):
    """Storage of checkpoints; :class:`sfmcpp.CheckpointFolder` is one."""

    @property
    def failure(self) -> DatasetError | None:
        """The last checkpoint that could not be saved."""

    def begin(self, resumed: CheckpointStore | None, least_bytes: int) -> None:
        """Refuse what can be known to fail, before a run that takes `resumed` up."""

    def is_due(self) -> bool:
        """Whether it is time for another."""

    def save(self, facts: Mapping[str, Any], where: Where) -> bool:
        """Save a checkpoint; if that fails, `failure` has the error and the run continues."""

    def load(self) -> Checkpoint:
        """Give the newest."""


@runtime_checkable
class SharedCheckpointStore(CheckpointStore, Protocol):
    """Storage of the checkpoints of several ranks; :class:`sfmcpp.CheckpointFolder` is one."""

    def load(self, sequence: int | None = None) -> Checkpoint:
        """Give the newest, or that one."""

    def sequences(self) -> set[int]:
        """Tell which are whole."""

    def take_back(self, failure: DatasetError) -> None:
        """Let what was saved last be replaced by the next."""

    def of_rank(self, rank: int) -> SharedCheckpointStore:
        """Give the one for the checkpoints of one of several ranks."""


class RunCheckpoints:
    """The checkpoints of one run: saved in one store, taken up from one, both or neither.

    Parameters
    ----------
    save, resume : CheckpointStore, optional
        Where to save, and where to take up.
    facts : callable
        Gives those of :func:`facts_of_run`, where they are needed.
    least_bytes : int
        Size of a checkpoint, at least [bytes].

    Attributes
    ----------
    taken : Checkpoint or None
        Where an earlier run stood.

    Raises
    ------
    DatasetError
        If `resume` has no checkpoint of this run, or `save` cannot be written.
    """

    def __init__(
        self,
        save: CheckpointStore | None,
        resume: CheckpointStore | None,
        facts: Callable[[], dict[str, Any]],
        least_bytes: int = 0,
    ) -> None:
        self._save, self._facts = save, {} if save is None and resume is None else facts()
        self.taken = None if resume is None else resume.load()
        if self.taken is not None:
            _require_same_run(self.taken, self._facts)
        if save is not None:
            save.begin(resume, least_bytes)

    @property
    def are_saved(self) -> bool:
        """Whether there is a store to save them in."""
        return self._save is not None

    @property
    def warnings(self) -> list[str]:
        """Failures of checkpoints, in sentences."""
        remark = "" if self.taken is None else self.taken.remark
        failure = None if self._save is None else self._save.failure
        return [text for text in (remark, failure and f"no checkpoint: {failure}") if text]

    def offer(self, where: Where, last: bool = False) -> None:
        """Save where the run stands, if it is time, or the run is stopped there."""
        if self._save is not None and (last or self._save.is_due()):
            self._save.save(self._facts, where)


class RankCheckpoints:
    """The checkpoints of a run of several ranks: each saves its own, at the same iterations.

    One of all is whole where each has it whole: the next is not begun before, and the one before is kept.

    Parameters
    ----------
    save, resume : CheckpointStore, optional
        Where to save, and where to take up; the same on all ranks.
    facts : callable
        Gives those of :func:`facts_of_run` of this rank, where they are needed.
    least_bytes : int
        Size of the checkpoint of a rank, at least [bytes].
    ranks : Ranks
        The processes.

    Attributes
    ----------
    taken : Checkpoint or None
        Where an earlier run stood, on this rank.

    Raises
    ------
    DatasetError
        As :class:`RunCheckpoints`, on all ranks.
    """

    def __init__(
        self,
        save: CheckpointStore | None,
        resume: CheckpointStore | None,
        facts: Callable[[], dict[str, Any]],
        least_bytes: int,
        ranks: Ranks,
    ) -> None:
        self._ranks = ranks
        resumed = ranks.agreed(lambda: _store_of_rank(resume, ranks.rank))
        saved = ranks.agreed(lambda: _store_of_rank(save, ranks.rank))
        self._save, self._facts = saved, {} if save is None and resume is None else facts()
        self._facts |= {"ranks": [ranks.rank, ranks.size]}
        self.taken = None if resumed is None else self._newest_of_all(resumed)
        if saved is not None:
            ranks.agreed(lambda: saved.begin(resumed, least_bytes))

    @property
    def are_saved(self) -> bool:
        """Whether there is a store to save them in."""
        return self._save is not None

    @property
    def warnings(self) -> list[str]:
        """Failures of checkpoints, in sentences."""
        failure = None if self._save is None else self._save.failure
        return [] if failure is None else [f"no checkpoint: {failure}"]

    def offer(self, where: Where, last: bool = False) -> None:
        """Save where the run stands on all ranks, if it is time, or the run is stopped there."""
        store, ranks = self._save, self._ranks
        if store is None or not ranks.from_root(lambda: last or store.is_due()):
            return
        is_saved = ranks.agreed(lambda: store.save(self._facts, where))
        failures = [f for f in ranks.everyones(None if is_saved else store.failure) if f is not None]
        if failures and is_saved:
            store.take_back(failures[0])

    def _newest_of_all(self, store: SharedCheckpointStore) -> Checkpoint:
        common = set.intersection(*self._ranks.everyones(store.sequences()))
        taken = self._ranks.agreed(lambda: store.load(max(common, default=None)))
        if not common:  # each has one, but of another iteration
            raise DatasetError(taken.path, "there is no checkpoint that all ranks have whole")
        self._ranks.agreed(lambda: _require_same_run(taken, self._facts))
        return taken


def _store_of_rank(store: CheckpointStore | None, rank: int) -> SharedCheckpointStore | None:
    if store is None:
        return None
    if not isinstance(store, SharedCheckpointStore):
        raise InvalidArgument(f"{store!r}: on several ranks checkpoints need a store like CheckpointFolder")
    return store.of_rank(rank)


def facts_of_run(
    run: str, *, problem: Mapping[str, Any], options: Mapping[str, Any], layout: str = ""
) -> dict[str, Any]:
    """Facts that must be equal for a run to be resumed with the same bits.

    Parameters
    ----------
    run : str
        What is run.
    problem : mapping of str to str
        Digests of its input, by name.
    options : mapping
        All its options.
    layout : str
        Digest of how its state is made up; versions under development have one number and several layouts.

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
        "layout": layout,
    }


def _require_same_run(checkpoint: Checkpoint, facts: Mapping[str, Any]) -> None:
    for complaint in _differences(checkpoint.facts, facts):
        raise DatasetError(checkpoint.path, complaint)


def _differences(then: Mapping[str, Any], now: Mapping[str, Any]) -> Iterable[str]:
    if then.get("ranks") != now.get("ranks"):
        yield f"is a checkpoint of rank, ranks {then.get('ranks')}, this is {now.get('ranks')}"
    for name, noun in (("run", "command"), ("version", "version"), ("instruction_set", "instruction set")):
        if then.get(name) != now[name]:
            yield f"is a checkpoint of another {noun}: {then.get(name)!r}, this is {now[name]!r}"
    if differing := _differing_entries(then, now, "problem"):
        yield (
            f"is a checkpoint of another problem: {', '.join(differing)} differ "
            "(a run goes on from the problem as it was at its start)"
        )
    before = _entries(then, "options")
    for name in _differing_entries(then, now, "options"):
        if name not in _MAY_CHANGE:
            yield (
                "is a checkpoint of other options: "
                f"{name} = {before.get(name)!r}, this is {now['options'].get(name)!r}"
            )
    if then.get("layout") != now["layout"]:
        yield "was written by another version, which saved other things or called them otherwise"


def _differing_entries(then: Mapping[str, Any], now: Mapping[str, Any], part: str) -> list[str]:
    before, after = _entries(then, part), now[part]
    return sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))


def _entries(facts: Mapping[str, Any], part: str) -> Mapping[str, Any]:
    """A part of the facts; whatever another version has in its place counts as none."""
    found = facts.get(part)
    return found if isinstance(found, Mapping) else {}


def digest(value: Any) -> str:
    """SHA-256 of a mapping of such values, of an array with its dtype and shape, or of a plain value."""
    found = hashlib.sha256()
    if isinstance(value, Mapping):
        for name, part in value.items():
            found.update(f"{name} {digest(part)} ".encode())
        return found.hexdigest()
    array = np.ascontiguousarray(value) if isinstance(value, np.ndarray) else np.array(repr(value))
    found.update(f"{array.dtype.str} {array.shape} ".encode())
    found.update(array.data if array.size else b"")
    return found.hexdigest()
