"""Which experiments there are: one TOML file each."""

from __future__ import annotations

from experiments.description import FOLDER, METHODS_FILE, load


def names() -> list[str]:
    """Names of all experiments, sorted."""
    return sorted(path.stem for path in FOLDER.glob("*.toml") if path != METHODS_FILE)


def titles() -> dict[str, str]:
    """Names and titles of all experiments."""
    return {name: load(name).title for name in names()}


def other_names() -> dict[str, str]:
    """Further names, and the experiment that each stands for."""
    return {other: name for name in names() for other in load(name).also}
