"""How a command speaks and ends: its results, its exit code, and the one line that tells what went wrong."""

from __future__ import annotations

import sys
from collections.abc import Callable
from enum import IntEnum
from functools import wraps
from typing import ParamSpec

from sfmcpp.cli.terminal import give_up
from sfmcpp.errors import SfmcppError

P = ParamSpec("P")


class ExitCode(IntEnum):
    """The contract with the shell."""

    DONE = 0
    BAD_INPUT = 2
    NUMERICAL_FAILURE = 3
    INTERRUPTED = 130


def say(text: str) -> None:
    """Write results to stdout, if anybody reads it: by then all files are written."""
    if sys.stdout is None:
        return
    try:
        print(text, flush=True)
    except OSError as error:
        give_up(sys.stdout)
        if not isinstance(error, BrokenPipeError):
            raise OSError(f"standard output: {error.strerror}") from None


def tell(message: str) -> None:
    """Write exactly one line to stderr, if there is one."""
    if sys.stderr is None:
        return
    try:
        print("sfmcpp: " + "\\n".join(message.splitlines()), file=sys.stderr, flush=True)
    except OSError:  # the exit code tells
        give_up(sys.stderr)


def tell_error(message: object) -> ExitCode:
    """Tell what is wrong with the input or the usage."""
    tell(f"error: {message}")
    return ExitCode.BAD_INPUT


def tell_interrupted() -> ExitCode:
    """Tell that a stop came before there was anything to keep."""
    tell("interrupted")
    return ExitCode.INTERRUPTED


def with_exit_code(command: Callable[P, ExitCode]) -> Callable[P, ExitCode]:
    """Turn whatever stops a command into a line on stderr and an exit code."""

    @wraps(command)
    def run(*arguments: P.args, **options: P.kwargs) -> ExitCode:
        try:
            return command(*arguments, **options)
        except SfmcppError as error:
            return tell_error(error)
        except KeyboardInterrupt:
            return tell_interrupted()
        except MemoryError:
            return tell_error("not enough memory")
        except OSError as error:
            return tell_error(error)

    return run
