"""What SLAM is run on: KITTI drives from files, and synthetic ones whose noise is known."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TypeVar

import numpy as np

from experiments.description import Experiment, ExperimentError
from experiments.faults import Flaws, SensorFaults
from experiments.real_problems import data_folder
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import Mounting, measured_at, orientations, pose_stream_values, rotation_increment
from sfmcpp.slam import Gps, Gyroscope, Ins, MotionSensor, Odometer, TrackSequence
from sfmcpp.slam.measurement import Measurement
from sfmcpp.sources.drives import tracks_of_kitti
from sfmcpp.sources.io.kitti_mat import KittiDrive, read_kitti_mat
from sfmcpp.sources.synthetic import DRIVES, SyntheticDrive

Drive = KittiDrive | SyntheticDrive

KITTI = "KITTI"
# Settings are chosen on these drives alone; all others are for reporting.
TUNING = ("0001", "0027", "0036", "0039")
# Noise that tells runs of a real drive apart, and changes nothing else.
MOVED_PX = 1e-6
PROCESSES = 2
Found = TypeVar("Found")
# White noise of simulated positions and poses.
GPS_SIGMA_M, INS_SIGMA_M, INS_SIGMA_RAD = 1.0, 0.3, 0.003


@dataclass(frozen=True, eq=False)
class Input:
    """A drive that is yet to be made, its name, and the groups in which it is summed up.

    Attributes
    ----------
    name : str
        The same for all runs of a drive.
    groups : tuple of str
        Groups of drives to which it belongs.
    seed : int
        Seed of the scene and its noise, or of the noise that moves the pixels of a real drive.
    make : callable
        Makes the drive.
    loop_seed : int
        Seed of the random samples of SLAM.
    """

    name: str
    groups: tuple[str, ...]
    seed: int
    make: Callable[[], Drive]
    loop_seed: int = 0


_FAULT_FREE = SensorFaults(0.0, 0.0)


@dataclass(frozen=True, eq=False)
class TurnSensor:
    """Rotations that constrain keyframes and nothing else, as in the thesis.

    Their error is that of rotation matrices, ε^{k,dR} of thesis table 5.2 and figure 5.21: for the same σ, λ
    is 1.22 times that of the logarithm. Starts and resections do not use them.
    """

    stream: SensorStream
    mounting: Mounting
    name: str = "gyro"

    def measure(self, start_s: float, end_s: float, rotation: FloatArray) -> Measurement | None:
        """Rotation from the keyframe before."""
        turn = rotation_increment(self.stream, start_s, end_s)
        if turn is None:
            return None
        return Measurement(self.name, "displacement-rotation", self.mounting.camera_rotation(turn), None)


def inputs_of(experiment: Experiment) -> Iterator[Input]:
    """The drives of an experiment: its files, or patterns of them, then those of ``settings.synthetic``.

    Each file is run ``settings.runs_of_a_file`` times, once by default, with pixels moved by `MOVED_PX` and
    other random samples: moved pixels alone change no figure of four digits.
    Synthetic drives are one for each seed, with every one of ``settings.flaws`` (arguments of :class:`Flaws`,
    and a `label`).
    """
    settings = experiment.settings
    again = range(min(experiment.runs, settings.get("runs_of_a_file", 1)))
    for file, seed in product(drive_files(experiment), again):
        name = file.name[5:].partition("_sync")[0]
        use = "tuning" if name.endswith(TUNING) else "reporting"
        yield Input(name, (f"{KITTI} {use}", KITTI), seed, partial(_read, file, seed), seed)
    for kind, flaws in product(settings.get("synthetic", []), settings.get("flaws", [{}])):
        group = " ".join([kind, *filter(None, [flaws.get("label")])])
        wrong = Flaws(**{key: value for key, value in flaws.items() if key != "label"})
        for seed in experiment.seeds:
            yield Input(f"{group} {seed}", (group,), seed, partial(_made, DRIVES[kind], seed, wrong))


def on_all_inputs(experiment: Experiment, measure: Callable[[Input], Found]) -> list[tuple[Input, Found]]:
    """Measure every input, `PROCESSES` at a time; the inputs and what was found, in order.

    Standard error hears of each, as it takes minutes.
    """
    inputs, done = list(inputs_of(experiment)), []
    print(f"{experiment.name}: 0 of {len(inputs)} drives done", file=sys.stderr, flush=True)
    with ProcessPoolExecutor(PROCESSES) as pool:
        for item, found in zip(inputs, pool.map(measure, inputs), strict=True):
            done.append((item, found))
            told = f"{experiment.name}: {len(done)} of {len(inputs)} drives done, {item.name}"
            print(told, file=sys.stderr, flush=True)
    return done


def drive_files(experiment: Experiment) -> list[Path]:
    """The data files of an experiment, which may name them by patterns."""
    found = [path for pattern in experiment.files for path in sorted(data_folder().glob(pattern))]
    if len(found) < len(experiment.files):
        raise ExperimentError(f"{data_folder()}: {', '.join(experiment.files)} are not all there")
    return found


def _read(file: Path, seed: int) -> Drive:
    return moved(read_kitti_mat(file), seed)


def _made(make: Callable[..., SyntheticDrive], seed: int, flaws: Flaws) -> Drive:
    drive = make(seed=seed)
    return replace(drive, orientation=flaws.spoil(drive.orientation, seed))


def sequence_of(drive: Drive, stereo: bool = False) -> TrackSequence:
    """Tracks of its one camera, the left one; with `stereo` of both of KITTI's."""
    if not isinstance(drive, KittiDrive):
        return TrackSequence(drive.t_s, drive.frame_index, drive.track_index, drive.pixels, drive.intrinsics)
    return tracks_of_kitti(drive, stereo=stereo)


def mounting_of(drive: Drive) -> Mounting:
    """How the camera sits on the body."""
    return Mounting(drive.camera_from_body, drive.lever_arm_m)


def sensor_of_drive(drive: Drive, name: str, faults: SensorFaults | None = None) -> MotionSensor:
    """Make ``odometer``, ``velocity``, ``imu``, ``rotation`` (:class:`TurnSensor`), ``gps`` or ``ins``.

    The first measures distances only, as in the thesis; the second also directions, if the drive has them.
    The last two are simulated from the truth, at every image, with white noise.
    """
    faults = faults or _FAULT_FREE
    if name in ("odometer", "velocity"):
        mounting, directions = faults.misplace(mounting_of(drive)), name == "velocity"
        return Odometer(faults.spoil(_velocity(drive)), mounting=mounting, directions=directions)
    if name == "imu":
        return Gyroscope(faults.spoil(drive.angular_rate), faults.misplace(mounting_of(drive)))
    if name in ("gps", "ins"):
        return _absolute(drive, name)
    return TurnSensor(rotation_stream(drive), mounting_of(drive))


def _absolute(drive: Drive, name: str) -> MotionSensor:
    """Make a GPS of 1 m, or an INS of 0.3 m and 0.003 rad."""
    mounting, rng = mounting_of(drive), np.random.default_rng(0)
    truth = pose_stream_values(mounting.body_poses(drive.truth.poses))
    if name == "gps":
        fixes = truth[:, :3] + rng.normal(0.0, GPS_SIGMA_M, (len(truth), 3))
        return Gps(SensorStream(drive.truth.t_s, fixes, "position"), mounting, sigma_m=GPS_SIGMA_M)
    noise = np.repeat([INS_SIGMA_M, INS_SIGMA_RAD], 3) * rng.normal(size=truth.shape)
    return Ins(SensorStream(drive.truth.t_s, truth + noise, "pose"), mounting, sigma_m=INS_SIGMA_M)


def rotation_stream(drive: Drive) -> SensorStream:
    """Orientations of a synthetic drive; angular rates of a real one, which has none."""
    return drive.orientation if isinstance(drive, SyntheticDrive) else drive.angular_rate


def moved(drive: KittiDrive, seed: int) -> KittiDrive:
    """The drive itself for seed 0, else with noise of `MOVED_PX` on its pixels."""
    if not seed:
        return drive
    noise = np.random.default_rng(seed).normal(0.0, MOVED_PX, drive.left_px.shape)
    return replace(drive, left_px=drive.left_px + noise)


def dead_reckoning(drive: Drive) -> Trajectory:
    """Path of the camera by velocity and angular rate, without images, as far as both are measured."""
    velocity = _velocity(drive)
    times = drive.t_s[(drive.t_s <= velocity.t_s[-1]) & (drive.t_s <= drive.angular_rate.t_s[-1])]
    rotations = orientations(drive.angular_rate, times)
    velocities = np.einsum("nij,nj->ni", rotations, _forward(measured_at(velocity, times)))
    steps = 0.5 * (velocities[1:] + velocities[:-1]) * np.diff(times)[:, None]
    centres = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    body = np.concatenate([rotations, centres[:, :, None]], axis=2)
    known = np.isfinite(body).all(axis=(1, 2))
    return Trajectory(times[known], mounting_of(drive).camera_poses(body[known]))


def has_odometer(drive: Drive) -> bool:
    """Whether the drive has speeds or velocities."""
    return isinstance(drive, KittiDrive) or drive.odometer is not None


def _velocity(drive: Drive) -> SensorStream:
    stream = drive.velocity if isinstance(drive, KittiDrive) else drive.odometer
    assert stream is not None
    return stream


def _forward(measured: FloatArray) -> FloatArray:
    """Velocities (n, 3) of the body, from themselves or from speeds (n, 1)."""
    return np.pad(measured, ((0, 0), (0, 3 - measured.shape[1])))
