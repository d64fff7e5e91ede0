"""Names and values of options on the command line, for those who do not read it."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any

from sfmcpp._core import SolveOption
from sfmcpp.ba.options import OPTIONS

# What holds the cameras of a rig to each other.
RIGS = ("fixed", "free", "ignore")

# Arguments of functions whose options on the command line have other names.
_OTHER_NAMES = {
    "sigmas": "sensor_sigma",
    "sensor_columns": "sensor_column",
    "clock_offset_s": "clock_offset",
    "num_cameras": "cameras",
    "num_points": "points",
    "share": "outliers",
    "sigma_px": "outlier_sigma_px",
}
_NAMED = re.compile(r"(\w+)(?:\['(\w+)'\])?(:| = )")


def flag_of(name: str) -> str:
    """Option on the command line of a parameter in Python."""
    return "--" + name.replace("_", "-")


def flag(option: SolveOption) -> str:
    """Name of an option of a solve on the command line."""
    return flag_of(option.name.removesuffix("_bytes") if option.unit == "bytes" else option.name)


def as_options(text: str) -> str:
    """A message of a solve, ``name = value: rule``, with options as the command line has them."""
    for option in OPTIONS.values():
        text = re.sub(rf"\b{option.name} = ", f"{flag(option)} ", text)
    return text


def by_flags(message: str, command: Callable[..., Any]) -> str:
    """A message ``name = value: rule`` or ``name: rule`` with the option of `command` that has this name."""
    named = _NAMED.match(message)
    name = named and _OTHER_NAMES.get(named[1], named[1])
    parameter = inspect.signature(command, eval_str=True).parameters.get(name or "")
    if not named or parameter is None or not _is_option(parameter):
        return message
    option, key, rest = flag_of(parameter.name), named[2], message[named.end() :]
    if named[3] == ":":
        return f"{option}:{rest}"
    return f"{option} {key}={rest}" if key else f"{option} {rest}"


def _is_option(parameter: inspect.Parameter) -> bool:
    """Whether it is given by name on the command line, and not by its place."""
    from typer.models import OptionInfo

    return any(isinstance(what, OptionInfo) for what in getattr(parameter.annotation, "__metadata__", ()))
