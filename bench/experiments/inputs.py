"""What SLAM is run on: KITTI drives from files, and synthetic ones whose noise is known."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TypeVar

import numpy as np

from experiments.description import Experiment, ExperimentError
from experiments.real_problems import data_folder
from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import Mounting, measured_at, orientations, pose_stream_values, rotation_increment
from sfmcpp.slam import Gps, Gyroscope, Ins, MotionSensor, Odometer, TrackSequence
from sfmcpp.slam.motion_sensors import Measurement
from sfmcpp.sources.io.kitti_mat import KittiDrive, read_kitti_mat
from sfmcpp.sources.synthetic import DRIVES, SyntheticDrive

Drive = KittiDrive | SyntheticDrive

KITTI = "KITTI"
# Settings are chosen on these drives alone; all others are for reporting.
TUNING = ("0001", "0027", "0036", "0039")
MOVED_PX = 1e-6
PROCESSES = 2
Found = TypeVar("Found")
GPS_SIGMA_M, INS_SIGMA_M, INS_SIGMA_RAD = 1.0, 0.3, 0.003


@dataclass(frozen=True, eq=False)
class Input:
    """A drive yet to be made, what it is called, and with which others it is summed up.

    Attributes
    ----------
    name : str
        Runs of one drive share it.
    groups : tuple of str
        What it counts in.
    seed : int
        Of the scene and its noise, or of what moves the pixels of a real drive.
    make : callable
        Makes it.
    loop_seed : int
        Of the random samples of SLAM on it.
    """

    name: str
    groups: tuple[str, ...]
    seed: int
    make: Callable[[], Drive]
    loop_seed: int = 0


@dataclass(frozen=True, eq=False)
class Lie:
    """What is wrong with sensors: for a while, or all the time.

    Attributes
    ----------
    start_s, seconds : float
        When it is, from the first sample on, and how long [s].
    factor : float
        Speeds are multiplied by it then …
    smooth : bool
        … all at once, or little by little, up to it in the middle and back.
    bias_deg_s : float
        Added to yaw rates then [deg/s].
    clock_s : float
        Stamps are late by so much all the time [s].
    mounting_deg : float
        The camera is turned about the body's z axis by so much from what is declared, all the time [deg].
    """

    start_s: float
    seconds: float
    factor: float = 1.0
    smooth: bool = False
    bias_deg_s: float = 0.0
    clock_s: float = 0.0
    mounting_deg: float = 0.0

    def during(self, t_s: np.ndarray, first_s: float) -> np.ndarray:
        """Which of the stamps it covers."""
        return np.asarray((t_s - first_s >= self.start_s) & (t_s - first_s < self.start_s + self.seconds))

    def strength(self, t_s: np.ndarray) -> np.ndarray:
        """From 0 to 1 at each of the stamps of a stream."""
        during = self.during(t_s, t_s[0])
        if not self.smooth:
            return during.astype(float)
        return during * np.sin(np.pi * (t_s - t_s[0] - self.start_s) / self.seconds) ** 2

    def spoil(self, stream: SensorStream) -> SensorStream:
        """The stream of speeds or rates as it is given."""
        values, strength = stream.values.copy(), self.strength(stream.t_s)
        if stream.kind == "angular_rate":
            values[:, 2] += np.radians(self.bias_deg_s) * strength
        else:
            values *= 1 + (self.factor - 1) * strength[:, None]
        return SensorStream(stream.t_s + self.clock_s, values, stream.kind, stream.name)

    def misplace(self, mounting: Mounting) -> Mounting:
        """The mounting as it is declared."""
        turned = so3.exp(np.radians(self.mounting_deg) * np.array([0.0, 0.0, 1.0]))
        return Mounting(mounting.camera_from_body @ turned, mounting.lever_arm_m)


_HONEST = Lie(0.0, 0.0)


@dataclass(frozen=True, eq=False)
class TurnSensor:
    """Rotations as in the thesis: they constrain keyframes and do nothing else.

    The error is that of a matrix of rotation, the thesis' ε^{k,dR}, as in its table 5.2 and figure 5.21: for
    the same σ, λ is 1.22 times that of the logarithm. Starts and resections are left to the images.
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


@dataclass(frozen=True)
class Flaws:
    """What is wrong with measured orientations, beside their own noise.

    Attributes
    ----------
    sigma_deg : tuple of float
        Standard deviation of white noise about each axis, over as many equal stretches of the run [deg].
    clock_s : float
        Its clock is late by so much [s].
    mounting_deg : float
        Its axes are turned by so much, about a direction of chance [deg].
    """

    sigma_deg: Sequence[float] = (0.0,)
    clock_s: float = 0.0
    mounting_deg: float = 0.0

    def spoil(self, stream: SensorStream, seed: int) -> SensorStream:
        """The stream as such a sensor would have given it."""
        rng = np.random.default_rng([seed, 1])
        axis = rng.standard_normal(3)
        turned = so3.exp(np.radians(self.mounting_deg) * axis / np.linalg.norm(axis))
        stretch = np.arange(len(stream)) * len(self.sigma_deg) // len(stream)
        sigmas = np.radians(np.asarray(self.sigma_deg)[stretch])[:, None]
        noise = so3.exp(sigmas * rng.standard_normal((len(stream), 3)))
        spoilt = so3.log(so3.exp(stream.values) @ turned @ noise)
        return SensorStream(stream.t_s + self.clock_s, spoilt, stream.kind, stream.name)


def inputs_of(experiment: Experiment) -> Iterator[Input]:
    """The drives of an experiment: its files, or patterns of them, then those of ``settings.synthetic``.

    Each file is run ``settings.runs_of_a_file`` times, once by default, with pixels moved by next to nothing
    and other random samples: moved pixels alone change no figure of four digits.
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
    """What is measured of each of the inputs, in their order, two at a time."""
    inputs = list(inputs_of(experiment))
    with ProcessPoolExecutor(PROCESSES) as pool:
        return list(zip(inputs, pool.map(measure, inputs), strict=True))


def drive_files(experiment: Experiment) -> list[Path]:
    """The files of an experiment, each of which may be a pattern of several."""
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
    right = (drive.right_px, drive.baseline_m) if stereo else ()
    seen = (drive.frame_index, drive.track_index, drive.left_px)
    return TrackSequence(drive.t_s, *seen, drive.intrinsics, *right)


def mounting_of(drive: Drive) -> Mounting:
    """How the camera sits on the body."""
    return Mounting(drive.camera_from_body, drive.lever_arm_m)


def sensor_of_drive(drive: Drive, name: str, lie: Lie | None = None) -> MotionSensor:
    """Make ``odometer``, ``velocity``, ``imu``, ``rotation`` (:class:`TurnSensor`), ``gps`` or ``ins``.

    The first tells distances alone, as in the thesis; the second directions, too, where the drive has them.
    The last two are simulated from the truth, at every image, with white noise.
    """
    told = lie or _HONEST
    if name in ("odometer", "velocity"):
        mounting, directions = told.misplace(mounting_of(drive)), name == "velocity"
        return Odometer(told.spoil(_velocity(drive)), mounting=mounting, directions=directions)
    if name == "imu":
        return Gyroscope(told.spoil(drive.angular_rate), told.misplace(mounting_of(drive)))
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
    """The best that a drive has on its orientations: its navigation system, or its gyro."""
    return drive.orientation if isinstance(drive, SyntheticDrive) else drive.angular_rate


def moved(drive: KittiDrive, seed: int) -> KittiDrive:
    """The drive itself for seed 0, else with its pixels moved by next to nothing."""
    if not seed:
        return drive
    noise = np.random.default_rng(seed).normal(0.0, MOVED_PX, drive.left_px.shape)
    return replace(drive, left_px=drive.left_px + noise)


def dead_reckoning(drive: Drive) -> Trajectory:
    """Integrate velocity and rate, without a camera, up to where both are measured."""
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
    """Whether anything measures its way."""
    return isinstance(drive, KittiDrive) or drive.odometer is not None


def _velocity(drive: Drive) -> SensorStream:
    stream = drive.velocity if isinstance(drive, KittiDrive) else drive.odometer
    assert stream is not None
    return stream


def _forward(measured: FloatArray) -> FloatArray:
    """Velocities (n, 3) of the body, from themselves or from speeds (n, 1)."""
    return np.pad(measured, ((0, 0), (0, 3 - measured.shape[1])))
