"""A drive with bends and some nodding, as a gyroscope and pairs of images see it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sensor_helpers import MOUNTING
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import SensorStream, Turn

T_S = np.arange(0.0, 42.0, 0.01)
STEP_S = 0.5


def rates() -> FloatArray:
    """Bends to either side, and some nodding [rad/s]."""
    return np.column_stack([0.05 * np.sin(3 * T_S), 0.1 * np.cos(2 * T_S), 0.4 * np.sin(0.5 * T_S)])


def stream_of(values: FloatArray) -> SensorStream:
    return SensorStream(T_S, values, "angular_rate")


def turns(noise_rad: float = 0.0015, seed: int = 0) -> list[Turn]:
    """What images see of that motion; every seventh pair wrongly."""
    rng = np.random.default_rng(seed)
    to_camera = Rotation.from_matrix(MOUNTING.camera_from_body)
    steps = Rotation.from_rotvec(rates() * 0.01)
    made = []
    for k in range(80):
        start = round(k * STEP_S / 0.01)
        seen = Rotation.identity()
        for step in steps[start : start + round(STEP_S / 0.01)]:
            seen = seen * step
        noise = Rotation.from_rotvec(rng.normal(0, 0.05 if k % 7 == 3 else noise_rad, 3))
        seen = to_camera * seen * to_camera.inv() * noise
        made.append(Turn(k * STEP_S, (k + 1) * STEP_S, seen.as_matrix()))
    return made
