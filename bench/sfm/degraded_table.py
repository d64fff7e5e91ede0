"""Degraded copies of photos as a Markdown table, with errors over those of an earlier run."""

from __future__ import annotations

import math
from typing import Any

from table import UNKNOWN

Row = dict[str, Any]
Earlier = dict[tuple[str, str], Row]
HEADINGS = (
    "set",
    "copy",
    "registered",
    "mean / max centre error, % of extent",
    "mean / max rotation error °",
    "focal length / longer side",
    "principal point, % of width, height",
    "aspect",
    "warnings",
)
AGAINST = ("centre error, times", "rotation error, times")
MEASURES = ("centre_error", "rotation_error_deg")


def table_of_copies(rows: list[Row], earlier: Earlier) -> str:
    """A line for each row; below, geometric means of the errors of each set, over those before if known."""
    headings = HEADINGS + (AGAINST if earlier else ())
    lines = [" | ".join(headings), " | ".join(["---"] * len(headings))]
    lines += [" | ".join(_cells(row) + (_ratio_cells(row, earlier) if earlier else [])) for row in rows]
    table = [f"| {line} |" for line in lines]
    notes = [f"- {row['set']}, {row['copy']}: {fault}" for row in rows if (fault := _fault(row))]
    names = dict.fromkeys(row["set"] for row in rows)
    notes += [f"- {name}: {_summary([row for row in rows if row['set'] == name], earlier)}" for name in names]
    return "\n".join([*table, "", *notes])


def _cells(row: Row) -> list[str]:
    cells = [row["set"], row["copy"], f"{row['registered']} / {row['images']}"]
    truth = row.get("truth")
    centre, turn = (truth[measure] for measure in MEASURES) if truth else (None, None)
    part = 100 / row["extent"] if truth else 1.0
    cells += [
        UNKNOWN if errors is None else f"{scale * errors['mean']:.3f} / {scale * errors['max']:.3f}"
        for errors, scale in ((centre, part), (turn, 1.0))
    ]
    cells += _lens(row["intrinsics"], row["size"]) if "intrinsics" in row else [UNKNOWN] * 3
    return [*cells, str(len(row["run"].get("warnings", [])))]


def _lens(lens: dict[str, float], size: list[int]) -> list[str]:
    off = [100 * (lens[name] / side - 0.5) for name, side in zip(("cx", "cy"), size, strict=True)]
    return [f"{lens['f'] / max(size):.4f}", f"{off[0]:+.2f}, {off[1]:+.2f}", f"{lens['aspect']:.4f}"]


def _ratios(row: Row, earlier: Earlier) -> list[float | None]:
    before = earlier.get((row["set"], row["copy"]), {}).get("truth")
    if before is None or "truth" not in row:
        return [None, None]
    return [row["truth"][measure]["mean"] / before[measure]["mean"] for measure in MEASURES]


def _ratio_cells(row: Row, earlier: Earlier) -> list[str]:
    return [UNKNOWN if ratio is None else f"{ratio:.2f}" for ratio in _ratios(row, earlier)]


def _fault(row: Row) -> str:
    if row["error"]:
        return f"FAILED: {row['error'].strip().splitlines()[-1]}"
    return row.get("truth_error", "")


def _summary(rows: list[Row], earlier: Earlier) -> str:
    known = [row for row in rows if "truth" in row]
    told = f"{len(known)} of {len(rows)} copies measured"
    if known:
        turns = _geometric_mean([row["truth"]["rotation_error_deg"]["mean"] for row in known])
        parts = _geometric_mean([100 * row["truth"]["centre_error"]["mean"] / row["extent"] for row in known])
        told += f", geometric means: centre error {parts:.3f} % of the extent, rotation error {turns:.3f}°"
    both = [[ratio for ratio in found if ratio] for row in known if any(found := _ratios(row, earlier))]
    if both:
        centre, turn = (_geometric_mean(list(ratios)) for ratios in zip(*both, strict=True))
        worst = max(ratios[0] for ratios in both)
        told += f"; times those before: {centre:.2f} (worst {worst:.2f}) and {turn:.2f}"
    return told


def _geometric_mean(values: list[float]) -> float:
    return math.exp(sum(math.log(value) for value in values) / len(values))
