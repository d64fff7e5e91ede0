"""Every name that the core knows can be said in Python and on the command line, and is described."""

from __future__ import annotations

import inspect
import os
import re
import subprocess
import sys
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.models import OptionInfo
from typer.testing import CliRunner

import sfmcpp
import sfmcpp.cli.run
from sfmcpp import CAMERA_MODELS, CONSTRAINT_KINDS, ConstraintGroup, SolveOptions, _core
from sfmcpp.ba.options import OPTIONS, choices
from sfmcpp.cli.app import COMMANDS, app, function_of
from sfmcpp.cli.console import ExitCode
from sfmcpp.cli.mpi_launch import ALONE
from sfmcpp.model import names
from sfmcpp.weighting import POSE_METHODS, PROBLEM_METHODS, selection_method

CHOICES = [(option.name, choice) for option in OPTIONS.values() for choice, _ in option.choices]
VALUES: dict[type, Any] = {int: 7, float: 0.25, bool: True}
SAMPLES = [(name, "auto" if o.unset else VALUES[type_]) for name, o in OPTIONS.items()
           for type_ in VALUES if o.type == type_.__name__]  # fmt: skip


LITERALS = {
    names.CameraModelName: tuple(CAMERA_MODELS),
    names.ConstraintKindName: tuple(CONSTRAINT_KINDS),
    **{alias: choices(option) for alias, option in [
        (names.Method, "method"), (names.LineSearch, "line_search"), (names.LinearSolver, "linear_solver"),
        (names.Loss, "loss"), (names.Gauge, "gauge")]},
}  # fmt: skip


def help_of(command: str) -> str:
    """What ``sfmcpp COMMAND --help`` prints, without line breaks, of which some are at hyphens."""
    output = CliRunner().invoke(app, [command, "--help"]).output
    return " ".join(re.sub(r"(?<=[^\s-]-)\n\s+", "", output).split())


def flag(option: str) -> str:
    """Its name on the command line, where numbers of bytes have their unit behind them: 8GB."""
    return "--" + option.removesuffix("_bytes").replace("_", "-")


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Options that reach the solve of the command line, which is not run."""
    found: dict[str, Any] = {}

    def note(job: sfmcpp.cli.run.Job) -> ExitCode:
        found.update(job.options)
        return ExitCode.DONE

    monkeypatch.setattr(sfmcpp.cli.run, "solve_file", note)
    return found


def test_commands_are_done_by_each_process_of_a_launcher_or_by_all_together() -> None:
    assert set(COMMANDS) - set(ALONE) == {"solve", "convert", "demo"}
    assert set(ALONE) < set(COMMANDS)


@pytest.mark.parametrize("command", COMMANDS)
def test_the_list_of_commands_says_what_the_help_of_each_begins_with(command: str) -> None:
    assert (inspect.getdoc(function_of(command)) or "").split("\n")[0] == COMMANDS[command]


def test_the_tables_are_not_empty() -> None:
    assert len(CONSTRAINT_KINDS) == len(_core.CONSTRAINT_KINDS) > 10
    assert len(CHOICES) > 20
    assert len(SAMPLES) + len({name for name, _ in CHOICES}) == len(OPTIONS)


@pytest.mark.parametrize(("option", "choice"), CHOICES)
def test_every_choice_is_taken_by_python_and_by_the_command_line(
    option: str, choice: str, asked: dict[str, Any]
) -> None:
    assert getattr(SolveOptions(**{option: choice}), option) == choice
    result = CliRunner().invoke(app, ["solve", "input.txt", flag(option), choice])
    assert result.output == ""
    assert asked[option] == choice


@pytest.mark.parametrize(("option", "choice"), CHOICES)
def test_every_choice_is_described(option: str, choice: str) -> None:
    meaning = dict(OPTIONS[option].choices)[choice]
    assert meaning
    assert f'- "{choice}": {meaning}.' in (sfmcpp.solve.__doc__ or "")
    listed = help_of("solve").split(f"{flag(option)} ")[1].split(" --")[0]
    assert choice in listed.replace(",", " ").replace(".", " ").split()


@pytest.mark.parametrize(("option", "value"), SAMPLES)
def test_every_other_option_is_taken_by_python_and_by_the_command_line(
    option: str, value: object, asked: dict[str, Any]
) -> None:
    assert getattr(SolveOptions(**{option: value}), option) == value
    unit = "B" if option == "max_memory_bytes" else ""
    words = [flag(option)] if value is True else [flag(option), f"{value}{unit}"]
    result = CliRunner().invoke(app, ["solve", "input.txt", *words])
    assert result.output == ""
    assert asked[option] == value


def test_the_command_line_and_solve_have_the_defaults_of_the_core(asked: dict[str, Any]) -> None:
    CliRunner().invoke(app, ["solve", "input.txt"])
    core = _core.SolveOptions()
    defaults = {name: getattr(core, name) for name in OPTIONS}
    assert asked == defaults
    parameters = inspect.signature(sfmcpp.solve).parameters
    assert {name: parameters[name].default for name in OPTIONS} == defaults


@pytest.mark.parametrize("option", OPTIONS)
def test_every_option_is_described(option: str) -> None:
    assert f"\n    {option} : " in (sfmcpp.solve.__doc__ or "")
    assert flag(option) in help_of("solve")


def numbers_asked() -> Iterator[tuple[str, str, OptionInfo]]:
    """Command, parameter and what is told of it, of all options that are one number."""
    for command in COMMANDS:
        for name, parameter in inspect.signature(function_of(command), eval_str=True).parameters.items():
            type_, *told = typing.get_args(parameter.annotation)
            if {int, float} & {type_, *typing.get_args(type_)} and isinstance(told[0], OptionInfo):
                yield command, name, told[0]


@pytest.mark.parametrize(("command", "name", "told"), list(numbers_asked()))
def test_every_number_of_the_command_line_says_what_it_must_be(
    command: str, name: str, told: OptionInfo
) -> None:
    says = re.search(r"at least \d|positive|in [\[(]0, 1|also negative", told.help or "")
    assert told.min is not None or says, told.help


def test_numbers_of_all_commands_are_looked_at() -> None:
    asked = {(command, name) for command, name, _ in numbers_asked()}
    assert {("solve", "max_iterations"), ("solve", "gcp_sigma_m"), ("slam", "window")} < asked
    assert len({command for command, _ in asked}) == 7


@pytest.mark.parametrize("name", [name for name, option in OPTIONS.items() if option.rule])
def test_every_number_of_a_solve_says_what_it_must_be(name: str) -> None:
    rule = f"; must be {OPTIONS[name].rule}."
    assert rule in help_of("solve").split(f"{flag(name)} ")[1].split(" --")[0]
    assert rule in (sfmcpp.solve.__doc__ or "").split(f"\n    {name} : ")[1].splitlines()[1]
    below = -1 if OPTIONS[name].type == "int" else -1.0
    with pytest.raises(sfmcpp.InvalidArgument, match=f"must be {re.escape(OPTIONS[name].rule or '')}"):
        sfmcpp.solve(sfmcpp.circle_scene(4, 20, seed=1), **{name: below})


def test_every_number_of_a_solve_has_a_rule() -> None:
    numbers = {name for name, option in OPTIONS.items() if option.type in ("int", "float")}
    assert {name for name, option in OPTIONS.items() if option.rule} == numbers


@pytest.mark.parametrize(
    ("text", "bytes_"), [("8GB", 8e9), ("1.5 MiB", 1.5 * 2**20), ("2G", 2e9), ("3000000", 3e6), ("1KB", 1e3)]
)
def test_memory_is_given_in_the_units_that_people_use(
    text: str, bytes_: float, asked: dict[str, Any]
) -> None:
    assert CliRunner().invoke(app, ["solve", "input.txt", "--max-memory", text]).output == ""
    assert asked["max_memory_bytes"] == bytes_


@pytest.mark.parametrize("text", ["8Gx", "lots", "1.2.3MB", "-1GB"])
def test_a_number_of_bytes_is_none(text: str) -> None:
    result = CliRunner().invoke(app, ["solve", "input.txt", "--max-memory", text])
    assert result.exit_code == 2
    assert "8GB, 500MB" in " ".join(result.output.split())


@pytest.mark.parametrize("text", ["8", "0", "512"])
def test_few_bytes_without_a_unit_are_asked_for_one(text: str) -> None:
    result = CliRunner().invoke(app, ["solve", "input.txt", "--max-memory", text])
    assert result.exit_code == 2
    told = f"'{text}' has no unit, and means bytes: write {text}GB or {text}MB"
    assert told in re.sub(r"[\s│]+", " ", result.output)


def test_a_number_or_auto_is_neither_on_the_command_line() -> None:
    result = CliRunner().invoke(app, ["solve", "input.txt", "--loss-scale-px", "wide"])
    assert result.exit_code == ExitCode.BAD_INPUT
    assert "'wide' is neither a number of pixels nor 'auto'" in " ".join(result.output.split())


@pytest.mark.parametrize("kind", [kind.name for kind in _core.CONSTRAINT_KINDS])
def test_every_kind_of_constraint_is_taken_by_a_solve_and_described(kind: str) -> None:
    facts = CONSTRAINT_KINDS[kind]
    empty = ConstraintGroup(kind, [], None if facts.values is None else np.zeros((0, *facts.values)))
    problem = sfmcpp.circle_scene(4, 20, camera_model="perspective", seed=1)
    summary = sfmcpp.solve(problem, constraints=[empty], max_iterations=0)
    assert summary.constraint_costs == {kind: (0.0, 0.0)}
    row = next(line for line in (ConstraintGroup.__doc__ or "").splitlines() if line.split()[:1] == [kind])
    assert facts.error in row
    assert row.endswith(facts.frame)


@pytest.mark.parametrize("method", PROBLEM_METHODS)
def test_every_way_to_weigh_groups_is_taken_by_solve_and_described(method: str) -> None:
    problem = sfmcpp.circle_scene(5, 30, camera_model="calibrated", seed=1)
    noise = np.random.default_rng(1).normal(0, 0.1, (5, 3))
    gps = ConstraintGroup("position", np.arange(5), problem.centres + noise)
    summary = sfmcpp.solve(problem, constraints=[gps], weight=method)
    assert summary.group_weights[0].name == gps.name
    assert f'"{method}"' in (sfmcpp.solve.__doc__ or "")


@pytest.mark.parametrize("method", POSE_METHODS)
def test_every_way_to_weigh_a_sensor_is_listed_by_the_command_line(method: str) -> None:
    assert selection_method(method.replace("λ", "2"))
    assert method in help_of("slam").split("--weights")[1].split(" --")[0]


@pytest.mark.parametrize(("alias", "known"), LITERALS.items())
def test_names_for_editors_are_those_of_the_core(alias: Any, known: tuple[str, ...]) -> None:
    assert typing.get_args(alias) == known


@pytest.mark.parametrize("option", [option for option in OPTIONS if choices(option)])
def test_editors_are_told_the_names_that_an_option_of_solve_takes(option: str) -> None:
    stub = Path(sfmcpp.__file__).with_name("_core.pyi").read_text()
    keywords = stub.split("class SolveKeywords")[1]
    names = f"    {option}: typing.Literal[{', '.join(map(repr, choices(option)))}]"
    assert names in keywords


@pytest.mark.parametrize(
    ("words", "completed"),
    [
        ("rec", ["reconstruct"]),
        ("solve --line-search-d", ["--line-search-damping"]),
        ("solve --method lm", ["lm", "lm-nielsen"]),
        ("slam --corners ha", ["harris"]),
        ("slam --sensor od", ["odometer"]),
        ("solve --camera-model p", ["projective"]),
        ("synth --camera-model p", ["perspective"]),
    ],
)
def test_shells_complete_commands_options_and_names(words: str, completed: list[str]) -> None:
    place = {"COMP_WORDS": f"sfmcpp {words}", "COMP_CWORD": str(len(words.split()))}
    asked = {**os.environ, **place, "_SFMCPP_COMPLETE": "complete_bash"}
    command = [sys.executable, "-m", "sfmcpp"]
    told = subprocess.run(command, env=asked, capture_output=True, text=True, check=False)
    assert told.stdout.split() == completed, told.stderr


@pytest.mark.parametrize("model", [model.name for model in _core.CAMERA_MODELS])
def test_every_camera_model_is_known_to_python_and_to_the_command_line(model: str) -> None:
    assert model in (sfmcpp.CameraModel.__doc__ or "")
    assert CAMERA_MODELS[model].name == model
    assert model in help_of("synth") + help_of("solve")
