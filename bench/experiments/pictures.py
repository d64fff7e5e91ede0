"""What the pictures share: one look for each method, and small parts."""

from __future__ import annotations

from typing import Any

from matplotlib.axes import Axes

_BLUE, _ORANGE, _GREEN, _PINK, _YELLOW, _SKY, _BLACK = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000",
)  # fmt: skip
_COLOR_OF_SEARCH = {
    "G-ALS": _GREEN,
    "T-ALS": _BLUE,
    "exact": _ORANGE,
    "soft": _YELLOW,
    "backtracking": _PINK,
}
_COLOR_OF_METHOD = {"LM": _BLACK, "Nielsen": _BLACK, "Dog-Leg": _SKY}
_DASHES_OF_METHOD = {"LM": "-", "Dog-Leg": "--", "Nielsen": ":"}


def line_style(label: str) -> dict[str, Any]:
    """Colour by line search, dashes by method, markers for variants."""
    name, _, variant = label.partition(", ")
    method, _, search = name.partition("+")
    color = _COLOR_OF_SEARCH[search] if search else _COLOR_OF_METHOD[method]
    marker = {"": "o", "D = I": "x", "1/depth": "^"}[variant]
    return {"color": color, "linestyle": _DASHES_OF_METHOD[method], "marker": marker, "label": label}


def figure_legend(axes: Axes, columns: int) -> None:
    """One legend below all axes of the figure, from the lines of one of them."""
    handles, labels = axes.get_legend_handles_labels()
    figure = axes.figure
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, fontsize=8.5, frameon=False)
