"""Each file of the core includes what declares the types that it names, itself or through what it includes.

An installation compiles the files of a module together, where what another file has included hides what is
missing; a build of one file at a time, as of a C++ project that adds the sources, then fails.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

CPP = Path(__file__).resolve().parents[3] / "cpp"
HEADERS = CPP / "include"

COMMENT_OR_TEXT = re.compile(r'//.*|"(?:\\.|[^"\\\n])*"')
INCLUDE = re.compile(r'^[ \t]*#[ \t]*include[ \t]*"([^"]+)"', re.MULTILINE)
# In a namespace: what is defined in a class is indented. No declaration alone.
ALIGNED = r"(?:alignas\([^)]*\) )?"
DEFINITION = re.compile(rf"^(?:class|struct|enum class) {ALIGNED}(\w+)\b[^;]*?\{{", re.MULTILINE)
DECLARATION = re.compile(rf"\b(?:class|struct|enum class|using) {ALIGNED}(\w+)")


@cache
def code_of(file: Path) -> str:
    return COMMENT_OR_TEXT.sub("", file.read_text())


@cache
def declared_in(file: Path) -> frozenset[str]:
    return frozenset(DECLARATION.findall(code_of(file)))


@cache
def reached_from(file: Path) -> frozenset[Path]:
    """The file and all that it includes of the core."""
    reached = {file}
    for name in INCLUDE.findall(file.read_text()):
        places = (file.parent / name, HEADERS / name)
        included = next((place.resolve() for place in places if place.is_file()), None)
        if included is not None and included not in reached:
            reached |= reached_from(included)
    return frozenset(reached)


def test_files_include_what_declares_the_types_that_they_name() -> None:
    headers = sorted(HEADERS.rglob("*.hpp"))
    types = {name for header in headers for name in DEFINITION.findall(code_of(header))}
    missing = [
        f"{file.relative_to(CPP)}: {name}"
        for file in [*headers, *sorted((CPP / "src").rglob("*.[ch]pp"))]
        for name in sorted(types & set(re.findall(r"\w+", code_of(file))))
        if not any(name in declared_in(reached) for reached in reached_from(file))
    ]
    assert len(types) > 100
    assert not missing
