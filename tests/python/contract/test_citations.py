"""Every equation, section, table and figure that the code cites is stated in docs/equations.md."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs/equations.md"
FOLDERS = ("cpp", "python", "bench", "tests")
SUFFIXES = (".hpp", ".cpp", ".py", ".toml", ".md")

NUMBER = r"\d+(?:\.\d+)*"
CITATION = re.compile(
    r"(?:\b(?P<source>note|thesis|equations\.md|EQUATIONS)['’]?\s+)?"
    r"(?P<kind>\beqs?\.?|\bequations?|§|\btables?|\bfigures?|\balgorithms?|\bch\.|\bchapters?)\s*"
    rf"(?P<numbers>{NUMBER}(?:\s*(?:–|,|,?\s*and)\s*§?{NUMBER})*)",
    re.IGNORECASE,
)
KINDS = {"e": "eq.", "§": "§", "t": "table", "f": "figure", "a": "algorithm", "c": "chapter"}
# Beginnings of lines that a sentence of a comment may run across.
LINE_BREAK = re.compile(r"\s*\n\s*(?://|#)?\s*")


def citations(text: str) -> set[str]:
    """Citations of a text such as "thesis eq. 4.19" and "§4.2.2"; numbers without a dot only with a source.

    A dotted number says by itself that it is the thesis' (or another source's, under "Other sources").
    """
    found = set()
    for match in CITATION.finditer(LINE_BREAK.sub(" ", text)):
        kind = KINDS[match["kind"][0].lower()]
        source = (match["source"] or "").lower().removesuffix(".md")
        for number in expanded(match["numbers"]):
            if "." in number:
                found.add(f"{kind} {number}")
            elif source:
                found.add(f"{source} {kind} {number}")
    return found


def expanded(numbers: str) -> list[str]:
    """Every number of a list such as "5.8–5.9, 5.15", of as many parts as the first."""
    result: list[str] = []
    depth = re.split(r"\s|–|,", numbers)[0].count(".")
    for part in re.findall(rf"{NUMBER}(?:\s*–\s*{NUMBER})?", numbers):
        first, _, last = re.sub(r"\s", "", part).partition("–")
        head, _, start = first.rpartition(".")
        stop = last.rpartition(".")[2] or start
        if first.count(".") == depth:
            result += [f"{head}.{k}".lstrip(".") for k in range(int(start), int(stop) + 1)]
    return result


def stated(page: str) -> set[str]:
    """What the page states: its bold citations, and its own numbered sections."""
    bold = {
        citation for span in re.findall(r"\*\*(.+?)\*\*", page, re.DOTALL) for citation in citations(span)
    }
    return bold | {f"equations § {number}" for number in re.findall(r"^## (\d+)\. ", page, re.MULTILINE)}


def cited() -> dict[str, str]:
    """Every citation of the code, and a file that has it."""
    found: dict[str, str] = {}
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in SUFFIXES and path != Path(__file__).resolve() and path.is_file():
                for citation in citations(path.read_text(encoding="utf-8")):
                    found.setdefault(citation, str(path.relative_to(ROOT)))
    return found


def test_every_citation_of_the_code_is_stated_in_the_page() -> None:
    found = cited()
    assert len(found) > 80
    known = stated(PAGE.read_text(encoding="utf-8"))
    assert {citation: path for citation, path in found.items() if citation not in known} == {}


def test_the_page_names_files_that_exist() -> None:
    paths = re.findall(r"`((?:cpp|python|bench|tests)/[\w/.]+)`", PAGE.read_text(encoding="utf-8"))
    assert len(paths) > 15
    assert [path for path in paths if not (ROOT / path).exists()] == []


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("// as in (thesis\n// eqs 5.8–5.10, 5.15)", {"eq. 5.8", "eq. 5.9", "eq. 5.10", "eq. 5.15"}),
        ("note eqs 6 and 10", {"note eq. 6", "note eq. 10"}),
        ("see docs/equations.md §5; §4.2", {"equations § 5", "§ 4.2"}),
        ("Thesis' table 1.1, 30 runs of figure 2", {"table 1.1"}),
        ("Algorithms 6 and 7 are one: thesis algorithm 10", {"thesis algorithm 10"}),
    ],
)
def test_citations_are_read_with_their_ranges_and_sources(text: str, expected: set[str]) -> None:
    assert citations(text) == expected
