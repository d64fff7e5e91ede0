"""Results of runs, kept by commit and case: what was measured is not measured again."""

from __future__ import annotations

import hashlib
import json
import subprocess
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[2]

Record = dict[str, Any]


def commit() -> str:
    """The last commit that changed the package; if there are changes since, with a hash of the built core."""
    sources = ("cpp", "python/sfmcpp")
    last = _git("log", "-1", "--format=%h", "--", *sources)
    if not last or _git("status", "--porcelain", "--untracked-files=no", "--", *sources):
        import sfmcpp._core

        built = hashlib.sha256(Path(sfmcpp._core.__file__).read_bytes()).hexdigest()[:8]
        return f"{last}+{built}"
    return last


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(REPOSITORY), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout.strip()


class Results:
    """All records in one JSON file, written after each run.

    Parameters
    ----------
    path : Path
        The file; read if it is there.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._records: dict[str, Record] = json.loads(path.read_text()) if path.exists() else {}

    def find(self, *key: str) -> Record | None:
        """What was measured under this key."""
        return self._records.get("|".join(key))

    def keep(self, record: Record, *key: str) -> Record:
        """Write it down, at once and whole."""
        self._records["|".join(key)] = record
        self._path.parent.mkdir(parents=True, exist_ok=True)
        beside = self._path.with_suffix(".part")
        beside.write_text(json.dumps(self._records, indent=1))
        beside.replace(self._path)
        return record

    def of(self, *key: str) -> dict[str, Record]:
        """All records whose key begins so, by the rest of their keys."""
        start = "|".join((*key, ""))
        return {name.removeprefix(start): r for name, r in self._records.items() if name.startswith(start)}

    def lowest_cost(self, case: str) -> float:
        """Lowest final cost of any commit and solver; infinite if there is none."""
        costs = [
            record["final_cost"]
            for name, record in self._records.items()
            if name.split("|")[1] == case and record.get("final_cost") is not None
        ]
        return min(costs, default=float("inf"))
