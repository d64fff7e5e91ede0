"""Inertial navigation system: whole poses."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray
from sfmcpp.sensors.stream import measured_at, require_kind


@checked()
def pose_at(stream: SensorStream, time_s: float) -> FloatArray | None:
    """Pose of the body at a time: thesis eqs 5.22 and 5.23.

    Between samples the pose is interpolated, where the thesis, online, predicts from the last one; after the
    last sample it goes on with the velocities of the last two (eq. 5.23).

    Parameters
    ----------
    stream : SensorStream
        Of kind ``"pose"``.
    time_s : float
        When [s].

    Returns
    -------
    (3, 4) float64 or None
        ``[R | c]`` world_from_body; None if the stream does not cover that time.

    Raises
    ------
    InvalidArgument
        If the stream is of another kind.
    """
    require_kind(stream, "pose")
    if not stream.covers(time_s, time_s):
        return None
    value = measured_at(stream, np.array([time_s]))[0]
    return np.column_stack([so3.exp(value[3:]), value[:3]])


@checked(poses=(ANY, 3, 4))
def pose_stream_values(poses: FloatArray) -> FloatArray:
    """Poses (n, 3, 4) world_from_body as the values (n, 6) of a stream of kind ``"pose"``.

    Parameters
    ----------
    poses : (n, 3, 4) float64
        ``[R | c]`` of each sample.

    Returns
    -------
    (n, 6) float64
        Position [m], then rotation vector [rad].
    """
    return np.hstack([poses[:, :, 3], so3.log(poses[:, :, :3])])
