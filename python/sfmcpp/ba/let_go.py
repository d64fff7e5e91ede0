"""A robust loss that has let go of nearly everything: the solve then ends where it began, and converged."""

from __future__ import annotations

from typing import Any

import numpy as np

from sfmcpp import _core
from sfmcpp.ba.ranks import Ranks
from sfmcpp.ba.summary import Summary

LITTLE_WEIGHT, MOST = 0.1, 0.5
# Tukey's weight is little from 0.83 of its scale on, that of all others only farther out. If most errors are
# as large, the RMS of a coordinate is at least this part of the scale: below it nothing needs to be counted.
_LEAST_RMS = 0.4


def warnings_about_the_loss(
    arrays: dict[str, Any], summary: Summary, ranks: Ranks | None = None
) -> list[str]:
    """What to know of the weights at the end of a solve of these arrays, of which each rank has a part."""
    if summary.loss == "squared" or summary.final_rms_px < _LEAST_RMS * summary.loss_scale_px:
        return []
    squared = np.square(_core.residuals(arrays)).sum(axis=1)
    _, weights, _ = _core.loss_terms(summary.loss, summary.loss_scale_px, squared)
    counts = np.array([np.count_nonzero(weights < LITTLE_WEIGHT), len(weights)])
    little, count = counts if ranks is None else np.sum(ranks.everyones(counts), axis=0)
    if little <= MOST * count:
        return []
    instead = "" if summary.loss == "auto" else ', or loss "auto"'
    share, scale = f"{little / count:.0%}", f"{summary.loss_scale_px:.4g} px"
    return [
        f"{share} of the observations are beyond the scale of the loss ({scale}) and have less than a tenth "
        f"of their weight: start from a better state, with a larger scale{instead}"
    ]
