"""What a user most likely meant with arguments that were refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def likely_meant(error: Exception, arguments: list[str], program: Any) -> str:
    """What to change in the command, in a few words.

    Parameters
    ----------
    error : Exception
        A usage error of the library that reads the arguments.
    arguments : list of str
        The command, without the name of the program.
    program : Any
        The group of all commands.

    Returns
    -------
    str
        Empty where nothing better than the error can be said.
    """
    context = getattr(error, "ctx", None)
    if context is None:
        return ""
    option = getattr(error, "option_name", None)
    if context.command is program:
        return _option_too_early(option, program) if option else _path_as_command(arguments)
    if option:
        return _one_hyphen(arguments, _names_of_options(context.command))
    if "unexpected extra argument" in str(error) and "--output" in _names_of_options(context.command):
        return "an output is given by its option: -o PATH"
    return ""


def _option_too_early(option: str, program: Any) -> str:
    """An option of a command before the command, or the command with hyphens."""
    if option.lstrip("-") in program.commands:
        return f"commands have no hyphens: {option.lstrip('-')}"
    having = [name for name, command in program.commands.items() if option in _names_of_options(command)]
    return "options come after the name of a command" if having else ""


def _path_as_command(arguments: list[str]) -> str:
    """The input where the command should be."""
    path = next((each for each in arguments if not each.startswith("-")), "")
    return f"a command comes before the input, such as 'sfmcpp info {path}'" if _is_there(path) else ""


def _one_hyphen(arguments: list[str], known: set[str]) -> str:
    """A long option with one hyphen, which is read as several of one letter."""
    words = (each.partition("=")[0] for each in arguments)
    long = next((f"-{each}" for each in words if not each.startswith("--") and f"-{each}" in known), None)
    return f"did you mean {long}?" if long else ""


def _is_there(path: str) -> bool:
    try:
        return bool(path) and Path(path).exists()
    except OSError:  # longer than a name can be
        return False


def _names_of_options(command: Any) -> set[str]:
    return {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
