"""What SLAM is run on: KITTI drives from files, and synthetic ones whose noise is known."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from experiments.description import Experiment
from experiments.real_problems import data_folder
from sfmcpp.io.kitti_mat import KittiDrive, read_kitti_mat
from sfmcpp.model import SensorStream
from sfmcpp.sensors import Mounting
from sfmcpp.slam import Gyroscope, MotionSensor, Odometer, TrackSequence
from sfmcpp.synthetic import DRIVES, SyntheticDrive

Drive = KittiDrive | SyntheticDrive

KITTI = "KITTI"


@dataclass(frozen=True, eq=False)
class Input:
    """A drive, what it is called, and with which others it is summed up."""

    name: str
    group: str
    drive: Drive


@dataclass(frozen=True, eq=False)
class Lie:
    """What is wrong with a sensor for a while: speeds times `factor`, yaw rates plus `bias_deg_s`."""

    start_s: float
    seconds: float
    factor: float = 1.0
    bias_deg_s: float = 0.0

    def during(self, t_s: np.ndarray, first_s: float) -> np.ndarray:
        """Which of the stamps it covers."""
        return np.asarray((t_s - first_s >= self.start_s) & (t_s - first_s < self.start_s + self.seconds))


def inputs_of(experiment: Experiment) -> Iterator[Input]:
    """The drives of an experiment one after the other: its files, then those of ``settings.synthetic``."""
    for file in experiment.files:
        name = file.rpartition("/")[2][5:].partition("_sync")[0]
        yield Input(name, KITTI, read_kitti_mat(data_folder() / file))
    for kind in experiment.settings.get("synthetic", []):
        for seed in experiment.seeds:
            yield Input(f"{kind} {seed}", kind, DRIVES[kind](seed=seed))


def sequence_of(drive: Drive) -> TrackSequence:
    """Tracks of its one camera, the left one."""
    pixels = drive.left_px if isinstance(drive, KittiDrive) else drive.pixels
    return TrackSequence(drive.t_s, drive.frame_index, drive.track_index, pixels, drive.intrinsics)


def mounting_of(drive: Drive) -> Mounting:
    """How the camera sits on the body."""
    return Mounting(drive.camera_from_body, drive.lever_arm_m)


def sensor_of_drive(drive: Drive, name: str, lie: Lie | None = None) -> MotionSensor:
    """Make ``"odometer"``, ``"imu"`` or ``"rotation"`` (see :func:`rotation_stream`) of a drive."""
    if name == "odometer":
        stream = drive.velocity if isinstance(drive, KittiDrive) else drive.odometer
        assert stream is not None
        return Odometer(_lying(stream, lie, factor=True))
    if name == "imu":
        return Gyroscope(_lying(drive.angular_rate, lie, factor=False), mounting_of(drive))
    return Gyroscope(rotation_stream(drive), mounting_of(drive))


def rotation_stream(drive: Drive) -> SensorStream:
    """The best that a drive has on its orientations: its navigation system, or its gyro."""
    return drive.orientation if isinstance(drive, SyntheticDrive) else drive.angular_rate


def _lying(stream: SensorStream, lie: Lie | None, *, factor: bool) -> SensorStream:
    if lie is None:
        return stream
    values = stream.values.copy()
    during = lie.during(stream.t_s, stream.t_s[0])
    if factor:
        values[during] *= lie.factor
    else:
        values[during, 2] += np.radians(lie.bias_deg_s)
    return SensorStream(stream.t_s, values, stream.kind, stream.name)
