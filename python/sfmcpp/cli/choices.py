"""Options with a closed set of values, and values that have a form of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import typer


def one_of(choices: tuple[str, ...]) -> Callable[[str | None], str | None]:
    """Make a check that accepts exactly `choices`, or no choice at all."""

    def check(value: str | None) -> str | None:
        if value is None or value in choices:
            return value
        raise typer.BadParameter(f"{value!r} is unknown; choose one of {', '.join(choices)}")

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
