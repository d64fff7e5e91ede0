"""The result of a diagnosis: ranked findings, each with what was found, where, and a remedy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import Problem
from sfmcpp.wording import counted, first_few

SEVERITIES = ("error", "warning", "note")

_NAMED = 5


@dataclass(frozen=True)
class Finding:
    """One cause of a bad result.

    Attributes
    ----------
    code : str
        Name of the finding, the same in every version: ``"mirrored-y"``.
    severity : str
        ``"error"``: a solve refuses the problem, or its result is meaningless; ``"warning"``: the result is
        degraded; ``"note"``: for information.
    what : str
        What was found, with figures.
    where : str
        Cameras, points or observations concerned, by name; empty: the whole problem.
    advice : str
        Remedy.
    cameras, points, observations : tuple of int
        Indices of the cameras, points and observations concerned.
    measures : dict of str to float
        Figures of `what`, by name.
    """

    code: str
    severity: str
    what: str
    advice: str
    where: str = ""
    cameras: tuple[int, ...] = ()
    points: tuple[int, ...] = ()
    observations: tuple[int, ...] = field(default=(), repr=False)
    measures: dict[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        place = f" ({self.where})" if self.where else ""
        return f"{self.severity}: {self.code}: {self.what}{place}\n    → {self.advice}"


@dataclass(frozen=True)
class Diagnosis:
    """Result of :func:`sfmcpp.diagnose`; print it for the ranked list.

    Attributes
    ----------
    findings : list of Finding
        Errors first, then warnings and notes; within each severity, causes before their consequences.
    skipped : list of str
        Checks that were left out or made on a part only, with reasons.
    """

    findings: list[Finding]
    skipped: list[str]

    @property
    def is_healthy(self) -> bool:
        """Whether there is neither an error nor a warning."""
        return all(finding.severity == "note" for finding in self.findings)

    @property
    def codes(self) -> list[str]:
        """Names of the findings, in order."""
        return [finding.code for finding in self.findings]

    def of_severity(self, severity: str) -> list[Finding]:
        """Findings of one severity."""
        return [finding for finding in self.findings if finding.severity == severity]

    def to_dict(self) -> dict[str, Any]:
        """Plain Python values for JSON reports."""
        return {
            "healthy": self.is_healthy,
            "findings": [asdict(finding) for finding in self.findings],
            "skipped": list(self.skipped),
        }

    def __repr__(self) -> str:
        return f"Diagnosis({', '.join(f'{f.severity} {f.code}' for f in self.findings) or 'nothing found'})"

    def _repr_html_(self) -> str:
        """The ranked list, for notebooks; its sentences wrap."""
        return f'<pre style="white-space: pre-wrap">{escape(str(self))}</pre>'

    def __str__(self) -> str:
        lines = [f"{k}. {finding}" for k, finding in enumerate(self.findings, start=1)]
        return "\n".join(lines or ["nothing found"])


def numbers(indices: NDArray[np.integer]) -> tuple[int, ...]:
    """Indices as a finding holds them."""
    return tuple(int(k) for k in indices)


def named(what: str, indices: Sequence[int], name: Callable[[int], str] = str) -> str:
    """Name some things: "camera 3", "cameras 3, 7", "120 cameras: 3, 7, 9, 12, 15, …"."""
    listed = first_few((name(k) for k in indices), _NAMED)
    if len(indices) > _NAMED:
        return f"{counted(len(indices), what)}: {listed}"
    return f"{what if len(indices) == 1 else what + 's'} {listed}"


def named_points(problem: Problem, points: Sequence[int]) -> str:
    """Name some points, with COLMAP's identifiers where the problem has them."""
    ids = problem.metadata.ids_of_points(points[:_NAMED], problem.num_points)
    more = ", …" if len(points) > _NAMED else ""
    return named("point", points) + (f" ({ids}{more})" if ids else "")
