"""Path of the camera: its poses at all frames, those of keyframes being in the map."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from itertools import islice, takewhile

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import predict_pose
from sfmcpp.slam.world_map import WorldMap


@dataclass
class Path:
    """Poses of the camera at all frames.

    Attributes
    ----------
    between : dict of int to (3, 4) float64
        Pose of each frame that has one and is no keyframe, world_from_camera; the map has those of keyframes.
    times : dict of int to float
        Time of each frame looked at [s], in the order of time.
    world : WorldMap or None
        The map, as soon as there is one.
    seen_from : dict of int to (3, 3) float64
        Rotation of frames between keyframes by the images alone, relative to their pose: world_from_camera by
        the images is ``pose[:, :3] @ seen_from``. Not the identity where a gyroscope decided the pose.
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
        last = (item for item in self._backwards() if item[0] not in without)
        return dict(reversed(list(islice(last, count))))

    def since(self, first: int) -> dict[int, FloatArray]:
        """Poses of the frames from number `first` on that have one, in their order."""
        return dict(reversed(list(takewhile(lambda item: item[0] >= first, self._backwards()))))

    def pose_of(self, number: int) -> FloatArray:
        """Pose (3, 4) of a frame that has one."""
        keyframes = self.world.keyframes if self.world else []
        place = bisect_left(keyframes, number, key=lambda keyframe: keyframe.frame)
        is_keyframe = place < len(keyframes) and keyframes[place].frame == number
        return keyframes[place].pose if is_keyframe else self.between[number]

    def _backwards(self) -> Iterator[tuple[int, FloatArray]]:
        """Frames that have a pose, from the last to the first: the latest cost the same in a run of hours."""
        keyframes = reversed(self.world.keyframes) if self.world else iter(())
        keyframe = next(keyframes, None)
        for number in reversed(self.times):
            if keyframe is not None and keyframe.frame == number:
                yield number, keyframe.pose
                keyframe = next(keyframes, None)
            elif number in self.between:
                yield number, self.between[number]

    def transform(self, similarity: Similarity, first: int = 0) -> None:
        """Move the poses between keyframes, of the frames from number `first` on (thesis eq. 5.16)."""
        for number in [k for k in self.between if k >= first]:
            self.between[number] = similarity.apply_to_poses(self.between[number])

    def settle(self, number: int, pose: FloatArray) -> None:
        """Change the pose (3, 4) of a frame between keyframes; its rotation by the images alone stays."""
        seen = self.between[number][:, :3] @ self.seen_from.get(number, np.eye(3))
        self.between[number] = pose
        self.seen_from[number] = pose[:, :3].T @ seen

    def follow(self, before: FloatArray) -> None:
        """Move the frames between keyframes along with the keyframes, which an adjustment has moved.

        Parameters
        ----------
        before : (k, 3, 4) float64
            Poses of the keyframes before the adjustment, world_from_camera.
        """
        assert self.world is not None
        keyframes, after = self.world.keyframes, self.world.poses
        moved = np.flatnonzero((before != after).any(axis=(1, 2)))
        if not len(moved):
            return
        for k in range(max(int(moved[0]) - 1, 0), len(keyframes)):
            end = keyframes[k + 1].frame if k + 1 < len(keyframes) else next(reversed(self.times)) + 1
            numbers = [f for f in range(keyframes[k].frame + 1, end) if f in self.between]
            if not numbers:
                continue
            poses = np.stack([self.between[f] for f in numbers])
            times = np.array([self.times[f] for f in numbers])
            sides = slice(k, k + 2)
            stamps = np.array([keyframe.t_s for keyframe in keyframes[sides]])
            carried = _carried(poses, times, stamps, before[sides], after[sides])
            self.between.update(zip(numbers, carried, strict=True))

    def predict(self, time_s: float) -> FloatArray:
        """Pose (3, 4) at a later time [s] by the velocities of the last two poses (thesis eqs 1.1–1.3)."""
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
        """Median speed over the last `steps` between frames not in `without` [units of the map / s]."""
        last = self.latest(steps + 1, without)
        if len(last) < 2:
            return 0.0
        centres = np.stack([pose[:, 3] for pose in last.values()])
        lengths = np.linalg.norm(np.diff(centres, axis=0), axis=1)
        return float(np.median(lengths / np.diff([self.times[k] for k in last])))


def _carried(
    poses: FloatArray, times_s: FloatArray, stamps_s: FloatArray, before: FloatArray, after: FloatArray
) -> FloatArray:
    """Poses (n, 3, 4) of frames at `times_s` (n,) that keep their pose relative to one or two keyframes.

    The keyframes at `stamps_s`, the one before the frames and, if there is one, the one after them, moved
    from the poses `before` to `after`. Where they moved differently, both motions are interpolated by time.
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
