"""Usage: run_pages.py OUTPUT [PAGE...]: run the code of the pages, and make the website of them with Sphinx.

A page is named by its place in the repository or below its ``docs``.

Every Python and shell block of a page runs, in order, as one session in a folder of the page's own name
beside it. What a block prints stands below it on the site, and pictures are those that the blocks have
written. A word after the language marks a block: ``real`` reads the real data of $SFMCPP_DATA, and
``elsewhere`` is not run here: it installs, needs what is not here, or has a test of its own.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from check_links import broken_links

DOCS = Path(__file__).resolve().parent
REPOSITORY = DOCS.parent
BLOCK = re.compile(r"^```(python|sh)(?: (real|elsewhere))?\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
MOST_LINES = 150

# Pages that live elsewhere in the repository, and what they are called on the site.
GUESTS = {
    "ARCHITECTURE.md": "architecture.md",
    "CHANGELOG.md": "changes.md",
    "bench/experiments/README.md": "experiments.md",
    "bench/peers/README.md": "rules-of-solvers.md",
    "bench/sfm/README.md": "rules-of-photos.md",
}
LINK = re.compile(r"(?<=\]\()(?!\w+:|#)([^)#]+)")

# `sfmcpp` and `python` are those of this process, whether or not they are on the path.
PRELUDE = f"""set -euo pipefail
python() {{ {sys.executable!r} "$@"; }}
sfmcpp() {{ {sys.executable!r} -m sfmcpp "$@"; }}
"""


@dataclass(frozen=True)
class Block:
    """A piece of code of a page."""

    page: Path
    line: int
    language: str
    mark: str
    code: str

    def run(self, names: dict[str, Any]) -> str:
        """Run it in the current folder, and give what it prints. `names` are those of the session."""
        return self._run_python(names) if self.language == "python" else self._run_shell()

    def _run_python(self, names: dict[str, Any]) -> str:
        printed = io.StringIO()
        # Line numbers of a traceback are those of the page.
        code = compile("\n" * self.line + self.code, str(self.page), "exec")
        with redirect_stdout(printed):
            exec(code, names)
        return printed.getvalue()

    def _run_shell(self) -> str:
        command = ["bash", "-c", PRELUDE + self.code]
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{self.page}:{self.line}: exit code {done.returncode}\n{done.stdout}")
        return done.stdout


def blocks_of(page: Path, text: str) -> Iterator[tuple[Block, int]]:
    """Each block of a page, with the place in its text where the block ends."""
    for found in BLOCK.finditer(text):
        line = text.count("\n", 0, found.start()) + 1
        yield Block(page, line, found[1], found[2] or "", found[3]), found.end()


def run_page(page: Path, *, real: bool) -> str:
    """Run the blocks of a page in the folder beside it that has its name.

    Parameters
    ----------
    page : Path
        A page of Markdown.
    real : bool
        Whether to run blocks that read real data too.

    Returns
    -------
    str
        The page, with what each block has printed below it.
    """
    folder = page.with_suffix("")
    folder.mkdir(exist_ok=True)
    text, names, pieces, done = page.read_text(encoding="utf-8"), {"__name__": "__main__"}, [], 0
    with working_in(folder):
        for block, end in blocks_of(page, text):
            runs = block.mark == "" or (block.mark == "real" and real)
            printed = block.run(names) if runs else ""
            pieces += [text[done:end], as_output(printed)]
            done = end
    return "".join([*pieces, text[done:]])


@contextmanager
def working_in(folder: Path) -> Iterator[None]:
    """Make `folder` the current one for a while."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def as_output(printed: str) -> str:
    """What a block has printed, as a block of text; its middle is left out where it is long."""
    lines = printed.rstrip().splitlines()
    if len(lines) > MOST_LINES:
        lines[MOST_LINES // 2 : -MOST_LINES // 2] = ["…"]
    return "\n```text\n" + "\n".join(lines) + "\n```\n" if lines else ""


def pages() -> list[Path]:
    """The pages that may hold code, by their places in the repository."""
    return sorted(p.relative_to(REPOSITORY) for p in DOCS.rglob("*.md"))


def chosen_page(argument: str) -> Path:
    """The page that is named by its place in the repository, or below ``docs``.

    Raises
    ------
    SystemExit
        If there is none.
    """
    known = pages()
    for place in (Path(argument), Path("docs", argument), Path(os.path.relpath(argument, REPOSITORY))):
        if place in known:
            return place
    names = ", ".join(str(page.relative_to("docs")) for page in known)
    sys.exit(f"run_pages.py: {argument}: is no page: must be one of {names}")


def make_tree(output: Path) -> Path:
    """A copy of the documentation in which pages can run, beside links to all else that pages name."""
    tree = output / "tree"
    shutil.rmtree(tree, ignore_errors=True)
    tree.mkdir(parents=True)
    for path in REPOSITORY.iterdir():
        if path.name not in {"docs", "build"} and not path.name.startswith("."):
            (tree / path.name).symlink_to(path)
    shutil.copytree(DOCS, tree / "docs", ignore=shutil.ignore_patterns("__pycache__"))
    for page in [*pages(), *GUESTS]:
        source = REPOSITORY / page
        name = os.path.relpath(place_of(str(page)), "docs")
        text = with_links_of_site(source.read_text(encoding="utf-8"), source, name)
        (tree / "docs" / name).write_text(text, encoding="utf-8")
    return tree / "docs"


def place_of(path: str) -> str:
    """Where a file of the repository lies in the tree."""
    return f"docs/{GUESTS[path]}" if path in GUESTS else path


def with_links_of_site(text: str, source: Path, name: str) -> str:
    """The text of a page whose links lead to where guests are on the site."""

    def moved(link: re.Match[str]) -> str:
        target = os.path.relpath(source.parent / link[1], REPOSITORY)
        return os.path.relpath(place_of(target), Path("docs", name).parent)

    return LINK.sub(moved, text)


def main(output: Path, chosen: list[Path]) -> None:
    """Run the pages, all or those chosen, and call Sphinx; of all, no warning or broken link may be left."""
    os.environ["MPLBACKEND"] = "Agg"
    tree, site = make_tree(output), output / "html"
    for page in chosen or pages():
        print(f"run_pages.py: {page}", flush=True)
        copy = tree.parent / page
        copy.write_text(run_page(copy, real="SFMCPP_DATA" in os.environ), encoding="utf-8")
    strict = [] if chosen else ["--fail-on-warning", "--keep-going"]
    subprocess.run([sys.executable, "-m", "sphinx", "--quiet", *strict, str(tree), str(site)], check=True)
    for view in tree.rglob("view.html"):
        target = site / view.relative_to(tree)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(view, target)
    if not chosen and (broken := list(broken_links(site))):
        sys.exit("\n".join(["run_pages.py: links that lead nowhere:", *broken]))
    print(f"run_pages.py: open {site / 'index.html'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), [chosen_page(argument) for argument in sys.argv[2:]])
