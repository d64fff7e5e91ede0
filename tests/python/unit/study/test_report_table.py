"""Tables of reports on a screen."""

from __future__ import annotations

from collections.abc import Iterator

from sfmcpp.study.report_table import ReportTable, listed_names


class _Table(ReportTable):
    def _rows(self) -> Iterator[tuple[str, str]]:
        names = listed_names(["a\nwarning         none.jpg", "b\r.jpg"])
        yield "left out", f"{names}: no matches"
        yield "pairs", ""


def test_a_name_with_a_line_break_makes_no_row() -> None:
    left_out, pairs = str(_Table()).split("\n")
    assert left_out == r"left out        a\nwarning         none.jpg, b\n.jpg: no matches"
    assert pairs == "pairs           "
