"""From arguments to a command: bad usage, missing parts and interrupts become one line and an exit code."""

from __future__ import annotations

import io
import logging
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, redirect_stdout
from typing import Any

from sfmcpp.cli.console import ExitCode, discard_output, in_words, print_error, print_interrupted
from sfmcpp.cli.interrupts import repeated_lost_interrupts, termination_as_ctrl_c
from sfmcpp.cli.mpi_launch import is_said_by_another
from sfmcpp.cli.reading_apart import is_read_apart, solve_as_read_apart
from sfmcpp.cli.slips import likely_meant

# By the kinds of pydantic's errors.
_RULES = {
    "int_parsing": "must be a whole number",
    "int_from_float": "must be a whole number",
    "int_parsing_size": "has too many digits",
    "float_parsing": "must be a number",
    "greater_than_equal": "must be at least {ge}",
    "less_than_equal": "must be at most {le}",
}


def dispatch(given: list[str]) -> int:
    """Run the command that the arguments name; its exit code."""
    _replace_what_cannot_be_encoded()
    # An empty path would mean the current folder to all that follows: an unset variable of a script.
    empty = next((a for a in given if a == "" or (a.startswith("--") and a.endswith("="))), None)
    if empty is not None:
        return _refuse_usage(given, f"argument {empty!r}: its value is empty")
    with redirect_stdout(io.StringIO()) if is_said_by_another(given) else nullcontext():
        if is_read_apart(given):
            return _guarded(lambda: solve_as_read_apart(lambda: _guarded(lambda: _dispatch(given))))
        return _guarded(lambda: _dispatch(given))


def _guarded(task: Callable[[], int]) -> int:
    try:
        with termination_as_ctrl_c(), repeated_lost_interrupts(), _warnings_of_libraries_unsaid():
            return task()
    except ModuleNotFoundError as error:
        return print_error(_how_to_install(error))
    except (ImportError, RuntimeError) as error:  # no memory for it, say
        # Compiled modules make one of the other, and so do, before Python 3.12, classes that are made.
        if isinstance(error.__cause__, KeyboardInterrupt):
            return print_interrupted()
        if isinstance(error, RuntimeError):
            raise
        return print_error(f"a part of the program cannot be loaded: {error}")
    except OSError as error:
        return print_error(in_words(error))
    except KeyboardInterrupt:  # while modules are loaded
        return print_interrupted()


@contextmanager
def _warnings_of_libraries_unsaid() -> Iterator[None]:
    """Leave out what libraries log below an error, which Python prints where nobody asks for it.

    Matplotlib says so that it looks for fonts, once, if that takes longer than five seconds.
    """
    printer = logging.lastResort
    if printer is None:
        yield
        return
    before = printer.level
    printer.setLevel(logging.ERROR)
    try:
        yield
    finally:
        printer.setLevel(before)


def _how_to_install(error: ModuleNotFoundError) -> str:
    """What is missing; what comes with an extra says itself with which one."""
    if not error.msg.startswith("No module named"):
        return error.msg
    return f"{error.name}, which sfmcpp needs, is not installed: pip install sfmcpp installs it"


def _dispatch(arguments: list[str]) -> int:
    import typer
    from typer.main import get_command

    from sfmcpp.cli.app import app

    # Typer may bring its own click; the base of all usage errors is reached without naming either.
    usage_error: type[Exception] = typer.BadParameter.__mro__[1]
    command = get_command(app)
    try:
        result = command(arguments, prog_name="sfmcpp", standalone_mode=False)
    except usage_error as error:
        message = _usage_message(error, arguments, command)
        return print_error(message) if _is_of_a_path(error) else _refuse_usage(arguments, message)
    except typer.Abort:
        return print_interrupted()
    except SystemExit:  # whoever read the help has gone; commands end so themselves
        return ExitCode.DONE
    except OSError as error:  # commands tell their own: typer writes the help
        if error.filename is not None or error.strerror is None:
            raise
        discard_output(sys.stdout)
        raise OSError(f"standard output: {error.strerror}") from None
    # Typer prints nothing on Ctrl-C while it reads arguments; a command has printed its own line.
    if result == ExitCode.INTERRUPTED and not isinstance(result, ExitCode):
        return print_interrupted()
    return int(result or ExitCode.DONE)


def _refuse_usage(arguments: list[str], message: str) -> int:
    """Tell what is wrong with arguments that all processes of a launcher have."""
    return ExitCode.BAD_INPUT if is_said_by_another(arguments) else print_error(message)


def _is_of_a_path(error: Exception) -> bool:
    """Whether a path is at fault: it may be good on the machine of the first process."""
    kind = getattr(getattr(error, "param", None), "type", None)
    return getattr(kind, "name", "") in ("path", "file", "directory")


def _place_of_help(error: Exception, arguments: list[str], program: Any) -> str:
    """The command whose help tells more; an error of an option without its value does not say where it is."""
    context = getattr(error, "ctx", None)
    if context is not None:
        return str(context.command_path)
    return " ".join(["sfmcpp", *(name for name in arguments[:1] if name in program.commands)])


def _usage_message(error: Exception, arguments: list[str], program: Any) -> str:
    meant = likely_meant(error, arguments, program)
    if meant and hasattr(error, "possibilities"):  # options of similar spelling
        error.possibilities = None
    message: str = error.format_message()  # type: ignore[attr-defined]
    for own_words, in_ours in _refused_values(error):
        message = message.replace(own_words, in_ours)
    said = " ".join(message.split()).rstrip(".")
    said += f"; {meant}" if meant else ""
    return f"{said} (see '{_place_of_help(error, arguments, program)} --help')"


def _refused_values(error: Exception) -> Iterator[tuple[str, str]]:
    """What pydantic, with which newer versions of typer read numbers, says of a value, and what we say."""
    complaints = getattr(error.__cause__, "errors", None)
    for found in complaints() if callable(complaints) else ():
        known = _RULES.get(found["type"])
        rule = found["msg"] if known is None else known.format(**found.get("ctx", {}))
        yield found["msg"], f"{found['input']!r}: {rule}"


def _replace_what_cannot_be_encoded() -> None:
    """Print '?' for characters the terminal's encoding lacks, rather than fail."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
