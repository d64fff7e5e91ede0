"""Rows as a Markdown table: both sides of a set one below the other, then the ratio of their seconds."""

from __future__ import annotations

from typing import Any

from measuring import STAGES

HEADINGS = (
    "set (given)",
    "by",
    "images registered",
    "points",
    "mean reprojection px",
    "mean / max centre error m",
    "mean / max rotation error °",
    "AUC at 1° / 3° / 5° / 10° %",
    "focal px",
    "seconds: " + ", ".join(STAGES),
    "total s",
    "ratio",
)
UNKNOWN = "–"


def markdown_table(rows: list[dict[str, Any]]) -> str:
    """The rows in their order; a ratio is the seconds of a row over COLMAP's of the same set."""
    of_colmap = {row["set"]: row["seconds_total"] for row in rows if row["side"] == "colmap"}
    cells = [list(HEADINGS), *(_cells(row, of_colmap.get(row["set"])) for row in rows)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(HEADINGS))]
    lines = ["| " + " | ".join(map(str.ljust, line, widths)) + " |" for line in cells]
    rule = "|" + "|".join("-" * (width + 2) for width in widths) + "|"
    return "\n".join([lines[0], rule, *lines[1:]])


def notes(rows: list[dict[str, Any]]) -> list[str]:
    """What has to be said of single rows, and whose thresholds may have been chosen on which sets."""
    lines = [
        f"{row['set']}, {row['side']}: FAILED: {_last_line(row['error'])}" for row in rows if row["error"]
    ]
    lines += [f"{row['set']}, {row['side']}: {row['truth_error']}" for row in rows if "truth_error" in row]
    lines += [
        f"{row['set']}, {row['side']}: {len(row['run']['models'])} models of {row['run']['models']} images"
        for row in rows
        if len(row["run"].get("models") or []) > 1
    ]
    roles: dict[str, list[str]] = {}
    for row in rows:
        names = roles.setdefault(row["role"], [])
        names += [row["set"]] if row["set"] not in names else []
    for role, names in roles.items():
        lines.append(f"{role} sets for sfmcpp: {', '.join(names)}")
    lines.append("COLMAP: its defaults on every set, tuned on none of them")
    reused = sorted({row["side"] for row in rows if row.get("reused")})
    lines += [f"{side}: measured in an earlier run: ratios are of different hours" for side in reused]
    return lines


def _cells(row: dict[str, Any], colmap_seconds: float | None) -> list[str]:
    truth, total = row.get("truth"), row["seconds_total"]
    centre, turn = (truth[key] for key in ("centre_error", "rotation_error_deg")) if truth else (None, None)
    ratio = total / colmap_seconds if total and colmap_seconds else None
    return [
        f"{row['set']} ({row['given']})",
        row["side"],
        f"{row['registered']} / {row['images']}",
        f"{row['points']:,}" if "points" in row else UNKNOWN,
        _number(row.get("reprojection_px", {}).get("mean"), ".3f"),
        _pair(centre, ".4f")
        if centre
        else f"GPS: {_pair(row.get('gps'), '.2f')}"
        if "gps" in row
        else UNKNOWN,
        _pair(turn, ".3f"),
        " / ".join(f"{100 * area:.1f}" for area in truth["auc"].values()) if truth else UNKNOWN,
        _number(row.get("intrinsics", {}).get("f"), ".1f"),
        ", ".join(_number(row["seconds"][stage], ".1f") for stage in STAGES),
        _number(total, ".1f"),
        _number(ratio, ".2f"),
    ]


def _pair(statistics: dict[str, float] | None, form: str) -> str:
    return UNKNOWN if statistics is None else f"{statistics['mean']:{form}} / {statistics['max']:{form}}"


def _number(value: float | None, form: str) -> str:
    return UNKNOWN if value is None else f"{value:{form}}"


def _last_line(text: str) -> str:
    return text.strip().splitlines()[-1] if text.strip() else "no message"
