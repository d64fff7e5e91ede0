"""Experiments as their TOML files describe them, and which there are."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # type: ignore[import-not-found,unused-ignore]

Row = dict[str, Any]

FOLDER = Path(__file__).resolve().parent
METHODS_FILE = FOLDER / "methods.toml"


class ExperimentError(Exception):
    """What keeps an experiment from running, in one line."""


@dataclass(frozen=True)
class Experiment:
    """What to run, and what the thesis found.

    Attributes
    ----------
    name, title : str
        Of the TOML file, and what it shows.
    also : list of str
        Further tables and figures of the thesis that it holds: other names for it.
    kind : str
        Which function of `KINDS` runs it.
    seed, runs : int
        First seed, and how many seeds each setting is run with.
    methods : list of str
        Labels of `methods.toml`.
    camera_models : list of str
        What synthetic scenes are solved as: "projective", or "own" for that of the scene.
    scene : dict
        `kind` and arguments of one of ``sfmcpp.SCENES``.
    noise : list of dict
        Arguments of ``sfmcpp.perturb``, one after the other.
    files, projective_files : list of str
        Real problems, relative to the folder of real data; to solve as they are, and as projective.
    options : dict
        Options of ``sfmcpp.solve`` for all methods.
    settings : dict
        What only this kind of experiment has.
    thesis : list of dict
        Rows to print beside ours.
    """

    name: str
    title: str
    kind: str
    also: list[str] = field(default_factory=list)
    seed: int = 0
    runs: int = 1
    methods: list[str] = field(default_factory=list)
    camera_models: list[str] = field(default_factory=lambda: ["own"])
    scene: Row = field(default_factory=dict)
    noise: list[Row] = field(default_factory=list)
    files: list[str] = field(default_factory=list)
    projective_files: list[str] = field(default_factory=list)
    options: Row = field(default_factory=dict)
    settings: Row = field(default_factory=dict)
    thesis: list[Row] = field(default_factory=list)

    @property
    def seeds(self) -> range:
        """One seed per run."""
        return range(self.seed, self.seed + self.runs)

    def solve_options(self) -> dict[str, Row]:
        """Options of each method by its label, those for all included."""
        catalogue = _read(METHODS_FILE)
        return {label: {**self.options, **catalogue[label]} for label in self.methods}


def load(name: str, runs: int | None = None) -> Experiment:
    """Load an experiment by name, with another number of runs if given."""
    experiment = Experiment(name=name, **_read(FOLDER / f"{name}.toml"))
    return experiment if runs is None else replace(experiment, runs=runs)


def names() -> list[str]:
    """Names of all experiments, sorted."""
    return sorted(path.stem for path in FOLDER.glob("*.toml") if path != METHODS_FILE)


def titles() -> dict[str, str]:
    """Names and titles of all experiments."""
    return {name: load(name).title for name in names()}


def other_names() -> dict[str, str]:
    """Further names, and the experiment that each stands for."""
    return {other: name for name in names() for other in load(name).also}


def _read(path: Path) -> Row:
    content: Row = tomllib.loads(path.read_text(encoding="utf-8"))
    return content
