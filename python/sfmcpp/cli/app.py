"""The program: its commands, each in the module of its name."""

from __future__ import annotations

from collections import UserDict
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

import sfmcpp
from sfmcpp.cli.console import print_result

COMMANDS = {
    "solve": "Adjust cameras, intrinsics and points of a problem.",
    "convert": "Convert a problem or a trajectory to another format.",
    "demo": "Solve and show a synthetic scene.",
    "info": "What is in a file or a folder, in a few lines.",
    "doctor": "Find what explains a bad result, and what to do.",
    "synth": "Generate a synthetic problem with known truth.",
    "evaluate": "Evaluate a model or a trajectory against ground truth.",
    "slam": "Trajectory and map from a camera and other sensors.",
    "bag": "Make files for slam of a ROS bag, or list its topics.",
    "reconstruct": "Cameras and points from photos or tracks.",
    "undistort": "Write the photos of a model without distortion, and their model.",
}

_LOOK: dict[str, Any] = {
    "pretty_exceptions_enable": False,
    # Plain help: the rich one takes longer to import than the rest of the command line.
    "rich_markup_mode": None,
    "context_settings": {"help_option_names": ["-h", "--help"]},
}


class _LoadedWhenUsed(UserDict[str, Any]):
    """Commands by their names: modules of one are loaded, and not of all, which takes half a second."""

    def __getitem__(self, name: str) -> Any:
        if name not in self.data:
            raise KeyError(name)
        program = typer.Typer(add_completion=False, **_LOOK)
        program.command(name)(function_of(name))
        return get_command(program)


class _Program(TyperGroup):
    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _LoadedWhenUsed(COMMANDS)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        del ctx
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


app = typer.Typer(cls=_Program, help="Bundle adjustment, structure from motion and visual SLAM.", **_LOOK)


def function_of(command: str) -> Any:
    """The function that does a command."""
    return getattr(import_module(f"sfmcpp.cli.{command}"), command)


def _print_version(wanted: bool) -> None:
    if wanted:
        print_result(f"sfmcpp {sfmcpp.__version__}")
        raise typer.Exit


@app.callback()
def _options_of_all(
    version: Annotated[
        bool,
        typer.Option("--version", "-V", is_eager=True, callback=_print_version, help="Print the version."),
    ] = False,
) -> None:
    pass
