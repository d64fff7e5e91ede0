"""Motions with known answers, from SciPy's rotations rather than ours."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sfmcpp.sensors import Mounting, SensorStream

# About no axis of the camera.
MOUNTING = Mounting(Rotation.from_euler("xyz", [0.5, -1.2, 0.8]).as_matrix(), np.zeros(3))


def rate_at(t_s: np.ndarray) -> np.ndarray:
    """Angular rates (n, 3) [rad/s] of a body that tumbles smoothly about all three axes."""
    return np.stack([0.4 * np.sin(1.3 * t_s), 0.3 * np.cos(0.7 * t_s), 0.5 + 0.2 * np.sin(2.1 * t_s)], axis=1)


def orientation_from(start_s: float, end_s: float, step_s: float = 1e-3) -> Rotation:
    """Rotation start_from_end of that body, by steps so fine that their error does not matter."""
    steps = max(1, round((end_s - start_s) / step_s))
    edges = np.linspace(start_s, end_s, steps + 1)
    turn = Rotation.identity()
    for step in Rotation.from_rotvec(rate_at(0.5 * (edges[1:] + edges[:-1])) * (edges[1] - edges[0])):
        turn = turn * step
    return turn


def gyro(rate_hz: float = 100.0, seconds: float = 4.0, **options: float) -> SensorStream:
    """A gyroscope on that body."""
    t_s = np.arange(0.0, seconds + 1e-9, 1 / rate_hz)
    return SensorStream(t_s, rate_at(t_s), "angular_rate", "gyro", **options)
