"""All file formats, one line each: a new format is a module with a `Format` and a line here."""

from __future__ import annotations

from pathlib import Path

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.sources.io import bal, bundler, colmap, npz, ply, sba
from sfmcpp.sources.io.format import Format

# The first that claims a name gets it: sba's …cams….txt before BAL's .txt, folders last.
FORMATS: tuple[Format, ...] = (
    sba.FORMAT,
    bal.FORMAT,
    bundler.FORMAT,
    npz.FORMAT,
    ply.FORMAT,
    colmap.TEXT,
    colmap.BINARY,
)


def named_format(name: str) -> Format:
    """Find the format of that name, or InvalidArgument."""
    for candidate in FORMATS:
        if candidate.name == name:
            return candidate
    known = ", ".join(f.name for f in FORMATS)
    raise InvalidArgument(f"format = {name!r}: must be one of {known}")


def format_of(path: Path) -> Format:
    """Find the format that claims `path`, or a DatasetError that lists the known ones."""
    for candidate in FORMATS:
        if candidate.claims(path):
            return candidate
    suffixes = ", ".join(suffix for f in FORMATS for suffix in f.suffixes)
    raise DatasetError(
        path, f"its name tells no format: must end in {suffixes}, or be the folder of a COLMAP model"
    )
