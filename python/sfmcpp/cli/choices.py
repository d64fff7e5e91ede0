"""Options with a closed set of values, and values that have a form of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import typer

# Part of the contract, not there yet; as soon as the core knows a name, it is accepted.
PLANNED = {
    "dog-leg",
    "gradient-descent",
    "alternation",
    "g-als",
    "t-als",
    "exact",
    "soft",
    "backtracking",
}
LINE_SEARCHES = ("none",)


def one_of(choices: tuple[str, ...]) -> Callable[[str], str]:
    """Make a check that accepts exactly `choices`, and tells planned names from unknown ones."""

    def check(value: str) -> str:
        if value in choices:
            return value
        what = "is not available yet" if value in PLANNED else "is unknown"
        raise typer.BadParameter(f"{value!r} {what}; choose one of {', '.join(choices)}")

    return check


def loss_scale(text: str) -> float | Literal["auto"]:
    """Read a scale in pixels, or "auto"."""
    if text == "auto":
        return "auto"
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is neither a number of pixels nor 'auto'", param_hint="'--loss-scale-px'"
        ) from None


def refined_intrinsics(text: str | None) -> tuple[str, ...] | None:
    """Names of the intrinsics to refine: "f,k1,k2"; "none" is no name, no text is no wish."""
    if text is None:
        return None
    names = tuple(name.strip() for name in text.split(","))
    if "" in names:
        raise typer.BadParameter(f"{text!r} holds an empty name", param_hint="'--refine'")
    return () if names == ("none",) else names
