"""What the pictures share: one look for each method, and small parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
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
    marker = {"": "o", "D = I": "x", "1/depth": "^", "rejected": "s", "damped": "d", "refitted": "P"}[variant]
    return {"color": color, "linestyle": _DASHES_OF_METHOD[method], "marker": marker, "label": label}


def grouped_bars(axes: Axes, heights: Mapping[str, Sequence[float]]) -> None:
    """Bars side by side over 0, 1, …: one of each label in every group."""
    width = 0.8 / len(heights)
    for k, (label, values) in enumerate(heights.items()):
        axes.bar(np.arange(len(values)) + (k - len(heights) / 2 + 0.5) * width, values, width, label=label)


def figure_legend(axes: Axes, columns: int) -> None:
    """One legend below all axes of the figure, from the lines of one of them."""
    handles, labels = axes.get_legend_handles_labels()
    figure = axes.figure
    figure.legend(handles, labels, loc="outside lower center", ncols=columns, fontsize=8.5, frameon=False)
