"""Tables of what `bench/scale.py` measured, and exponents of growth."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from scaling.results import Results

WITHIN = 1e-3
ALLOWED_RATIO = 1.3

Row = dict[str, Any]


def rows_of(results: Results, commit: str, case: str) -> list[Row]:
    """One row per solver asked for: seconds to 1e-3, bytes, and which solver it was."""
    target = results.lowest_cost(case) * (1 + WITHIN)
    found = results.of(commit, case, "solve")
    return [_row(case, asked.split("|")[0], record, target) for asked, record in found.items()]


def _row(case: str, asked: str, record: Row, target: float) -> Row:
    if "failure" in record:
        return {"case": case, "asked": asked, "failure": record["failure"], "seconds_to": math.inf}
    trace = record["trace"]
    reached = [(seconds, step) for step, (seconds, cost) in enumerate(trace) if cost <= target]
    seconds_to, steps_to = reached[0] if reached else (math.inf, len(trace) - 1)
    return {"case": case, "asked": asked, "seconds_to": seconds_to, "steps_to": steps_to, **record}


def ratio_of_auto(rows: Sequence[Row]) -> float | None:
    """Seconds of auto over those of the best by name; None where either never gets there."""
    automatic = [row["seconds_to"] for row in rows if row["asked"] == "auto"]
    named = [row["seconds_to"] for row in rows if row["asked"] != "auto"]
    if not automatic or not named or math.isinf(min(named)):
        return None
    return float(automatic[0] / min(named))


def exponent(sizes: Iterable[float], values: Iterable[float]) -> float | None:
    """The e of value ∼ sizeᵉ, by least squares in logarithms; None for fewer than two finite values."""
    pairs = [(s, v) for s, v in zip(sizes, values, strict=True) if math.isfinite(v) and v > 0]
    if len({s for s, _ in pairs}) < 2:
        return None
    logarithms = np.log(np.array(pairs, dtype=np.float64))
    return float(np.polyfit(logarithms[:, 0], logarithms[:, 1], 1)[0])


def markdown(results: Results, commit: str, cases: Sequence[str]) -> str:
    """The table of all cases, the ratios of auto, the exponents and the bits."""
    lines = [
        "| case | observations | asked for | took | steps | s to 1e-3 | s in all | of CPU | peak MB |",
        "|---|--:|---|---|--:|--:|--:|--:|--:|",
    ]
    notes = []
    for case in cases:
        rows = rows_of(results, commit, case)
        lines += [_line(row) for row in rows]
        ratio = ratio_of_auto(rows)
        if ratio is not None:
            verdict = "" if ratio <= ALLOWED_RATIO else f" **above {ALLOWED_RATIO}**"
            notes.append(f"- {case}: auto takes {ratio:.2f} × the best by name{verdict}")
        notes += [_bits(case, solver, record) for solver, record in results.of(commit, case, "bits").items()]
    return "\n".join([*lines, "", *notes, *_growth(results, commit, cases)])


def _line(row: Row) -> str:
    if "failure" in row:
        return f"| {row['case']} | | {row['asked']} | {row['failure']} | | | | | |"
    reached = math.isfinite(row["seconds_to"])
    to, steps = (f"{row['seconds_to']:.2f}", str(row["steps_to"])) if reached else ("–", "–")
    return (
        f"| {row['case']} | {row['observations']:,} | {row['asked']} | {row['solver']} | {steps} | {to} "
        f"| {row['seconds']:.2f} | {row['cpu_seconds']:.2f} | {row['peak_bytes'] / 1e6:,.0f} |"
    )


def _bits(case: str, solver: str, record: Row) -> str:
    if "failure" in record:
        return f"- {case}, {solver}: bits not compared ({record['failure']})"
    said = "the same bits" if record["same"] else "**other bits**"
    return f"- {case}, {solver}: {said} for 1 and 2 threads after {record['steps']} steps"


def _growth(results: Results, commit: str, cases: Sequence[str]) -> list[str]:
    """Exponents of each shape that has several sizes."""
    lines = []
    for shape in dict.fromkeys(case.rstrip("0123456789") for case in cases):
        members = [case for case in cases if case.rstrip("0123456789") == shape]
        rows = [row for case in members for row in rows_of(results, commit, case) if "failure" not in row]
        for asked in dict.fromkeys(row["asked"] for row in rows):
            own = [row for row in rows if row["asked"] == asked]
            sizes = [row["observations"] for row in own]
            seconds = exponent(sizes, [row["seconds_to"] for row in own])
            bytes_ = exponent(sizes, [row["peak_bytes"] for row in own])
            if seconds is not None and bytes_ is not None:
                lines.append(
                    f"- {shape}, {asked}: seconds ∼ observations^{seconds:.2f}, memory ^{bytes_:.2f}"
                )
    return lines
