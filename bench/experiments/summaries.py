"""Rows of single runs summed up: medians, and how far chance moves them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from experiments.description import Row
from sfmcpp.model.arrays import FloatArray

NOTES = (
    "Medians over drives of the medians over their runs. [ratio]: 95 % of 2,000 bootstrap samples of that",
    "median, drives and then their runs drawn with replacement; of one drive, the range of its runs.",
)
_DRAWS = 2000
_ENDS_PERCENT = (2.5, 97.5)


def summaries(rows: Sequence[Row], measures: Sequence[str], ratios: Sequence[str]) -> Iterator[Row]:
    """One row for each drive of several runs, then one for each group of drives, of every label.

    A row has a `drive`, the `groups` it counts in, a `label` and its measures: numbers, lists of them, or
    None. Those in `ratios` get an interval, ``[ratio]``.
    """
    labels = list(dict.fromkeys(row["label"] for row in rows))
    for name in dict.fromkeys(row["drive"] for row in rows):
        of_drive = [row for row in rows if row["drive"] == name]
        if len(of_drive) > len(labels):
            yield from _summed_up(name, of_drive, labels, measures, ratios)
    for name in dict.fromkeys(group for row in rows for group in row["groups"]):
        of_group = [row for row in rows if name in row["groups"]]
        yield from _summed_up(f"{name}, median", of_group, labels, measures, ratios)


def _summed_up(
    name: str, rows: Sequence[Row], labels: Sequence[str], measures: Sequence[str], ratios: Sequence[str]
) -> Iterator[Row]:
    of_labels = {label: [row for row in rows if row["label"] == label] for label in labels}
    for label, of_label in of_labels.items():
        if not of_label:
            continue
        tables = {measure: _table(of_label, measure) for measure in measures}
        intervals = {f"[{ratio}]": interval(tables[ratio]) for ratio in ratios if ratio in tables}
        found = {measure: _plain(median_of_drives(table)) for measure, table in tables.items()}
        failed = sum(row["error_m"] is None for row in of_label)
        yield {"drive": name, "label": label, **found, **intervals, "runs": len(of_label), "failed": failed}


def _table(rows: Sequence[Row], measure: str) -> FloatArray:
    """Values (drives, runs) or (drives, runs, k) of a measure; NaN where there is none."""
    drives = dict.fromkeys(row["drive"] for row in rows)
    values = [[row.get(measure) for row in rows if row["drive"] == drive] for drive in drives]
    width = max((len(v) for of_drive in values for v in of_drive if isinstance(v, list)), default=0)
    empty = [None] * width if width else None
    return np.array([[empty if v is None else v for v in of_drive] for of_drive in values], dtype=np.float64)


def median_of_drives(table: FloatArray) -> FloatArray:
    """Median over drives (axis 0) of the medians over runs (axis 1), of what there is."""
    return _median(_median(table, 1), 0)


def interval(table: FloatArray, draws: int = _DRAWS) -> list[float] | None:
    """Ends of the bootstrap interval of :func:`median_of_drives` of (drives, runs); None of a single run."""
    drives, runs = table.shape
    if table.size < 2 or np.isnan(table).all():
        return None
    if drives == 1:
        return [float(np.nanmin(table)), float(np.nanmax(table))]
    rng = np.random.default_rng(0)
    which = rng.integers(drives, size=(draws, drives, 1))
    sampled = table[which, rng.integers(runs, size=(draws, drives, runs))]
    medians = _median(_median(sampled, 2), 1)
    return [float(end) for end in np.nanpercentile(medians, _ENDS_PERCENT)]


def interval_of_mean(values: Sequence[float]) -> list[float] | None:
    """Ends of the bootstrap interval of the mean; None of fewer than two values."""
    if len(values) < 2:
        return None
    which = np.random.default_rng(0).integers(len(values), size=(_DRAWS, len(values)))
    return [float(end) for end in np.percentile(np.asarray(values)[which].mean(axis=1), _ENDS_PERCENT)]


def _median(values: FloatArray, axis: int) -> FloatArray:
    """Median of what there is along an axis; NaN of nothing."""
    known = np.sort(values, axis=axis)  # NaN last
    count = np.isfinite(known).sum(axis=axis, keepdims=True)
    middle = [np.take_along_axis(known, np.maximum(k, 0), axis) for k in ((count - 1) // 2, count // 2)]
    return np.asarray(np.where(count > 0, 0.5 * (middle[0] + middle[1]), np.nan).squeeze(axis))


def _plain(value: FloatArray) -> float | list[float | None] | None:
    if value.ndim:
        return [None if np.isnan(x) else float(x) for x in value]
    return None if np.isnan(value) else float(value)
