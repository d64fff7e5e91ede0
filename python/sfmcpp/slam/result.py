"""Result of a SLAM run: the path, keyframe records, the final adjustment, warnings."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.slam.fusion import Fused
from sfmcpp.slam.path import Path
from sfmcpp.slam.world_map import WorldMap
from sfmcpp.weighting import WeightSelection


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
    step_sigma : float
        Relative standard deviation of the distance to the keyframe before, by the images alone; 0 where the
        map is in metres, as sensors hold the scale, or the step is too short to give points.
    selections : list of WeightSelection
        The whole curves that the weights were chosen from, one per sensor; of a run with many keyframes kept
        for some, evenly spread (:meth:`SlamResult.record`).
    """

    frame: int
    t_s: float
    inliers: int
    new_points: int = 0
    milliseconds: dict[str, float] = field(default_factory=dict)
    weights: dict[str, float] = field(default_factory=dict)
    conflicts: dict[str, float] = field(default_factory=dict)
    step_sigma: float = 0.0
    selections: list[WeightSelection] = field(default_factory=list, repr=False)

    def take_fusion(self, fused: Fused) -> None:
        """Take weights, conflicts and curves from a fusion."""
        self.weights = {c.measurement.sensor: c.weight for c in fused.constraints}
        self.conflicts = {s.name: s.conflict.sigmas for s in fused.selections}
        self.selections = list(fused.selections)


# Curves are kept of so many keyframes at most: a plot shows a few, and those of an hour fill hundreds of MB.
_MOST_CURVES = 1024


def _apart(count: int) -> int:
    """Least power of two of which no more than `_MOST_CURVES` multiples are below a number."""
    return 1 << (max(count - 1, 0) // _MOST_CURVES).bit_length()


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

    def record(self, keyframe: KeyframeRecord) -> None:
        """Take the record of the next keyframe; of many only every second, fourth … keeps its curves."""
        self.records.append(keyframe)
        last = len(self.records) - 1
        apart = _apart(last + 1)
        for k in range(0 if apart > _apart(last) else last, last + 1):
            if k % apart:
                self.records[k].selections = []

    def trust(self, frame: int) -> None:
        """Take a frame for one whose pose comes from the map after all."""
        self.bridged, self.lost = ([k for k in some if k != frame] for some in (self.bridged, self.lost))

    def trajectory(self) -> Trajectory:
        """All frames with a pose, in order; InvalidArgument, with the `message`, if there is none."""
        poses = self.poses
        if not poses:
            raise InvalidArgument(f"no frame has a pose: {self.message}")
        frames = sorted(poses)
        times = np.array([self.path.times[k] for k in frames])
        return Trajectory(times, np.stack([poses[k] for k in frames]))

    def seen_trajectory(self, first: int = 0) -> Trajectory:
        """All frames from number `first` on with a pose, turned as the images alone say.

        It is what a gyroscope can be compared with.
        """
        poses = {k: np.array(pose) for k, pose in self.path.since(first).items()}
        for frame, pose in poses.items():
            pose[:, :3] = pose[:, :3] @ self.path.seen_from.get(frame, np.eye(3))
        return Trajectory(np.array([self.path.times[k] for k in poses]), np.stack(list(poses.values())))

    def keyframe_trajectory(self) -> Trajectory:
        """Keyframes alone."""
        assert self.world is not None
        keyframes = self.world.keyframes
        return Trajectory(np.array([k.t_s for k in keyframes]), self.world.poses.copy())
