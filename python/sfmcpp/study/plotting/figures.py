"""Figures as files."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure

from sfmcpp.errors import InvalidArgument
from sfmcpp.sources.io.files import atomic_files

# What each format would otherwise stamp with the time of writing; None leaves it out.
_UNDATED: dict[str, dict[str, None]] = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}

FIGURE_SUFFIXES = tuple(f".{name}" for name in _UNDATED)


def figure_format(path: str | PathLike[str]) -> str:
    """Tell the format of a figure file from its suffix.

    Parameters
    ----------
    path : path-like
        A file name; the file need not exist.

    Returns
    -------
    str
        ``"png"``, ``"svg"`` or ``"pdf"``.

    Raises
    ------
    InvalidArgument
        If the suffix is none of `FIGURE_SUFFIXES`.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in FIGURE_SUFFIXES:
        known = ", ".join(FIGURE_SUFFIXES)
        raise InvalidArgument(f"path = {str(path)!r}: suffix {suffix!r}, must be one of {known}")
    return suffix.removeprefix(".")


def save_figure(figure: Figure, path: str | PathLike[str]) -> None:
    """Write a figure; the file appears complete or not at all, and the same figure gives the same bytes.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
        What to write.
    path : path-like
        Where to; the suffix tells the format.

    Raises
    ------
    InvalidArgument
        If the suffix is none of `FIGURE_SUFFIXES`.
    DatasetError
        If the file cannot be written.
    """
    name = figure_format(path)
    with atomic_files(Path(path)) as (stream,), matplotlib.rc_context({"svg.hashsalt": "sfmcpp"}):
        figure.savefig(stream, format=name, metadata=_UNDATED[name])
