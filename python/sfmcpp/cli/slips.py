"""What a user most likely meant with arguments that were refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

# What options are called in other programs, without their hyphens.
_OTHER_WORDS = {
    "--camera": "calib calibration camera-params intrinsics k",
    "--fps": "frame-rate framerate rate",
    "--loss": "kernel robust robust-kernel robust-loss robustifier",
    "--mask": "masks mask-path",
    "--masks": "mask mask-path",
    "--matcher": "matching matching-method",
    "--max-iterations": "iterations max-num-iterations num-iterations",
    "--output": "out output-dir output-folder output-path out-dir workspace-path",
    "--threads": "j jobs num-cpus num-threads workers",
    "--truth": "ground-truth groundtruth gt ref reference",
    "--view": "gui show viewer visualize",
}
_WORDS_OF_INPUTS = "database-path i image-path images in input input-path video"
_SENSORS = {"gyro": "imu", "gyroscope": "imu", "odometry": "odometer", "wheels": "odometer"}
_SENSORS |= {name: name for name in ("imu", "ins", "gps", "odometer")}


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
        known = _names_of_options(context.command)
        return _one_hyphen(arguments, known) or _other_word(option.lower(), known)
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


def _other_word(option: str, known: set[str]) -> str:
    """An option by the name that it has in another program."""
    word = option.lstrip("-").replace("_", "-")
    if "--sensor" in known and word in _SENSORS:
        return f"did you mean --sensor {_SENSORS[word]}?"
    ours = [name for name, words in _OTHER_WORDS.items() if name in known and word in words.split()]
    if ours:
        return f"did you mean {ours[0]}?"
    return "the input is given without an option" if word in _WORDS_OF_INPUTS.split() else ""


def _is_there(path: str) -> bool:
    try:
        return bool(path) and Path(path).exists()
    except OSError:  # longer than a name can be
        return False


def _names_of_options(command: Any) -> set[str]:
    return {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
