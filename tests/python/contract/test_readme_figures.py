"""Figures that the README repeats are those of the pages that tell how they were measured."""

from __future__ import annotations

import re
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[3]


def text_of(page: str) -> str:
    return (REPOSITORY / page).read_text(encoding="utf-8")


def row(page: str, name: str, column: str) -> list[str]:
    """The cells after its name of the first row so called of the first table with that column."""
    tables = [
        block for block in text_of(page).split("\n\n") if re.search(rf"^\|.*\| {column} \|", block, re.M)
    ]
    lines = re.findall(rf"^\| {re.escape(name)} \|(.*)\|$", tables[0], re.M)
    return [cell.strip(" *") for cell in lines[0].split("|")]


def test_errors_on_drives_are_those_of_the_page_of_drives() -> None:
    names = {
        "alone": "none",
        "odometer": "odometer",
        "gyro": "gyroscope",
        "odometer + gyro": "both",
        "dead reckoning (no camera)": "dead reckoning",
    }
    for here, there in names.items():
        assert row("README.md", here, "0095") == row("docs/drives.md", there, "0095"), here


def test_times_of_a_problem_are_those_of_the_benchmarks() -> None:
    ours, ceres, *_ = row("README.md", "BAL problem-49-7776", "Ceres 2.1")
    measured, ratio, *_ = row("docs/benchmarks.md", "problem-49-7776", "Ceres' best")
    ours_ms = float(measured.split()[0])
    assert float(ours) == round(ours_ms)
    assert abs(float(ceres) / ours_ms - float(ratio)) < 0.1
    told = re.search(r"sfmcpp ([\d.]+) ms, Ceres ([\d.]+) ms", text_of("README.md"))
    assert told is not None
    assert told.groups() == (ours, ceres)


def test_seconds_of_cities_are_those_of_the_benchmarks() -> None:
    told = re.search(
        r"on synthetic cities of ([\d,]+),\s+([\d,]+) and ([\d,]+) cameras: (.*)\.", text_of("README.md")
    )
    assert told is not None
    for cameras, seconds in zip(told.groups()[:3], re.split(", | and ", told[4]), strict=True):
        measured = re.search(rf"^\| {cameras}, [\d.]+ M \| ([\d.]+) s", text_of("docs/benchmarks.md"), re.M)
        assert measured is not None
        assert abs(float(measured[1]) - float(seconds)) <= max(0.05, 0.005 * float(measured[1]))
