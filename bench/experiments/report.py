"""What an experiment found: printed, as JSON, and as a picture."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.text_table import beside_thesis, columns_beside_thesis, text_table
from sfmcpp.study.plotting import save_figure


@dataclass(frozen=True)
class Report:
    """Result of one experiment.

    Attributes
    ----------
    notes : sequence of str
        Definitions and warnings, printed above the table.
    identity : sequence of str
        Which entries of a row tell what it is about; the others are measured.
    columns : sequence of str
        Entries of the rows that are printed.
    rows : list of dict
        Ours; plain values.
    figure : Figure
        The picture.
    printed : list of dict, optional
        What is printed in place of `rows`.
    """

    notes: Sequence[str]
    identity: Sequence[str]
    columns: Sequence[str]
    rows: list[Row]
    figure: Figure
    printed: list[Row] | None = None

    def text(self, experiment: Experiment) -> str:
        """Title, notes, and our rows beside the thesis'."""
        ours = self.rows if self.printed is None else self.printed
        rows = beside_thesis(ours, experiment.thesis, self.identity)
        table = text_table(columns_beside_thesis(self.columns, rows), rows)
        return "\n".join([f"{experiment.name}: {experiment.title}", *self.notes, "", table, ""])

    def write(self, experiment: Experiment, folder: Path) -> list[Path]:
        """Write ``NAME.json`` and ``NAME.png``."""
        content = {
            "name": experiment.name,
            "title": experiment.title,
            "notes": list(self.notes),
            "seed": experiment.seed,
            "runs": experiment.runs,
            "rows": self.rows,
            "thesis": experiment.thesis,
        }
        json_path, png_path = folder / f"{experiment.name}.json", folder / f"{experiment.name}.png"
        text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
        json_path.write_text(text + "\n", encoding="utf-8")
        save_figure(self.figure, png_path)
        return [json_path, png_path]
