"""Types of command line options: closed sets of values, and values with a format of their own."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from sfmcpp._core import SolveOption
from sfmcpp.ba.options import signature_with_options
from sfmcpp.cli.flags import flag_of

Command = TypeVar("Command", bound=Callable[..., Any])

OutputFolder = Annotated[
    Path, typer.Option("-o", "--output", metavar="DIR", help="Output folder, created if missing.")
]
Quiet = Annotated[bool, typer.Option("--quiet", help="Print only errors.")]
Checkpoint = Annotated[
    Path | None,
    typer.Option(metavar="DIR", help="Folder to save checkpoints in, to resume from later."),
]
CheckpointEvery = Annotated[float, typer.Option(metavar="SECONDS", min=0.0, help="Time between checkpoints.")]
GpsSource = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.csv|FOLDER",
        help="Align to camera positions and adjust with them. Columns: name or index; lat, lon, height "
        "or x, y, z; sigma_x, sigma_y, sigma_z if known. A folder: positions in the EXIF of photos.",
    ),
]
ControlFile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Align to ground control points and adjust with them. Columns: name; x, y, z or lat, lon, "
        "height; image, u, v; sigma, check if known. Or a gcp_list.txt of OpenDroneMap.",
    ),
]
ControlSigma = Annotated[
    float,
    typer.Option(metavar="M", help="Standard deviation of control points whose file states none.", min=1e-6),
]
Resume = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR", help="Resume from the newest checkpoint in a folder; same input and options required."
    ),
]


def one_of(choices: tuple[str, ...]) -> Callable[[str | None], str | None]:
    """Make a check that accepts exactly `choices`, or no choice at all."""

    def check(value: str | None) -> str | None:
        if value is None or value in choices:
            return value
        raise typer.BadParameter(f"{value!r} is unknown; choose one of {', '.join(choices)}")

    return check


def look_of_names(names: tuple[str, ...], metavar: str = "NAME") -> dict[str, Any]:
    """Keywords of an option or argument that takes one of the names: display, check and completion."""
    return {"metavar": metavar, "callback": one_of(names), "autocompletion": completion_of(names)}


def completion_of(names: tuple[str, ...]) -> Callable[[str], list[str]]:
    """What a shell is told of the names: those that begin as what is typed does."""

    def complete(incomplete: str) -> list[str]:
        return [name for name in names if name.startswith(incomplete)]

    return complete


def choice_option(names: tuple[str, ...], text: str, more: str = "") -> Any:
    """Make an option that takes one of the names; `more` of them follows their list."""
    return typer.Option(help=f"{text}: {', '.join(names)}{more}.", **look_of_names(names))


def with_solve_options(command: Command) -> Command:
    """Give a command that ends in ``**options`` an option for each of a solve, as the core lists them."""
    signature = signature_with_options(inspect.signature(command, eval_str=True), _annotation)
    command.__signature__ = signature  # type: ignore[attr-defined]
    command.__annotations__ = {p.name: p.annotation for p in signature.parameters.values()}
    return command


def _annotation(option: SolveOption) -> Any:
    """Type and look of an option on the command line."""
    names = tuple(name for name, _ in option.choices)
    type_: Any = {"str": str, "int": int, "float": float, "bool": bool}[option.type]
    rule = f"; must be {option.rule}" if option.rule else ""
    look: dict[str, Any] = {"help": f"{option.description}{': ' * bool(names)}{', '.join(names)}{rule}."}
    if names:
        look |= look_of_names(names)
    if option.unit:
        look["metavar"] = option.unit.upper() + (f"|{option.unset}" if option.unset else "")
    if option.unset:
        type_, look["parser"] = Any, _number_or_text(option)
    elif option.optional:
        type_ = type_ | None
    if option.unit == "bytes":
        type_, look["parser"], look["metavar"] = Any, _number_of_bytes, "8GB|500MB|…"
    return Annotated[type_, typer.Option(flag_of(option.name), **look)]


# A number without a unit below this is meant in another unit: no solve needs as little.
_LEAST_BYTES = 10**6
_BYTES = {"": 1, "B": 1}
for _power, _prefix in enumerate("KMGT", start=1):
    _BYTES |= {
        _prefix: 10 ** (3 * _power),
        f"{_prefix}B": 10 ** (3 * _power),
        f"{_prefix}IB": 2 ** (10 * _power),
    }


def _number_of_bytes(text: str) -> float:
    match = re.fullmatch(r"\s*([0-9.eE+]+)\s*([A-Za-z]*)\s*", text)
    number, unit = match.groups() if match else ("", "")
    try:
        count = float(number) * _BYTES[unit.upper()]
    except (ValueError, KeyError):
        raise typer.BadParameter(f"{text!r} is no number of bytes, such as 8GB, 500MB or 2GiB") from None
    if not unit and count < _LEAST_BYTES:
        raise typer.BadParameter(f"{text!r} has no unit, and means bytes: write {text}GB or {text}MB")
    return count


def _number_or_text(option: SolveOption) -> Callable[[str], float | str]:
    def read(text: str) -> float | str:
        try:
            return text if text == option.unset else float(text)
        except ValueError:
            raise typer.BadParameter(
                f"{text!r} is neither a number of {option.unit} nor {option.unset!r}",
                param_hint=f"'{flag_of(option.name)}'",
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
