"""Tables of reports: rows of names and values, reasons in groups, the georeference of a model."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np

if TYPE_CHECKING:
    from sfmcpp.model.metadata import WorldOrigin
    from sfmcpp.sfm import ControlOutcome, GpsOutcome


T = TypeVar("T")
NAMES_LISTED = 4
_NUMBER = re.compile(r"\b\d[\d.,]*\b")


def grouped_by_reason(entries: Iterable[tuple[str, T]]) -> dict[str, list[T]]:
    """Group members by their reason, the largest group first.

    Reasons that differ only in numbers or after a colon form one group, which is named by their common
    text.

    Parameters
    ----------
    entries : iterable of (str, member)
        Reasons, and what was left out for them.
    """
    groups: dict[str, list[tuple[str, T]]] = {}
    for reason, member in entries:
        shared = _NUMBER.sub("…", reason.split(":")[0])
        groups.setdefault(shared, []).append((reason, member))
    named = {}
    for shared, group in sorted(groups.items(), key=lambda item: -len(item[1])):
        named[_common_reason(shared, {reason for reason, _ in group})] = [member for _, member in group]
    return named


def _common_reason(shared: str, reasons: set[str]) -> str:
    """Common part of reasons: all of it, all but the numbers, or the part before the colon."""
    for candidates in (reasons, {_NUMBER.sub("…", reason) for reason in reasons}):
        if len(candidates) == 1:
            return candidates.pop()
    return shared


def listed_names(names: Sequence[str]) -> str:
    """Some names, and how many more there are."""
    shown = ", ".join(names[:NAMES_LISTED])
    more = len(names) - NAMES_LISTED
    return f"{shown} and {more:,} more" if more > 0 else shown


def gps_rows(gps: GpsOutcome) -> Iterator[tuple[str, str]]:
    """σ of the positions, accuracy of the camera centres, what is left, what is left out, origin."""
    yield (
        "GPS",
        f"σ {gps.sigma_m:.3g} m{_stated_accuracy(gps)}; accuracy of the camera centres {gps.accuracy_m:.3g} "
        "m (1 σ)",
    )
    if gps.rms_m is not None:
        yield "GPS residuals", residuals_text(gps)
    if gps.without_position:
        yield "without GPS", listed_names(gps.without_position)
    if gps.outliers:
        yield "GPS left out", listed_names(gps.outliers)
    if np.any(gps.origin):
        yield "origin", origin_text(gps.world_origin)


def residuals_text(gps: GpsOutcome) -> str:
    """How far the images lie from their positions along the axes, but for those that were left out."""
    axes = "east, north, up" if gps.geodetic else "x, y, z"
    return f"RMS {_listed_m(gps.rms_m or ())} ({axes})"


def _listed_m(lengths_m: Iterable[float]) -> str:
    return f"{', '.join(f'{length:.3g}' for length in lengths_m)} m"


def control_rows(control: ControlOutcome) -> Iterator[tuple[str, str]]:
    """How a model fits its control and check points, the worst of each, and the origin."""
    for title, checks in (("control points", False), ("check points", True)):
        rms, some = control.rms_m(checks=checks), np.flatnonzero(control.checks == checks)
        if rms is None:
            continue
        distances = np.linalg.norm(control.offsets_m[some], axis=1)
        worst = control.names[some[int(np.argmax(distances))]]
        most = f"{worst!r} {_listed_m([distances.max()])}"
        yield title, f"{len(some)}; off by {_listed_m(rms)} (RMS by axis), most {most}"
    yield (
        "marks",
        f"{int(control.num_marks.sum())}; {control.mean_error_px:.3g} px from their images (mean)",
    )
    if np.any(control.world_origin.place):
        yield "origin", origin_text(control.world_origin)


def origin_text(origin: WorldOrigin) -> str:
    """The numbers of an origin with their names."""
    return ", ".join(f"{name} {value:.10g}" for name, value in origin.to_dict().items())


def _stated_accuracy(gps: GpsOutcome) -> str:
    if gps.stated_sigma_m is None:
        return ""
    same = gps.sigma_m == gps.stated_sigma_m
    return " as stated" if same else f" (stated: {gps.stated_sigma_m:.3g} m)"


def _in_one_line(value: str) -> str:
    """A value without line breaks: the name of a file with one must not look like a row of its own."""
    return "\\n".join(value.splitlines())


class ReportTable(ABC):
    """Report of a run as a table on screen."""

    def table(self, written: Iterable[Path] = ()) -> str:
        """Make a table of it.

        Parameters
        ----------
        written : iterable of Path
            Files to list at its end.
        """
        rows = [*self._rows(), *(("written", str(path)) for path in written)]
        return "\n".join(f"{name:<16}{_in_one_line(value)}" for name, value in rows)

    def __str__(self) -> str:
        return self.table()

    @abstractmethod
    def _rows(self) -> Iterator[tuple[str, str]]:
        """Names and values, in order."""
