"""Figures: every function returns a Matplotlib figure; nothing is shown and no global state is touched."""

try:
    import matplotlib  # noqa: F401
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"figures need {error.name}: pip install 'sfmcpp[plot]'", name=error.name
    ) from None

from sfmcpp.study.plotting.convergence import plot_convergence
from sfmcpp.study.plotting.style import FIGURE_SUFFIXES, figure_format, save_figure
from sfmcpp.study.plotting.weights import plot_group_weights

__all__ = ["FIGURE_SUFFIXES", "figure_format", "plot_convergence", "plot_group_weights", "save_figure"]
