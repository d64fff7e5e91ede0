"""What a diagnosis consists of: findings, ranked, each with what, where and what to do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

SEVERITIES = ("error", "warning", "note")

_NAMED = 5


@dataclass(frozen=True)
class Finding:
    """One thing about a problem that explains a bad result.

    Attributes
    ----------
    code : str
        Its name, the same in every version: ``"mirrored-y"``.
    severity : str
        ``"error"``: a solve refuses the problem, or its result means nothing; ``"warning"``: the result will
        suffer; ``"note"``: worth knowing.
    what : str
        What was found, in a sentence with its figures.
    where : str
        Cameras, points or observations it concerns, by name; empty: the whole problem.
    advice : str
        What to do.
    cameras, points, observations : tuple of int
        Their numbers.
    measures : dict of str to float
        The figures of the sentence.
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
    """What :func:`sfmcpp.diagnose` found; print it for the ranked list.

    Attributes
    ----------
    findings : list of Finding
        Errors first, then warnings and notes; among these causes before what follows from them.
    skipped : list of str
        What was not looked at, or at a part only, and why.
    """

    findings: list[Finding]
    skipped: list[str]

    @property
    def is_healthy(self) -> bool:
        """Whether there is nothing above a note."""
        return all(finding.severity == "note" for finding in self.findings)

    @property
    def codes(self) -> list[str]:
        """Names of the findings in their order."""
        return [finding.code for finding in self.findings]

    def of_severity(self, severity: str) -> list[Finding]:
        """Those of one severity."""
        return [finding for finding in self.findings if finding.severity == severity]

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for reports."""
        return {
            "healthy": self.is_healthy,
            "findings": [asdict(finding) for finding in self.findings],
            "skipped": list(self.skipped),
        }

    def __str__(self) -> str:
        lines = [f"{k}. {finding}" for k, finding in enumerate(self.findings, start=1)]
        return "\n".join(lines or ["nothing found"])


def numbers(indices: NDArray[np.integer]) -> tuple[int, ...]:
    """Indices as a finding holds them."""
    return tuple(int(k) for k in indices)


def counted(count: int, what: str) -> str:
    """Count some things: "1 camera", "1,200 points"."""
    return f"{count:,} {what}{'s' * (count != 1)}"


def named(what: str, indices: Sequence[int], name: Callable[[int], str] = str) -> str:
    """Name some things: "camera 3", "cameras 3, 7", "120 cameras: 3, 7, 9, 12, 15, …"."""
    listed = ", ".join(name(k) for k in indices[:_NAMED])
    if len(indices) == 1:
        return f"{what} {listed}"
    return f"{what}s {listed}" if len(indices) <= _NAMED else f"{counted(len(indices), what)}: {listed}, …"
