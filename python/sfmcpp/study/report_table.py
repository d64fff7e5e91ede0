"""Reports that are shown as a table of names and values."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from pathlib import Path


class ReportTable(ABC):
    """What a report of a run shows on screen."""

    def table(self, written: Iterable[Path] = ()) -> str:
        """Make a table of it.

        Parameters
        ----------
        written : iterable of Path
            Files to list at its end.
        """
        rows = [*self._rows(), *(("written", str(path)) for path in written)]
        return "\n".join(f"{name:<16}{value}" for name, value in rows)

    def __str__(self) -> str:
        return self.table()

    @abstractmethod
    def _rows(self) -> Iterator[tuple[str, str]]:
        """Names and values, in order."""
