"""Names and values of options on the command line, for those who do not read it."""

from __future__ import annotations

import re

from sfmcpp._core import SolveOption
from sfmcpp.ba.options import OPTIONS

# What holds the cameras of a rig to each other.
RIGS = ("fixed", "free", "ignore")


def flag(option: SolveOption) -> str:
    """Name of an option of a solve on the command line."""
    name = option.name.removesuffix("_bytes") if option.unit == "bytes" else option.name
    return "--" + name.replace("_", "-")


def as_options(text: str) -> str:
    """A message of a solve, ``name = value: rule``, with options as the command line has them."""
    for option in OPTIONS.values():
        text = re.sub(rf"\b{option.name} = ", f"{flag(option)} ", text)
    return text
