"""Motions of the camera by pairs of images, with which sensors are compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sfmcpp.model.arrays import FloatArray

# Clock offsets tried of sensors that are compared with them [s].
CLOCK_OFFSETS_S = np.linspace(-1.0, 1.0, 41)


@dataclass(frozen=True, eq=False)
class Turn:
    """Motion of the camera between the times of two images, by these images alone.

    Attributes
    ----------
    start_s, end_s : float
        The times [s].
    rotation : (3, 3) float64
        Start_from_end of the camera.
    direction : (3,) float64
        Unit vector along the step, in the camera's axes at the start; NaN where it is not known.
    covariance : (3, 3) float64
        Of `direction`; NaN where it is not known.
    parallax_px : float
        Motion that the rotation leaves to be explained, the lower quartile of all points [px]: some may move
        before a camera that stands. NaN where it is not known.
    """

    start_s: float
    end_s: float
    rotation: FloatArray
    direction: FloatArray = field(default_factory=lambda: np.full(3, np.nan))
    covariance: FloatArray = field(default_factory=lambda: np.full((3, 3), np.nan))
    parallax_px: float = np.nan


def times_of(turns: Sequence[Turn]) -> FloatArray:
    """Times (n, 2) of both ends of each motion [s]."""
    return np.array([[turn.start_s, turn.end_s] for turn in turns])


def rotations_of(turns: Sequence[Turn]) -> FloatArray:
    """Rotations (n, 3, 3) start_from_end of the motions."""
    return np.stack([turn.rotation for turn in turns])
