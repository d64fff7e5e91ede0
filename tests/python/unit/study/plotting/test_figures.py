"""Figure files: complete or not there at all, in the format their name says."""

from __future__ import annotations

from pathlib import Path

import pytest

from sfmcpp import DatasetError, InvalidArgument
from sfmcpp.study.plotting import FIGURE_SUFFIXES, save_figure
from sfmcpp.study.plotting.style import new_figure

FIRST_BYTES = {".png": b"\x89PNG\r\n\x1a\n", ".svg": b"<?xml", ".pdf": b"%PDF-"}


def test_a_notebook_shows_a_figure_without_pyplot() -> None:
    assert new_figure(2, 1)._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]


@pytest.mark.parametrize("suffix", FIGURE_SUFFIXES)
def test_the_suffix_decides_the_format(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"figure{suffix.upper()}"
    save_figure(new_figure(2, 1), path)
    assert path.read_bytes().startswith(FIRST_BYTES[suffix])


@pytest.mark.parametrize("suffix", FIGURE_SUFFIXES)
def test_the_same_figure_gives_the_same_bytes(tmp_path: Path, suffix: str) -> None:
    contents = []
    for name in ("a", "b"):
        figure = new_figure(2, 1)
        figure.add_subplot().plot([0, 1], [1, 2])
        save_figure(figure, tmp_path / (name + suffix))
        contents.append((tmp_path / (name + suffix)).read_bytes())
    assert contents[0] == contents[1]


@pytest.mark.parametrize("name", ["figure.jpeg", "figure", ".png"])
def test_an_unknown_suffix_is_refused_with_the_known_ones(tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidArgument, match=r"\.png, \.svg, \.pdf"):
        save_figure(new_figure(2, 1), tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_figure_that_fails_to_draw_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "figure.png"
    path.write_bytes(b"old")
    broken = new_figure(2, 1)
    broken.text(0.5, 0.5, r"$\frac{$")
    with pytest.raises(ValueError, match="frac"):
        save_figure(broken, path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="nowhere"):
        save_figure(new_figure(2, 1), tmp_path / "nowhere" / "figure.png")
