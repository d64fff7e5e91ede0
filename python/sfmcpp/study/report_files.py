"""`report.json`: what a run did, as plain values for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.files import failures_named

# Of a run, in its folder: the folder of its model, what it did, its points and its page with a view of them.
MODEL, REPORT, POINTS, VIEW = "model", "report.json", "points.ply", "view.html"
UNFINISHED = "UNFINISHED"
_UNFINISHED_TEXT = (
    "The files of a run are being written; if the run has ended, some are missing or from an earlier run.\n"
)

# A file or folder by its name, and what writes it there.
Step = tuple[str, Callable[[Path], None]]


def write_steps(steps: Iterable[Step], folder: Path) -> list[Path]:
    """Write the files of a run into a folder, made if missing, and go on where one fails.

    As long as not all are written, a file `UNFINISHED` says so.

    Raises
    ------
    DatasetError
        If any could not be written: the others are.
    """
    with failures_named(folder):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / UNFINISHED).write_text(_UNFINISHED_TEXT)
    written: list[Path] = []
    complaints: list[DatasetError] = []
    for name, step in steps:
        try:
            step(folder / name)
            written.append(folder / name)
        except DatasetError as error:
            complaints.append(error)
    if complaints:
        first, *others = complaints
        raise DatasetError(first.path, "; ".join([first.reason, *map(str, others)]), first.line)
    with failures_named(folder):
        (folder / UNFINISHED).unlink()
    return written


def write_report(report: dict[str, Any], path: Path) -> None:
    """Write a report as JSON, made of plain values; the file appears complete or not at all.

    Raises
    ------
    DatasetError
        If the file cannot be written.
    """
    text = json.dumps(plain(report), indent=1, allow_nan=False)
    with atomic_files(path) as (stream,):
        stream.write(text.encode() + b"\n")


def plain(value: Any) -> Any:
    """Lists and numbers of all that a report holds; None where one is not finite: JSON has no word for it."""
    if isinstance(value, dict):
        return {str(name): plain(member) for name, member in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(member) for member in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
