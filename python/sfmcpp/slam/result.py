"""Result of a SLAM run: poses, keyframe records, the final adjustment."""

from __future__ import annotations

import heapq
from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model import Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.frames import Frame
from sfmcpp.sensors import predict_pose
from sfmcpp.slam.fusion import Fused
from sfmcpp.slam.world_map import WorldMap
from sfmcpp.weighting import WeightSelection


@dataclass
class Path:
    """Poses of the camera at all frames.

    Attributes
    ----------
    between : dict of int to (3, 4) float64
        Pose of each frame that has one and is no keyframe, world_from_camera; the map has those of keyframes.
    times : dict of int to float
        Time of each frame looked at [s].
    world : WorldMap or None
        The map, as soon as there is one.
    seen_from : dict of int to (3, 3) float64
        Rotation that the images alone say of a frame between keyframes, in the axes of its pose: where a
        gyroscope has told that, they are different.
    """

    between: dict[int, FloatArray] = field(default_factory=dict)
    times: dict[int, float] = field(default_factory=dict)
    world: WorldMap | None = None
    seen_from: dict[int, FloatArray] = field(default_factory=dict)

    @property
    def poses(self) -> dict[int, FloatArray]:
        """Pose (3, 4) of every frame that has one, put together anew each time."""
        keyframes = self.world.keyframes if self.world else []
        return {**self.between, **{keyframe.frame: keyframe.pose for keyframe in keyframes}}

    def latest(self, count: int, without: Collection[int] = ()) -> dict[int, FloatArray]:
        """Poses of the last `count` frames that have one, in their order."""
        poses = self.poses
        last = heapq.nlargest(count, (k for k in poses if k not in without))[::-1]
        return {number: poses[number] for number in last}

    def transform(self, similarity: Similarity, first: int = 0) -> None:
        """Move the poses between keyframes, of the frames from number `first` on (thesis eq. 5.16)."""
        for number in [k for k in self.between if k >= first]:
            self.between[number] = similarity.apply_to_poses(self.between[number])

    def settle(self, number: int, pose: FloatArray) -> None:
        """Put a frame between keyframes elsewhere; what the images alone say of its rotation stays."""
        seen = self.between[number][:, :3] @ self.seen_from.get(number, np.eye(3))
        self.between[number] = pose
        self.seen_from[number] = pose[:, :3].T @ seen

    def follow(self, before: FloatArray) -> None:
        """Let the frames between keyframes go where an adjustment has moved these.

        Parameters
        ----------
        before : (k, 3, 4) float64
            Poses of the keyframes before it. A frame keeps its pose beside the keyframe before it and its
            pose beside the one after, and where the two have become different, some of both, by time.
        """
        assert self.world is not None
        keyframes, after = self.world.keyframes, self.world.poses
        moved = np.flatnonzero((before != after).any(axis=(1, 2)))
        if not len(moved):
            return
        for k in range(max(int(moved[0]) - 1, 0), len(keyframes)):
            end = keyframes[k + 1].frame if k + 1 < len(keyframes) else max(self.times) + 1
            numbers = [f for f in range(keyframes[k].frame + 1, end) if f in self.between]
            if not numbers:
                continue
            poses = np.stack([self.between[f] for f in numbers])
            ends = slice(k, k + 2)
            stamps = np.array([keyframe.t_s for keyframe in keyframes[ends]])
            times = np.array([self.times[f] for f in numbers])
            carried = carry(poses, times, stamps, before[ends], after[ends])
            self.between.update(zip(numbers, carried, strict=True))

    def predict(self, time_s: float) -> FloatArray:
        """Pose (3, 4) at a later time by constant motion from the last two (thesis eqs 1.1–1.3)."""
        latest = self.latest(2)
        *earlier, last = latest
        now = latest[last]
        if not earlier:
            return np.array(now)
        before, first_s, last_s = latest[earlier[0]], self.times[earlier[0]], self.times[last]
        rotation = now[:, :3] @ before[:, :3].T
        rate = so3.log(before[:, :3].T @ now[:, :3]) / (last_s - first_s)
        # The body keeps its velocity in its own axes: it follows a bend.
        velocity = rotation @ (now[:, 3] - before[:, 3]) / (last_s - first_s)
        return predict_pose(now, rate, velocity, time_s - last_s)

    def speed(self, steps: int = 5, without: Collection[int] = ()) -> float:
        """Median speed over the last steps, in units of the map per second."""
        last = self.latest(steps + 1, without)
        if len(last) < 2:
            return 0.0
        centres = np.stack([pose[:, 3] for pose in last.values()])
        lengths = np.linalg.norm(np.diff(centres, axis=0), axis=1)
        return float(np.median(lengths / np.diff([self.times[k] for k in last])))


def carry(
    poses: FloatArray, times_s: FloatArray, stamps_s: FloatArray, before: FloatArray, after: FloatArray
) -> FloatArray:
    """Poses (n, 3, 4) that keep their place beside one or two others, which have moved.

    Parameters
    ----------
    poses : (n, 3, 4) float64
        World_from_camera, with the two.
    times_s : (n,) float64
        Their times [s].
    stamps_s : (1,) or (2,) float64
        Times of the others, before and after [s].
    before, after : (1, 3, 4) or (2, 3, 4) float64
        Where the others were and are.

    Returns
    -------
    (n, 3, 4) float64
    """
    turns = after[:, :, :3] @ np.swapaxes(before[:, :, :3], 1, 2)
    beside = [t @ (poses[:, :, 3] - b[:, 3]).T for t, b in zip(turns, before, strict=True)]
    centres = [b.T + a[:, 3] for b, a in zip(beside, after, strict=True)]
    if len(stamps_s) == 1:
        return np.concatenate([turns[0] @ poses[:, :, :3], centres[0][:, :, None]], axis=2)
    share = ((times_s - stamps_s[0]) / (stamps_s[1] - stamps_s[0]))[:, None]
    rest = so3.exp(share * so3.log(turns[0].T @ turns[1]))
    rotations = turns[0] @ rest @ poses[:, :, :3]
    return np.concatenate([rotations, ((1 - share) * centres[0] + share * centres[1])[:, :, None]], axis=2)


@dataclass
class KeyframeRecord:
    """Record of one keyframe, for the report.

    Attributes
    ----------
    frame : int
        Number of the frame.
    t_s : float
        Its time [s].
    inliers : int
        Points of the map that it saw.
    new_points : int
        Points that it gave to the map.
    milliseconds : dict of str to float
        Time of each stage [ms].
    weights : dict of str to float
        λ of each sensor's constraint.
    conflicts : dict of str to float
        By how many standard deviations each sensor disagrees with the images.
    selections : list of WeightSelection
        The whole curves that the weights were chosen from, one per sensor.
    """

    frame: int
    t_s: float
    inliers: int
    new_points: int
    milliseconds: dict[str, float] = field(default_factory=dict)
    weights: dict[str, float] = field(default_factory=dict)
    conflicts: dict[str, float] = field(default_factory=dict)
    selections: list[WeightSelection] = field(default_factory=list, repr=False)

    @classmethod
    def of(
        cls, frame: Frame, fused: Fused, inliers: int, new_points: int, milliseconds: dict[str, float]
    ) -> KeyframeRecord:
        """Make it of a frame that has become a keyframe."""
        weights = {c.measurement.sensor: c.weight for c in fused.constraints}
        conflicts = {s.name: s.conflict.sigmas for s in fused.selections}
        fusion = (weights, conflicts, list(fused.selections))
        return cls(frame.number, frame.t_s, inliers, new_points, milliseconds, *fusion)


@dataclass(frozen=True)
class FinalAdjustment:
    """Result of the adjustment of all keyframes.

    Attributes
    ----------
    kept : bool
        Whether the map is the adjusted one.
    pixels : tuple of float
        Robust cost of the images before and after.
    sensors : dict of str to (float, float)
        Cost of what each sensor says, before and after.
    """

    kept: bool
    pixels: tuple[float, float]
    sensors: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def improved(self) -> bool:
        """Whether it brought the images nearer to the map, and every sensor too; one at least must tell."""
        return bool(self.sensors) and all(
            after < before for before, after in (self.pixels, *self.sensors.values())
        )

    def describe(self) -> str:
        """Description in a sentence."""
        costs = {"images": self.pixels, **self.sensors}
        text = ", ".join(f"{name} {before:.4g} to {after:.4g}" for name, (before, after) in costs.items())
        return f"{'kept' if self.kept else 'not kept'}: cost of {text}"


@dataclass
class SlamResult:
    """Result of a run so far.

    Attributes
    ----------
    path : Path
        Pose of every frame that has one, time of every frame, and the map.
    records : list of KeyframeRecord
        One per keyframe after the first three.
    bridged : list of int
        Frames whose pose follows from the frame before alone, the length of the step from the speed so far.
    lost : list of int
        Frames after the start whose images say too little: their poses are predicted, by the sensors or at
        constant velocity.
    restarts : list of int
        Frames at which a new part of the map begins, after the images had lost the one before: placed by the
        poses that bridge the gap, and by the sensors.
    corrections : list of int
        Keyframes at which the last part of the map was moved back to where an absolute sensor says it is.
    metric : bool
        Whether the map is in the sensors' world: in metres, and in their frame where they give positions.
        Else its unit and its frame are its own.
    final : FinalAdjustment or None
        What adjusting all keyframes at the end did, where it was asked for.
    warnings : list of str
        What is wrong with the sensors' streams by themselves, and with their rotations beside the camera's.
    message : str
        Why there is no map, or empty.
    seconds : float
        How long it took so far [s].
    """

    path: Path = field(default_factory=Path)
    records: list[KeyframeRecord] = field(default_factory=list)
    bridged: list[int] = field(default_factory=list)
    lost: list[int] = field(default_factory=list)
    restarts: list[int] = field(default_factory=list)
    corrections: list[int] = field(default_factory=list)
    metric: bool = False
    final: FinalAdjustment | None = None
    warnings: list[str] = field(default_factory=list)
    message: str = "there is no frame"
    seconds: float = 0.0

    @property
    def world(self) -> WorldMap | None:
        """The map; None as long as it has not started."""
        return self.path.world

    @property
    def poses(self) -> dict[int, FloatArray]:
        """Pose (3, 4) of every frame that has one, world_from_camera."""
        return self.path.poses

    @property
    def doubtful(self) -> set[int]:
        """Frames whose poses do not come from the map."""
        return {*self.bridged, *self.lost}

    def trust(self, frame: int) -> None:
        """Take a frame for one whose pose comes from the map after all."""
        self.bridged, self.lost = ([k for k in some if k != frame] for some in (self.bridged, self.lost))

    def trajectory(self) -> Trajectory:
        """All frames with a pose, in order."""
        poses = self.poses
        frames = sorted(poses)
        times = np.array([self.path.times[k] for k in frames])
        return Trajectory(times, np.stack([poses[k] for k in frames]))

    def seen_trajectory(self, first: int = 0) -> Trajectory:
        """All frames from number `first` on with a pose, turned as the images alone say.

        It is what a gyroscope can be compared with.
        """
        poses = {k: np.array(pose) for k, pose in sorted(self.poses.items()) if k >= first}
        for frame, pose in poses.items():
            pose[:, :3] = pose[:, :3] @ self.path.seen_from.get(frame, np.eye(3))
        return Trajectory(np.array([self.path.times[k] for k in poses]), np.stack(list(poses.values())))

    def keyframe_trajectory(self) -> Trajectory:
        """Keyframes alone."""
        assert self.world is not None
        keyframes = self.world.keyframes
        return Trajectory(np.array([k.t_s for k in keyframes]), self.world.poses.copy())
