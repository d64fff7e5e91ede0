"""How a model was brought into the world of positions, as rows of a table."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from sfmcpp.study.reasons import listed

if TYPE_CHECKING:
    from sfmcpp.sfm import GpsOutcome


def gps_rows(gps: GpsOutcome) -> Iterator[tuple[str, str]]:
    """σ of the positions, accuracy of the model, positions that were left out, origin."""
    yield "GPS", f"σ {gps.sigma_m:.3g} m{_stated(gps)}; accuracy of the model {gps.accuracy_m:.3g} m (1 σ)"
    if gps.outliers:
        yield "GPS left out", listed(gps.outliers)
    if np.any(gps.origin):
        yield "origin", told_origin(gps)


def told_origin(gps: GpsOutcome) -> str:
    """The numbers of the origin with their names."""
    return ", ".join(f"{name} {value:.10g}" for name, value in gps.world_origin.to_dict().items())


def _stated(gps: GpsOutcome) -> str:
    if gps.stated_sigma_m is None:
        return ""
    same = gps.sigma_m == gps.stated_sigma_m
    return " as stated" if same else f" (stated: {gps.stated_sigma_m:.3g} m)"
