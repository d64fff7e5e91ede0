"""Names that are markup, controls of a terminal or no text change no page, no screen, and end no command."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import noisy_circle, run_here, write_noisy_circle
from sfmcpp import CameraFunction, ConstraintGroup, InvalidArgument, LossFunction, ResidualGroup
from sfmcpp.cli.console import printable
from sfmcpp.model import Metadata
from sfmcpp.study.pages.model_page import write_problem_page

NO_TEXT = "\ud800.jpg"


class _Page(HTMLParser):
    """Tags of a page, its title, and its data."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.texts: dict[str, str] = {}
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        self.texts.setdefault(self.tags[-1] if self.tags else "", data)


@pytest.mark.parametrize(
    "name", ["</script><script>alert(1)</script>", '"><img src=x onerror=alert(1)>', "{{scene}}", "{{orbit}}"]
)
def test_names_in_pages_are_text(tmp_path: Path, name: str) -> None:
    problem = noisy_circle()
    plain, named = tmp_path / "plain.html", tmp_path / "named.html"
    write_problem_page(problem, plain, "plain")
    problem.metadata = Metadata(image_names=[name] * problem.num_cameras)
    write_problem_page(problem, named, name)
    page = _Page(named)
    assert page.tags == _Page(plain).tags
    assert page.texts["title"] == name


def test_a_terminal_is_told_no_colours_by_files(tmp_path: Path) -> None:
    (tmp_path / "hidden.txt").write_text("1 1 1\n0 0 \x1b[8mhidden 2\n")
    result = run_here("info", tmp_path / "hidden.txt")
    assert result.returncode == 2
    assert "hidden.txt:2: '\\x1b[8mhidden' is not a finite number" in result.stderr


def test_a_terminal_is_told_nothing_by_names(tmp_path: Path) -> None:
    source = write_noisy_circle(tmp_path)
    hostile = source.rename(tmp_path / "\x1b]0;owned\x1b[2J\u202egnp.npz")
    for arguments in (["doctor"], ["solve", "--max-iterations", "1"]):
        result = run_here(*arguments, hostile)
        shown = result.stdout + result.stderr
        assert "\\x1b]0;owned\\x1b[2J\\u202egnp.npz" in "".join(shown.split())
        assert not {"\x1b", "\u202e"} & set(shown)


def test_colours_and_lines_are_printed() -> None:
    assert printable("\x1b[1;31mred\x1b[0m\n\té→") == "\x1b[1;31mred\x1b[0m\n\té→"


def test_names_that_are_no_text_are_refused_by_the_core() -> None:
    problem = noisy_circle()

    def residuals(poses: np.ndarray) -> np.ndarray:
        return np.asarray(poses[:, :, 3])

    for make in (
        lambda: ConstraintGroup("position", [0], np.zeros((1, 3)), name=NO_TEXT),
        lambda: ResidualGroup(residuals, cameras=[0], name=NO_TEXT),
        lambda: CameraFunction(lambda x, i: x[:, :2], ("f",), name=NO_TEXT),
        lambda: CameraFunction(lambda x, i: x[:, :2], (NO_TEXT,)),
        lambda: LossFunction(lambda s: s, lambda s: np.ones_like(s), name=NO_TEXT),
    ):
        with pytest.raises(InvalidArgument, match=r"'\\ud800.jpg'.*: must be text that UTF-8 can hold"):
            make()
    group = ConstraintGroup("position", [0], np.zeros((1, 3)))
    group.name = NO_TEXT
    with pytest.raises(InvalidArgument, match="must be text that UTF-8 can hold"):
        sfmcpp.solve(problem, constraints=[group])


@pytest.mark.parametrize("output", ["out.nvm", "out.csv", "sigmas.csv"])
def test_names_that_are_no_text_are_refused_by_the_file(tmp_path: Path, output: str) -> None:
    problem = noisy_circle()
    problem.metadata = Metadata(image_names=[NO_TEXT, *map(str, range(1, problem.num_cameras))])
    sfmcpp.write(problem, tmp_path / "named.npz")
    solve = ("solve", tmp_path / "named.npz", "--covariances", tmp_path / output)
    command = solve if output == "sigmas.csv" else ("convert", tmp_path / "named.npz", tmp_path / output)
    result = run_here(*command)
    assert result.returncode == 2
    told = "image name '\\ud800.jpg'" if output == "out.nvm" else "'\\ud800'"
    assert f"{output}: {told} cannot be written as UTF-8" in result.stderr
    assert not (tmp_path / output).exists()
