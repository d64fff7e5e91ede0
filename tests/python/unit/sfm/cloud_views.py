"""What five cameras at different distances see of a cloud of points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry import so3
from sfmcpp.model.arrays import FloatArray

FOCAL_PX = 900.0


def views_of_cloud(
    size: NDArray[np.int64], noise_px: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
    """Image and point of each observation in images of this size, and its pixel (M, 2) from their corner."""
    rng = np.random.default_rng(1)
    points = rng.uniform(-2, 2, (250, 3))
    pixels = []
    for k in range(5):
        about = so3.exp(np.array([0.1 * rng.standard_normal(), 0.26 * (k - 2), 0.1 * rng.standard_normal()]))
        seen = points @ about.T + [*rng.uniform(-0.5, 0.5, 2), 7 * (1 + 0.25 * rng.uniform(-1, 1))]
        pixels.append(FOCAL_PX * seen[:, :2] / seen[:, 2:] + size / 2)
    noisy = np.array(pixels) + noise_px * rng.standard_normal((5, 250, 2))
    image, point = np.nonzero(((noisy > 0) & (noisy < size)).all(axis=2))
    return image, point, noisy[image, point]
