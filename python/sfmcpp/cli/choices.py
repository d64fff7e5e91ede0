"""Options with a closed set of values, and values that have a form of their own."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import typer

from sfmcpp._core import SolveOption
from sfmcpp.ba.options import OPTIONS

Command = TypeVar("Command", bound=Callable[..., Any])


def one_of(choices: tuple[str, ...]) -> Callable[[str | None], str | None]:
    """Make a check that accepts exactly `choices`, or no choice at all."""

    def check(value: str | None) -> str | None:
        if value is None or value in choices:
            return value
        raise typer.BadParameter(f"{value!r} is unknown; choose one of {', '.join(choices)}")

    return check


def with_solve_options(command: Command) -> Command:
    """Give a command that ends in ``**options`` an option for each of a solve, as the core lists them."""
    own = inspect.signature(command, eval_str=True)
    kept = [p for p in own.parameters.values() if p.kind is not p.VAR_KEYWORD]
    added = [
        inspect.Parameter(
            o.name, inspect.Parameter.KEYWORD_ONLY, default=o.default, annotation=_annotation(o)
        )
        for o in OPTIONS.values()
    ]
    command.__signature__ = own.replace(parameters=[*kept, *added])  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in (*kept, *added)}
    return command


def _annotation(option: SolveOption) -> Any:
    """Type and look of an option on the command line."""
    flag, names = "--" + option.name.replace("_", "-"), tuple(name for name, _ in option.choices)
    if names:
        what = f"{option.description}: {', '.join(names)}."
        return Annotated[str, typer.Option(flag, metavar="NAME", callback=one_of(names), help=what)]
    what, metavar = f"{option.description}.", option.unit.upper() if option.unit else None
    if option.unset:
        return Annotated[
            Any,
            typer.Option(
                flag, metavar=f"{metavar}|{option.unset}", parser=_number_or_text(option), help=what
            ),
        ]
    number = {"int": int, "float": float, "bool": bool}[option.type]
    return Annotated[
        number | None if option.optional else number, typer.Option(flag, metavar=metavar, help=what)
    ]


def _number_or_text(option: SolveOption) -> Callable[[str], float | str]:
    def read(text: str) -> float | str:
        try:
            return text if text == option.unset else float(text)
        except ValueError:
            raise typer.BadParameter(
                f"{text!r} is neither a number of {option.unit} nor {option.unset!r}",
                param_hint=f"'--{option.name.replace('_', '-')}'",
            ) from None

    return read


def refined_intrinsics(text: str | None) -> tuple[str, ...] | None:
    """Names of the intrinsics to refine: "f,k1,k2"; "none" is no name, no text is no wish."""
    if text is None:
        return None
    names = tuple(name.strip() for name in text.split(","))
    if "" in names:
        raise typer.BadParameter(f"{text!r} holds an empty name", param_hint="'--refine'")
    return () if names == ("none",) else names
