"""Names and values of options on the command line, for those who do not read it."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Container
from typing import Any

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
_NAMED = re.compile(r"\b(\w+)(?:\['(\w+)'\])? = |^(\w+): ")


def flag_of(name: str) -> str:
    """Option on the command line of a parameter in Python; numbers of bytes are given there with a unit."""
    return "--" + name.removesuffix("_bytes").replace("_", "-")


def with_flags(message: str, options: Container[str]) -> str:
    """A message ``name = value: rule`` or ``name: rule`` with those of the `options` as they are given."""

    def given(found: re.Match[str]) -> str:
        argument, key, alone = found.groups()
        name = _OTHER_NAMES.get(argument or alone, argument or alone)
        if name not in options:
            return found[0]
        return flag_of(name) + (": " if alone else f" {key}=" if key else " ")

    return _NAMED.sub(given, message)


def options_of(command: Callable[..., Any]) -> set[str]:
    """Parameters of a command that are given by name on the command line, and not by their place."""
    from typer.models import OptionInfo

    parameters = inspect.signature(command, eval_str=True).parameters.values()
    return {
        parameter.name
        for parameter in parameters
        if any(isinstance(what, OptionInfo) for what in getattr(parameter.annotation, "__metadata__", ()))
    }
