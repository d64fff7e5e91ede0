"""Names of drives on the command lines of benchmarks: which there are, and what a wrong one is told."""

from __future__ import annotations

import re
from argparse import ArgumentTypeError
from collections.abc import Collection

from experiments.altered_drives import ALTERED
from experiments.other_motions import CHANGES, COURSES
from experiments.real_problems import data_folder

SIMULATED, CLIP = "simulated/", "clip"
# What stands for several drives.
GROUPS = ("tuning", "reporting", "all")


def drive_name(text: str) -> str:
    """A name that `real_drives.read` knows, or a group, as it is; for ``type=`` of argparse.

    Raises
    ------
    ArgumentTypeError
        If there is no such drive, part, change, course or group; it lists those that there are.
    """
    if text in GROUPS:
        return text
    if text.startswith(SIMULATED):
        return _simulated(text)
    whole, at, change = text.partition("@")
    number, colon, part = whole.partition(":")
    _require("drive", text, number, [*GROUPS, *_numbers(), CLIP, f"{SIMULATED}…"])
    if at:
        _require("change", text, change, ALTERED)
    if colon and not _is_part(part):
        raise ArgumentTypeError(f"{text}: part = {part!r}: must be k/n with k from 1 to n")
    return text


def _simulated(text: str) -> str:
    name = text.removeprefix(SIMULATED)
    if name not in COURSES:
        course, comma, change = name.rpartition(", ")
        _require("course", text, course if comma else name, COURSES)
        _require("change", text, change, CHANGES)
    return text


def _numbers() -> list[str]:
    """Numbers of the recorded drives."""
    files = sorted((data_folder() / "kitti_tracks").glob("*_drive_*_*.mat"))
    return [file.name.partition("_drive_")[2].partition("_")[0] for file in files]


def _is_part(text: str) -> bool:
    found = re.fullmatch(r"(\d+)/(\d+)", text)
    return found is not None and 1 <= int(found[1]) <= int(found[2])


def _require(what: str, text: str, name: str, known: Collection[str]) -> None:
    if name not in known:
        listed = ", ".join(f'"{one}"' if "," in one else one for one in known)
        raise ArgumentTypeError(f"{text}: {what} = {name!r}: must be one of {listed}")
