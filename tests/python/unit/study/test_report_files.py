"""A folder of results is finished or says that it is not."""

from __future__ import annotations

from pathlib import Path

import pytest

from sfmcpp import DatasetError
from sfmcpp.study.pages.parts import save_page
from sfmcpp.study.report_files import UNFINISHED, write_report, write_steps


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_a_folder_says_that_it_is_unfinished_until_all_is_written(tmp_path: Path) -> None:
    seen = []

    def step(path: Path) -> None:
        seen.append(names_in(tmp_path))
        path.write_text("")

    assert write_steps([("a", step), ("b", step)], tmp_path) == [tmp_path / "a", tmp_path / "b"]
    assert seen == [[UNFINISHED], [UNFINISHED, "a"]]
    assert names_in(tmp_path) == ["a", "b"]


def test_where_one_file_fails_the_others_are_written_and_the_folder_is_unfinished(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    steps = [(name, lambda path: write_report({}, path)) for name in ("a", "b")]
    with pytest.raises(DatasetError, match="a: is a directory, a file is wanted"):
        write_steps(steps, tmp_path)
    assert names_in(tmp_path) == [UNFINISHED, "a", "b"]


def test_names_of_files_that_are_no_text_do_not_spoil_a_page(tmp_path: Path) -> None:
    save_page("bad\udcff.mat", tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text() == "bad?.mat"
