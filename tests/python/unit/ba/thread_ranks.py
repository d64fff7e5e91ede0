"""Ranks that are threads of one process, for tests of what ranks decide together."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from queue import Queue
from threading import Barrier
from typing import Any, TypeVar

from conftest import TIMEOUT_S

from sfmcpp.ba.ranks import Ranks

T = TypeVar("T")


class _Shared:
    def __init__(self, size: int) -> None:
        self.barrier = Barrier(size, timeout=TIMEOUT_S)
        self.given: list[Any] = [None] * size
        self.posted = [Queue[Any]() for _ in range(size)]


class _Done:
    def Test(self) -> bool:  # noqa: N802
        return True


class _Communicator:
    """What :class:`Ranks` asks of one of mpi4py, for Python objects."""

    def __init__(self, shared: _Shared, rank: int) -> None:
        self._shared, self._rank = shared, rank

    def Get_rank(self) -> int:  # noqa: N802
        return self._rank

    def Get_size(self) -> int:  # noqa: N802
        return len(self._shared.given)

    def Ibarrier(self) -> _Done:  # noqa: N802
        self._shared.barrier.wait()
        return _Done()

    def allgather(self, mine: Any) -> list[Any]:
        self._shared.given[self._rank] = mine
        self._shared.barrier.wait()
        everyones = list(self._shared.given)
        self._shared.barrier.wait()
        return everyones

    def bcast(self, value: Any) -> Any:
        return self.allgather(value)[0]

    def alltoall(self, mine: list[Any]) -> list[Any]:
        return [of_rank[self._rank] for of_rank in self.allgather(mine)]

    def send(self, value: Any, dest: int) -> None:
        self._shared.posted[dest].put((self._rank, value))

    def recv(self, *, source: int) -> Any:
        posted = self._shared.posted[self._rank]
        while True:
            sender, value = posted.get(timeout=TIMEOUT_S)
            if sender == source:
                return value
            posted.put((sender, value))

    def _unused(self, *_: Any) -> Any:
        raise NotImplementedError

    Iallgather = Ialltoall = Ialltoallv = Abort = _unused


def on_thread_ranks(size: int, task: Callable[[Ranks], T]) -> list[T]:
    """What a task gives on each of some ranks, in their order; what one of them raises."""
    shared = _Shared(size)
    with ThreadPoolExecutor(size) as pool:
        running = [pool.submit(task, Ranks(_Communicator(shared, rank))) for rank in range(size)]
        return [one.result() for one in running]
