"""`report.json`: what a solve did, for programs."""

from __future__ import annotations

import json
import math
import re
import resource
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from sfmcpp.ba import Summary
from sfmcpp.model import Problem
from sfmcpp.sources.io.atomic import atomic_files


def make_report(path: Path, problem: Problem, summary: Summary, seconds_read: float) -> dict[str, Any]:
    """Build the report of a solve.

    Parameters
    ----------
    path : Path
        The input, as the user named it.
    problem : Problem
        For its size.
    summary : Summary
        What the solve returned; all its fields are in the report under their own names.
    seconds_read : float
        Time spent on reading the input [s].

    Returns
    -------
    dict
        Plain values; what is not finite is None, since JSON has no word for it.
    """
    size = {
        "path": str(path),
        "cameras": problem.num_cameras,
        "points": problem.num_points,
        "observations": problem.num_observations,
    }
    measured = {"seconds_read": seconds_read, "peak_memory_bytes": peak_memory_bytes()}
    return _finite({"input": size, **measured, **summary.to_dict()})  # type: ignore[no-any-return]


def write_report(report: dict[str, Any], path: Path) -> None:
    """Write a report; the file appears complete or not at all.

    Raises
    ------
    DatasetError
        If the file cannot be written.
    """
    text = json.dumps(report, indent=1, allow_nan=False)
    with atomic_files(path) as (stream,):
        stream.write(text.encode() + b"\n")


def peak_memory_bytes() -> int:
    """Largest resident memory of this process so far [bytes].

    Linux tells it by process image; the portable figure there includes what the parent held when it forked.
    """
    with suppress(OSError):
        match = re.search(r"^VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text(), re.MULTILINE)
        if match:
            return 1024 * int(match[1])
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(member) for name, member in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(member) for member in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
