"""Detection of an MPI launcher; rank 0 reports for all processes."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from sfmcpp.cli.console import ExitCode, print_note
from sfmcpp.cli.interrupts import single_interrupt
from sfmcpp.errors import InvalidArgument, SfmcppError

if TYPE_CHECKING:
    from sfmcpp.ba.ranks import Ranks

# Where launchers say how many they have started: MPICH and Intel MPI, Open MPI.
_SIZES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE")
_RANKS = ("PMI_RANK", "OMPI_COMM_WORLD_RANK")
# Commands that each process of a launcher does for itself; the others they do together.
ALONE = ("info", "doctor", "synth", "evaluate", "slam", "bag", "reconstruct", "undistort")
# MPICH says that it was asked to end, after the one line that says why.
_QUIET_ABORT = "MPIR_CVAR_SUPPRESS_ABORT_MESSAGE"


def num_launched() -> int:
    """Count the processes that a known launcher says it has started with this one."""
    return max(_number_in(name, default=1) for name in _SIZES)


def _number_in(name: str, *, default: int) -> int:
    """A number of the environment; the default where there is none: no launcher has set it then."""
    text = os.environ.get(name, "")
    return int(text) if text.isdecimal() else default


def is_said_by_another(arguments: Sequence[str]) -> bool:
    """Whether another process of a launcher prints what these arguments lead to, usage errors included.

    Commands such as `info` each process does for itself: its arguments may be its own.
    """
    is_first = all(_number_in(name, default=0) == 0 for name in _RANKS)
    return not is_first and (not arguments or arguments[0] not in ALONE)


def launched_ranks(*, asked: bool) -> Ranks | None:
    """Find the processes of this command; None if it runs alone.

    Parameters
    ----------
    asked : bool
        Whether to ask MPI even where no known launcher has left a trace.

    Raises
    ------
    InvalidArgument
        If there is no MPI that mpi4py can load, or it is not that of the launcher.
    """
    launched = num_launched()
    if launched == 1 and not asked:
        return None
    os.environ.setdefault(_QUIET_ABORT, "1")
    try:
        from mpi4py import MPI
    except (ModuleNotFoundError, RuntimeError) as error:
        raise InvalidArgument(
            f"started by MPI, {error}: pip install 'sfmcpp[mpi]' installs mpi4py and an MPI"
        ) from None
    from sfmcpp.ba.ranks import Ranks

    ranks = Ranks(MPI.COMM_WORLD)
    if ranks.size < launched:
        library = MPI.Get_library_version().split("\n")[0].strip()
        raise InvalidArgument(
            f"{launched} processes were started, and each is alone: mpiexec must be that of {library}, "
            "which mpi4py uses"
        )
    return ranks if ranks.size > 1 else None


def run_on_ranks(
    ranks: Ranks, arguments: Mapping[str, object], command: Callable[[Callable[[], None]], ExitCode]
) -> ExitCode:
    """Run a command on all ranks; one that fails alone reports its error and ends all.

    Parameters
    ----------
    ranks : Ranks
        The processes.
    arguments : mapping
        What the command was given, by name. Ranks that were given something else would wait for each other.
    command : callable
        What each does. An error of the package is one of all ranks; only rank 0 raises it. It is given what
        it calls where an interrupt of any rank has been heeded by all.

    Returns
    -------
    ExitCode
        The same on all.
    """
    try:
        with single_interrupt() as heeded:
            from sfmcpp.ba.parts import require_alike

            require_alike(ranks, dict(arguments))
            return command(heeded)
    except SfmcppError:
        if ranks.is_root:
            raise
        return ExitCode.BAD_INPUT
    except KeyboardInterrupt:
        return _end_all_ranks(ranks, "interrupted", ExitCode.INTERRUPTED)
    except MemoryError:
        return _end_all_ranks(ranks, "error: not enough memory", ExitCode.BAD_INPUT)
    except Exception as error:
        return _end_all_ranks(ranks, f"error: {type(error).__name__}: {error}", ExitCode.BAD_INPUT)


def _end_all_ranks(ranks: Ranks, message: str, code: ExitCode) -> ExitCode:
    print_note(f"rank {ranks.rank}: {message}")
    sys.stdout.flush()
    ranks.communicator.Abort(int(code))
    return code
