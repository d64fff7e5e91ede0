"""Names of drives on the command lines of benchmarks: known ones are taken, others told which there are."""

from __future__ import annotations

import importlib
from argparse import ArgumentTypeError
from collections.abc import Callable
from pathlib import Path

import pytest

BENCH = Path(__file__).resolve().parents[3] / "bench"


@pytest.fixture
def drive_name(monkeypatch: pytest.MonkeyPatch, data_dir: Path) -> Callable[[str], str]:
    monkeypatch.syspath_prepend(str(BENCH))
    monkeypatch.setenv("SFMCPP_DATA", str(data_dir))
    found: Callable[[str], str] = importlib.import_module("experiments.drive_names").drive_name
    return found


@pytest.mark.parametrize(
    "name",
    [
        "tuning",
        "0036",
        "0036:2/2",
        "0036:1/4@noisy",
        "clip",
        "simulated/u-turn",
        "simulated/motorway, a car ahead",
        "simulated/usual, late streams",
    ],
)
def test_known_names_are_taken_as_they_are(name: str, drive_name: Callable[[str], str]) -> None:
    assert drive_name(name) == name


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("simulated/nowhere", "course = 'nowhere': must be one of usual, stands first, "),
        ("simulated/usual, upside down", "change = 'upside down': must be one of late streams, "),
        ("0037", "drive = '0037': must be one of tuning, reporting, all, 0001, "),
        ("0036@sideways", "change = 'sideways': must be one of stops, backwards, "),
        ("0036:3/2", "part = '3/2': must be k/n with k from 1 to n"),
    ],
)
def test_unknown_names_are_told_those_that_there_are(
    name: str, told: str, drive_name: Callable[[str], str]
) -> None:
    with pytest.raises(ArgumentTypeError) as failure:
        drive_name(name)
    assert str(failure.value).startswith(f"{name}: {told}")
