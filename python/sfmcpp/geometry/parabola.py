"""The parabola through three values that are evenly spaced."""

from __future__ import annotations


def parabola_minimum(before: float, here: float, after: float, step: float = 1.0) -> tuple[float, float]:
    """Find where the parabola through three values is lowest, and how much it bends.

    Parameters
    ----------
    before, here, after : float
        Values at −`step`, 0 and `step`.
    step : float
        Distance from each to the next.

    Returns
    -------
    (float, float)
        Where the minimum is, 0 if there is none; the second difference of the values, positive if there is.
    """
    second_difference = float(before - 2 * here + after)
    if not second_difference > 0:
        return 0.0, second_difference
    return float(step * 0.5 * (before - after) / second_difference), second_difference
