"""Arguments of a rank, read by a child process.

What reads them (typer and, below it, pydantic) stays in memory for the whole solve: 14 MB, which every rank
of a machine would have.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, NoReturn

from sfmcpp.cli.console import ExitCode, print_error, with_exit_code
from sfmcpp.cli.mpi_launch import num_launched

if TYPE_CHECKING:
    from sfmcpp.cli.run import Job


def is_read_apart(arguments: Sequence[str]) -> bool:
    """Whether these are of a rank of a solve."""
    return list(arguments[:1]) == ["solve"] and num_launched() > 1 and hasattr(os, "fork")


def solve_as_read_apart(read: Callable[[], int]) -> int:
    """Solve what the arguments ask for.

    Parameters
    ----------
    read : callable
        Reads them and calls `run.solve_file`; done in a child.

    Returns
    -------
    int
        The exit code: that of the child where there is nothing to solve, as after bad usage.
    """
    from sfmcpp.cli.run import solve_file

    job = _job_of_child(read)
    if job is None:
        return read()
    return job if isinstance(job, int) else with_exit_code(solve_file)(job)


# A child has locks as they were: one that a thread of a profiler held, say, it would wait for without end.
_PATIENCE_S = 60.0


def _job_of_child(read: Callable[[], int]) -> Job | int | None:
    """What a child sends, or its exit code; None if it says nothing."""
    receiving, sending = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(receiving)
        _send_job_and_exit(read, sending)
    os.close(sending)
    sent = _received(receiving)
    if sent is None:
        os.kill(child, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if sent is None:
        return None
    if code < 0:
        return print_error(f"signal {-code} has killed the process that reads the arguments")
    return pickle.loads(sent) if sent else code


def _received(receiving: int) -> bytes | None:
    with os.fdopen(receiving, "rb") as pipe:
        return pipe.read() if select.select([pipe], [], [], _PATIENCE_S)[0] else None


def _send_job_and_exit(read: Callable[[], int], sending: int) -> NoReturn:
    """Do it in a child, which ends without what the parent has to do at its own end."""
    from sfmcpp.cli import run

    def send(job: Job) -> ExitCode:
        with suppress(BrokenPipeError), os.fdopen(sending, "wb") as pipe:
            pickle.dump(job, pipe)
        return ExitCode.DONE

    code = int(ExitCode.BAD_INPUT)
    try:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)  # the parent heeds them
        run.solve_file = send
        code = read()
        sys.stdout.flush()
    finally:
        os._exit(code)
