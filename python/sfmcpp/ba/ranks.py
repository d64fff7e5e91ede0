"""Processes (ranks) that solve one problem together: joint decisions, and errors that all of them raise."""

from __future__ import annotations

import os
import platform
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Protocol, TypeVar

from sfmcpp._core import usable_cores
from sfmcpp.errors import InvalidArgument

T = TypeVar("T")


class Communicator(Protocol):
    """Interface of a communicator; those of mpi4py have it."""

    def Get_rank(self) -> int:  # noqa: N802
        """Number of this process, from 0 on."""

    def Get_size(self) -> int:  # noqa: N802
        """Number of processes."""

    def Iallgather(self, mine: Any, everyones: Any) -> Any:  # noqa: N802
        """Begin to fill a buffer with the buffers of all, in the order of their ranks."""

    def Ialltoall(self, mine: Any, received: Any) -> Any:  # noqa: N802
        """Begin to fill a buffer with what each has for this one."""

    def Ialltoallv(self, mine: Any, received: Any) -> Any:  # noqa: N802
        """Begin the same for buffers with counts of what each gets."""

    def Ibarrier(self) -> Any:  # noqa: N802
        """Begin to wait until all have come here."""

    def Abort(self, errorcode: int) -> None:  # noqa: N802
        """End all processes."""

    def allgather(self, mine: Any) -> list[Any]:
        """Objects of all, in the order of their ranks."""

    def alltoall(self, mine: list[Any]) -> list[Any]:
        """Objects that each has for this one, for objects for each."""

    def bcast(self, value: Any) -> Any:
        """Give the object of rank 0."""

    def send(self, value: Any, dest: int) -> None:
        """Send an object to one of them."""

    def recv(self, *, source: int) -> Any:
        """Receive an object of one of them."""


class Ranks:
    """The processes of a communicator, of which this is one.

    Parameters
    ----------
    communicator : Communicator
        As mpi4py's.

    Attributes
    ----------
    communicator : Communicator
        The same.
    rank, size : int
        Number of this process, and how many there are.

    Raises
    ------
    InvalidArgument
        If it is no communicator.
    """

    def __init__(self, communicator: Communicator) -> None:
        missing = [name for name in _CALLS if not callable(getattr(communicator, name, None))]
        if missing:
            raise InvalidArgument(
                f"comm = {communicator!r}: must be a communicator as of mpi4py, has no {missing[0]}"
            )
        self.communicator = communicator
        self.rank, self.size = communicator.Get_rank(), communicator.Get_size()

    @property
    def is_root(self) -> bool:
        """Whether this is rank 0."""
        return self.rank == 0

    def everyones(self, value: T) -> list[T]:
        """Values of all ranks, in their order."""
        with self._all_ready():
            return self.communicator.allgather(value)

    def turn(self, count: int) -> tuple[int, int]:
        """Begin and end of this rank's share of a row of items."""
        return count * self.rank // self.size, count * (self.rank + 1) // self.size

    def exchanged(self, mine: list[T]) -> list[T]:
        """Values that each rank has for this one, in their order, for one for each of them."""
        with self._all_ready():
            return self.communicator.alltoall(mine)

    def agreed(self, task: Callable[[], T]) -> T:
        """Do what each rank does for itself; if any fails, all raise what the first of these has raised."""
        result, failure = _outcome(task)
        for rank, theirs in enumerate(self.everyones(failure)):
            if theirs is not None:
                raise _error_with_rank(theirs, rank, self.size) if theirs is not failure else theirs
        return result  # type: ignore[return-value]

    def from_root(self, task: Callable[[], T]) -> T:
        """Do on rank 0 what all need; if it fails, all raise what it has raised."""
        outcome = _outcome(task) if self.is_root else None
        with self._all_ready():
            result, failure = self.communicator.bcast(outcome)
        if failure is not None:
            raise failure
        return result  # type: ignore[no-any-return]

    def dealt(self, parts: Callable[[int], T]) -> T:
        """Send each rank its part, made on rank 0, one after the other."""
        with self._all_ready():
            if not self.is_root:
                return self.communicator.recv(source=0)  # type: ignore[no-any-return]
            for rank in range(1, self.size):
                self.communicator.send(parts(rank), dest=rank)
            return parts(0)

    def collected(self, mine: T) -> list[T]:
        """On rank 0 what each has, in their order; nothing elsewhere."""
        with self._all_ready():
            if self.is_root:
                return [mine, *(self.communicator.recv(source=rank) for rank in range(1, self.size))]
            self.communicator.send(mine, dest=0)
            return []

    @contextmanager
    def _all_ready(self) -> Iterator[None]:
        """Begin when all are here: one that waits for long leaves its core to the others."""
        with interrupts_held():
            all_are_here, since = self.communicator.Ibarrier(), time.monotonic()
            while not all_are_here.Test():
                time.sleep(min(max(_NAP_S, _NAP_SHARE * (time.monotonic() - since)), _LONGEST_NAP_S))
            yield

    def cores_of_this(self) -> int:
        """Cores for this rank: a fair share of those that it may use with others of its machine."""
        mine = (platform.node(), _cores_allowed())
        sharing = sum(node == mine[0] and bool(cores & mine[1]) for node, cores in self.everyones(mine))
        return max(1, usable_cores() // sharing)


# A nap is an eighth of the wait so far: looking every tenth of a millisecond takes a seventh of a core.
_NAP_S, _NAP_SHARE, _LONGEST_NAP_S = 1e-4, 1 / 8, 2e-3
_CALLS = (
    "Get_rank",
    "Get_size",
    "Iallgather",
    "Ialltoall",
    "Ialltoallv",
    "Ibarrier",
    "allgather",
    "alltoall",
    "bcast",
    "send",
    "recv",
)


def _outcome(task: Callable[[], T]) -> tuple[T | None, BaseException | None]:
    try:
        return task(), None
    except BaseException as error:
        return None, error


def _error_with_rank(error: BaseException, rank: int, ranks: int) -> BaseException:
    """The error of another rank, with the number of the rank if the error has a text."""
    if isinstance(error, InvalidArgument) and ranks > 1:
        return InvalidArgument(f"rank {rank}: {error}")
    return error


def _cores_allowed() -> frozenset[int]:
    if hasattr(os, "sched_getaffinity"):
        return frozenset(os.sched_getaffinity(0))
    return frozenset(range(os.cpu_count() or 1))


@contextmanager
def interrupts_held(on_interrupt: Callable[[], None] | None = None) -> Iterator[list[int]]:
    """Let stops wait while the ranks pass each other something: half of it would part them.

    Each of them calls `on_interrupt`. The list is of those that wait; what is taken out of it is forgotten.
    """
    pending: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield pending
        return

    def note(number: int, frame: FrameType | None) -> None:
        pending.append(number)
        if on_interrupt is not None:
            on_interrupt()

    before = {int(n): signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    held = {n: handler for n, handler in before.items() if callable(handler)}
    try:
        for number in held:
            signal.signal(number, note)
        yield pending
    finally:
        for number, handler in held.items():
            signal.signal(number, handler)
        for number in pending:
            signal.raise_signal(number)
