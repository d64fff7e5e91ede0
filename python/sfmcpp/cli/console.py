"""Output and exit code of a command: results, one line for what went wrong, and progress on the terminal.

A terminal that has gone, or a full disk behind it, ends no work.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable
from enum import IntEnum
from functools import wraps
from typing import IO, TYPE_CHECKING, Any, ParamSpec, cast

from sfmcpp.errors import InvalidArgument, SfmcppError, ends_of

if TYPE_CHECKING:
    from rich.console import Console


P = ParamSpec("P")
# Control characters, which names of files may have, and marks that change the direction of text.
_OBEYED = re.compile(
    r"\x1b(?!\[[\d;]*m)|[\x00-\x08\x0b-\x1a\x1c-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]"
)

# Paths have 4,096 letters at most, and their ends tell which they are.
# The longest that is told whole, and how much of the beginning and of the end otherwise.
_OF_WORD, _OF_LINE = (500, 125, 125), (5000, 1250, 1250)
_LONG_WORD = re.compile(rf"\S{{{_OF_WORD[0] + 1},}}")


class ExitCode(IntEnum):
    """The contract with the shell.

    BAD_INPUT is for what the caller can mend: the command, or a file that cannot be used. NO_RESULT is for
    input that was read and gave nothing: a numerical failure, no model, no map.
    """

    DONE = 0
    BAD_INPUT = 2
    NO_RESULT = 3
    INTERRUPTED = 130


def printable(text: str) -> str:
    """Text with what a terminal would obey written out, but for line breaks, tabs and colours."""
    return _OBEYED.sub(lambda found: ascii(found[0])[1:-1], text)


def print_result(text: str) -> None:
    """Write results to stdout, if anybody reads it: by then all files are written."""
    if sys.stdout is None:
        return
    try:
        print(printable(text), flush=True)
    except OSError as error:
        discard_output(sys.stdout)
        if not isinstance(error, BrokenPipeError):
            raise OSError(f"standard output: {error.strerror}") from None


def print_note(message: str) -> None:
    """Write exactly one line to stderr, if there is one; it has no colours but those of a hostile file."""
    if sys.stderr is None:
        return
    line = _in_short(printable("\\n".join(message.splitlines())).replace("\x1b", "\\x1b"))
    try:
        print(f"sfmcpp: {line}", file=sys.stderr, flush=True)
    except OSError:  # the exit code tells
        discard_output(sys.stderr)


def _in_short(line: str) -> str:
    """The line without the middle of what a message repeats of an argument or a file, however long."""
    line = _LONG_WORD.sub(lambda found: ends_of(found[0], *_OF_WORD), line)
    return ends_of(line, *_OF_LINE)


def print_error(message: object) -> ExitCode:
    """Tell what is wrong with the input or the usage."""
    print_note(f"error: {message}")
    return ExitCode.BAD_INPUT


def print_no_result(message: object) -> ExitCode:
    """Tell why input that was read gave no result."""
    print_note(f"error: {message}")
    return ExitCode.NO_RESULT


def in_words(error: OSError) -> str:
    """A failure of the operating system, with the file that it is about, as other errors name it."""
    if error.filename is None or error.strerror is None:
        return str(error)
    return f"{os.fsdecode(error.filename)}: {error.strerror.lower()}"


def print_interrupted() -> ExitCode:
    """Tell that a stop came before there was anything to keep."""
    print_note("interrupted")
    return ExitCode.INTERRUPTED


def with_exit_code(command: Callable[P, ExitCode]) -> Callable[P, ExitCode]:
    """Turn errors and interrupts of a command into a line on stderr and an exit code."""

    @wraps(command)
    def run(*arguments: P.args, **options: P.kwargs) -> ExitCode:
        try:
            return command(*arguments, **options)
        except InvalidArgument as error:
            from sfmcpp.cli.flags import options_of, with_flags

            return print_error(with_flags(str(error), options_of(command)))
        except SfmcppError as error:
            return print_error(error)
        except KeyboardInterrupt:
            return print_interrupted()
        except MemoryError:
            return print_error("not enough memory")
        except OSError as error:
            return print_error(in_words(error))

    return run


def progress_is_seen() -> bool:
    """Whether stderr, where progress is shown, is a terminal."""
    return sys.stderr is not None and sys.stderr.isatty()


def stderr_console() -> Console:
    """Make the console that progress is shown on."""
    from rich.console import Console

    return Console(file=cast(IO[str], _ForgivingStream(sys.stderr)))


def discard_output(stream: IO[str]) -> None:
    """Send all that follows nowhere: what is still buffered would fail again when the interpreter ends."""
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    except (OSError, ValueError):  # a stream without a file
        return


class _ForgivingStream:
    """A stream that loses what it cannot write."""

    def __init__(self, stream: IO[str]) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        try:
            return self._stream.write(text)
        except OSError:
            discard_output(self._stream)
            return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError:
            discard_output(self._stream)
