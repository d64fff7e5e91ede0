"""The weights among which one is selected."""

from __future__ import annotations

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray


def weight_grid(count: int = 100, smallest: float = 1e-3, largest: float = 1e3) -> FloatArray:
    """Zero and log-spaced weights (thesis eq. 5.6, with both ends included).

    Parameters
    ----------
    count : int
        Number of weights, zero included; at least 3.
    smallest, largest : float
        Ends of the positive weights.

    Returns
    -------
    (count,) float64
        Increasing weights, the first of them zero.

    Raises
    ------
    InvalidArgument
        If `count` is too small or the ends are not positive, finite and in order.
    """
    if count < 3:
        raise InvalidArgument(f"count = {count}: must be at least 3")
    if not 0 < smallest < largest < np.inf:
        raise InvalidArgument(f"smallest = {smallest}, largest = {largest}: must be positive and in order")
    return np.concatenate([[0.0], np.geomspace(smallest, largest, count - 1)])
