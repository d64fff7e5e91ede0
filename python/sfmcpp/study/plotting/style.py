"""Style of all figures, without global state; figures as files."""

from __future__ import annotations

from io import BytesIO
from os import PathLike
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import checked
from sfmcpp.model.process_state import without_warnings
from sfmcpp.sources.io.atomic import atomic_files

# Okabe and Ito, "Color universal design" (2008): told apart by colour-blind readers too.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MUTED = "#666666"

# What each format would otherwise stamp with the time of writing; None leaves it out.
_UNDATED: dict[str, dict[str, None]] = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}

FIGURE_SUFFIXES = tuple(f".{name}" for name in _UNDATED)


class _ShownFigure(Figure):
    """A figure that a notebook shows without pyplot."""

    def _repr_png_(self) -> bytes:
        stream = BytesIO()
        self.savefig(stream, format="png")
        return stream.getvalue()


def new_figure(width_in: float, height_in: float) -> Figure:
    """Make an empty figure with an Agg canvas, outside pyplot's global state."""
    figure = _ShownFigure(figsize=(width_in, height_in), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def style_axes(axes: Axes) -> None:
    """Light grid behind the data, no box."""
    axes.set_axisbelow(True)
    axes.grid(True, which="major", color="#dddddd", linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)
    axes.tick_params(which="both", color=MUTED, labelsize=9)


def as_label(name: str) -> str:
    """A name, of a file say, for a title or legend: dollars make no formula of it, and it is text."""
    return name.encode("utf-8", "replace").decode("utf-8").replace("$", r"\$")


@checked()
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


@checked()
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
    with (
        atomic_files(Path(path)) as (stream,),
        # Names may be in any script; what the font lacks is drawn as a box.
        without_warnings("Glyph .* missing from"),
        # Of the process, too: one thread at a time sets it.
        matplotlib.rc_context({"svg.hashsalt": "sfmcpp"}),
    ):
        figure.savefig(stream, format=name, metadata=_UNDATED[name])
