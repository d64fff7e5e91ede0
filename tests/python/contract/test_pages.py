"""The code of the README and of every page of the documentation runs, as one session of a reader."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import check_links
import run_pages
import sfmcpp

REPOSITORY = Path(__file__).resolve().parents[3]
README = Path("README.md")


def coded_pages(mark: str) -> list[Path]:
    """Pages with a block of this mark."""
    return [page for page in (README, *run_pages.pages()) if mark in marks(page)]


def marks(page: Path) -> set[str]:
    text = (REPOSITORY / page).read_text(encoding="utf-8")
    return {block.mark for block, _ in run_pages.blocks_of(page, text)}


@pytest.fixture(autouse=True)
def without_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "Agg")


def copied(page: Path, folder: Path) -> Path:
    copy = folder / page.name
    shutil.copyfile(REPOSITORY / page, copy)
    return copy


def test_lines_of_code_are_no_longer_than_the_website_is_wide() -> None:
    long = [
        f"{page}:{block.line + number}"
        for page in run_pages.pages()
        for block, _ in run_pages.blocks_of(page, (REPOSITORY / page).read_text(encoding="utf-8"))
        for number, line in enumerate(block.code.splitlines(), start=1)
        if len(line) > 110
    ]
    assert not long


@pytest.mark.parametrize("page", coded_pages(""), ids=str)
def test_the_code_of_a_page_runs(page: Path, tmp_path: Path) -> None:
    run_pages.run_page(copied(page, tmp_path), real=False)


@pytest.mark.real
@pytest.mark.parametrize("page", coded_pages("real"), ids=str)
def test_the_code_of_a_page_runs_on_real_data(page: Path, tmp_path: Path, data_dir: Path) -> None:
    """Files lie where the page names them, in its own folder."""
    copy = copied(page, tmp_path)
    photos = copy.with_suffix("") / "photos"
    photos.mkdir(parents=True)
    for path in [*(data_dir / "bal").iterdir(), *(data_dir / "kitti_tracks").iterdir()]:
        (photos.parent / path.name).symlink_to(path)
    for path in (data_dir / "kermit").glob("*.jpg"):
        (photos / path.name).symlink_to(path)
    run_pages.run_page(copy, real=True)


def test_links_that_lead_nowhere_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text("<h1 id='top1'></h1><a href='b.html#there'></a><a href='#top1'></a>")
    (tmp_path / "b.html").write_text("<p id='here'></p><a href='a.html'></a><img src='no.png'>")
    assert list(check_links.broken_links(tmp_path)) == ["a.html: b.html#there", "b.html: no.png"]


def test_pages_are_found() -> None:
    assert len(coded_pages("")) > 15
    assert coded_pages("real") == [README]


def page_of(tmp_path: Path, text: str) -> Path:
    (tmp_path / "page.md").write_text(text, encoding="utf-8")
    return tmp_path / "page.md"


def test_blocks_run_in_order_as_one_session_and_their_output_follows_them(tmp_path: Path) -> None:
    page = page_of(
        tmp_path,
        "```python\nx = 1\n```\n```sh\necho told > file\n```\n```python real\nx = 0\n```\n"
        "```sh elsewhere\nfalse\n```\n"
        "```python\nfrom pathlib import Path\nprint(x, Path('file').read_text())\n```\nend\n",
    )
    assert run_pages.run_page(page, real=False).endswith("```\n\n```text\n1 told\n```\nend\n")
    assert run_pages.run_page(page, real=True).endswith("```\n\n```text\n0 told\n```\nend\n")
    assert (tmp_path / "page/file").read_text() == "told\n"


@pytest.mark.parametrize("block", ["```python\nraise OSError\n```\n", "```sh\nfalse\ntrue\n```\n"])
def test_a_block_that_fails_is_told(tmp_path: Path, block: str) -> None:
    with pytest.raises((OSError, RuntimeError)):
        run_pages.run_page(page_of(tmp_path, block), real=False)


@pytest.mark.parametrize("name", ["many-machines.md", "docs/many-machines.md", "how-to/gps.md"])
def test_a_page_is_named_by_its_place_in_the_repository_or_in_its_docs(name: str) -> None:
    assert run_pages.chosen_page(name) == Path("docs", name.removeprefix("docs/"))


def test_a_page_that_there_is_not_is_refused_in_one_line() -> None:
    with pytest.raises(SystemExit, match=r"^run_pages\.py: nix\.md: is no page: must be one of api\.md, "):
        run_pages.chosen_page("nix.md")


def test_links_lead_to_where_pages_are_on_the_site() -> None:
    told = run_pages.with_links_of_site(
        "[a](docs/drives.md#honest) [b](SECURITY.md) [c](https://x.org/y) [d](#here)",
        REPOSITORY / "ARCHITECTURE.md",
        "architecture.md",
    )
    assert told == "[a](drives.md#honest) [b](../SECURITY.md) [c](https://x.org/y) [d](#here)"
    told = run_pages.with_links_of_site("[a](../ARCHITECTURE.md)", REPOSITORY / "docs/drives.md", "drives.md")
    assert told == "[a](architecture.md)"


def test_the_page_of_the_installation_says_what_all_is() -> None:
    settings = (REPOSITORY / "pyproject.toml").read_text(encoding="utf-8")
    held = re.search(r'^all = \["sfmcpp\[(.*)\]"\]$', settings, re.MULTILINE)
    assert held is not None
    page = (REPOSITORY / "docs/install.md").read_text(encoding="utf-8")
    assert f"and {held[1].replace(',', ', ')};" in page


def run_section(page: str, section: str, names: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Run the first block below a heading; `names` of the session before it."""
    path = REPOSITORY / "docs" / page
    text = path.read_text(encoding="utf-8")
    begin = text.index(section)
    block = next(block for block, end in run_pages.blocks_of(path, text) if end > begin)
    with run_pages.working_in(folder):
        block.run(names)
    return names


def test_ground_control_brings_points_to_where_they_are(tmp_path: Path) -> None:
    """Held against a scene that the page has not touched."""
    known = {"np": np, "sfmcpp": sfmcpp}
    names = run_section("how-to/gps.md", "## Ground control points", known, tmp_path)
    truth = sfmcpp.circle_scene(40, 300, pixel_sigma_px=0.5, seed=3)
    model, joined = names["model"], names["found"].problem
    before_m, after_m = (
        np.linalg.norm(p.points[: model.num_points] - truth.points[10:], axis=1) for p in (model, joined)
    )
    assert before_m.mean() > 2.0
    assert after_m.mean() < 0.03
    np.testing.assert_array_equal(names["truth"].points, truth.points)
    np.testing.assert_array_equal(names["truth"].cameras, truth.cameras)


def test_the_shared_camera_of_the_page_keeps_what_the_file_tells(tmp_path: Path) -> None:
    scene = sfmcpp.circle_scene(4, 30, camera_model="perspective", seed=0)
    scene.metadata.image_names = ["a.jpg", "b.jpg", "c.jpg", "d.jpg"]
    sfmcpp.write(scene, tmp_path / "scene.npz")
    known = {"np": np, "sfmcpp": sfmcpp}
    shared = run_section("how-to/intrinsics.md", "## Share a camera", known, tmp_path)["shared"]
    assert len(shared.intrinsics) == 1
    assert shared.metadata.image_names == scene.metadata.image_names
