"""A communicator of MPI that fails, or kills its process, for tests of what the other ranks do then."""

from __future__ import annotations

import os
import signal
from typing import Any

from mpi4py import MPI


class Failing:
    """A communicator whose collectives fail from one on."""

    def __init__(self, successes: int, failure: BaseException | None) -> None:
        self.left, self.failure = successes, failure

    def __getattr__(self, name: str) -> Any:
        call = getattr(MPI.COMM_WORLD, name)
        if name not in ("Iallgather", "Ialltoall", "Ialltoallv", "allgather", "bcast", "send", "recv"):
            return call

        def counted(*arguments: Any, **named: Any) -> Any:
            self.left -= 1
            if self.left >= 0:
                return call(*arguments, **named)
            if self.failure is not None:
                raise self.failure
            os.kill(os.getpid(), signal.SIGKILL)

        return counted
