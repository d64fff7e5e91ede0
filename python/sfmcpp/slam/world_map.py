"""The map: keyframes, points, and who sees what."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry.similarity import Similarity
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.slam.sensing import Measurement
from sfmcpp.slam.sequence import Frame, View


@dataclass(frozen=True, eq=False)
class WeightedMeasurement:
    """A measurement and its λ: λ² times the mean squared error is added to that of the pixels (eq. 5.1)."""

    measurement: Measurement
    weight: float


@dataclass(eq=False)
class Keyframe:
    """A frame whose pose is part of the map.

    Attributes
    ----------
    frame : int
        Number of the frame.
    t_s : float
        Its time [s].
    pose : (3, 4) float64
        ``[R | c]``, world_from_camera.
    view : View
        What it sees, outliers left out.
    constraints : list of WeightedMeasurement
        What sensors say of the motion from the keyframe before, with the weight chosen when it came.
    """

    frame: int
    t_s: float
    pose: FloatArray
    view: View
    constraints: list[WeightedMeasurement] = field(default_factory=list)

    @classmethod
    def of(cls, frame: Frame, pose: FloatArray) -> Keyframe:
        """Make a keyframe of a frame."""
        return cls(frame.number, frame.t_s, pose, frame.view)


@dataclass(frozen=True, eq=False)
class LocalProblem:
    """Part of the map as a bundle adjustment problem.

    Attributes
    ----------
    problem : Problem
        Its cameras are `keyframes`, its points `tracks`.
    keyframes : (C,) int
        Numbers of keyframes in the map.
    tracks : (N,) int
        Tracks of the points.
    """

    problem: Problem
    keyframes: NDArray[np.intp]
    tracks: NDArray[np.intp]


class WorldMap:
    """Keyframes and points; a point has the number of its track.

    It grows with what it is told of: tracks that no keyframe has seen take no room.

    Parameters
    ----------
    intrinsics : (5,) float64
        Of the camera.
    """

    def __init__(self, intrinsics: FloatArray) -> None:
        self.intrinsics = intrinsics
        self.points: FloatArray = np.empty((0, 3))
        self.keyframes: list[Keyframe] = []
        # Number of the oldest keyframe of the part that images hold together.
        self.part_start = 0
        # First keyframe that sees each track: older ones need not be asked.
        self._first_seen: NDArray[np.intp] = np.empty(0, dtype=np.intp)

    @property
    def known(self) -> NDArray[np.bool_]:
        """(T,) whether each track has a point."""
        return np.asarray(np.isfinite(self.points[:, 0]))

    def knows(self, tracks: IndexArray) -> NDArray[np.bool_]:
        """(n,) whether each of the `tracks` (n,) has a point."""
        found = np.zeros(len(tracks), dtype=np.bool_)
        met = tracks < len(self.points)
        found[met] = np.isfinite(self.points[tracks[met], 0])
        return found

    def poses(self) -> FloatArray:
        """(K, 3, 4) poses of the keyframes."""
        return np.stack([keyframe.pose for keyframe in self.keyframes])

    def add(self, keyframe: Keyframe) -> None:
        """Take a new keyframe; its tracks have no points yet."""
        tracks = keyframe.view.tracks
        self._make_room(int(tracks.max(initial=-1)) + 1)
        self._first_seen[tracks] = np.minimum(self._first_seen[tracks], len(self.keyframes))
        self.keyframes.append(keyframe)

    def join(self, part: WorldMap, similarity: Similarity) -> None:
        """Take over another map of later keyframes, placed by `similarity`, world_from_part.

        Images tie it to nothing before: the local adjustment will not look behind its first keyframe.
        """
        part.transform(similarity)
        self.part_start = len(self.keyframes)
        for keyframe in part.keyframes:
            self.add(keyframe)
        tracks = np.flatnonzero(part.known)
        self.points[tracks] = part.points[tracks]

    def transform(self, similarity: Similarity) -> None:
        """Move the whole map (thesis eqs 5.16–5.17)."""
        self.points[:] = similarity.apply(self.points)
        for keyframe in self.keyframes:
            keyframe.pose = similarity.apply_to_poses(keyframe.pose)

    def move_recent(self, first: int, similarity: Similarity) -> None:
        """Move the keyframes from `first` on, and their points: a new part that images tie to nothing before.

        Older keyframes forget the points that have moved.
        """
        moved = np.zeros(len(self.points), dtype=np.bool_)
        for keyframe in self.keyframes[first:]:
            moved[keyframe.view.tracks] = True
            keyframe.pose = similarity.apply_to_poses(keyframe.pose)
        self.points[moved] = similarity.apply(self.points[moved])
        oldest = int(self._first_seen[moved].min(initial=first))
        for keyframe in self.keyframes[oldest:first]:
            keyframe.view = keyframe.view.only(~moved[keyframe.view.tracks])
        self._first_seen[moved] = np.maximum(self._first_seen[moved], first)
        self.part_start = first

    def around(self, moving: int) -> LocalProblem:
        """Make the problem of the last `moving` keyframes, and of every keyframe that sees their points.

        Only those last keyframes and their points are free (thesis §3.3.2), and none of an earlier part.
        """
        return self._since(max(len(self.keyframes) - moving, self.part_start))

    def whole(self) -> LocalProblem:
        """Make the problem of all keyframes and points."""
        return self._since(0)

    def _since(self, first: int) -> LocalProblem:
        """Make the problem of the keyframes from `first` on, and of those that see their points, fixed."""
        seen = np.zeros(len(self.points), dtype=np.bool_)
        for keyframe in self.keyframes[first:]:
            seen[keyframe.view.tracks] = True
        seen &= self.known
        # The keyframe before the window takes part for the constraint that ties the window to it.
        oldest = min(int(self._first_seen[seen].min(initial=first)), max(first - 1, 0))
        numbers = np.arange(oldest, len(self.keyframes))
        parts = [keyframe.view.only(seen[keyframe.view.tracks]) for keyframe in self.keyframes[oldest:]]
        used = numbers[(numbers >= first - 1) | (np.array([len(part.tracks) for part in parts]) > 0)]
        problem, tracks = self._problem(used, [parts[k - oldest] for k in used])
        sees = np.bincount(problem.camera_index, minlength=len(used)) > 0
        problem.fixed_cameras[:] = (used < first) | ~sees
        return LocalProblem(problem, used, tracks)

    def triangulation(self, last: int) -> LocalProblem:
        """Make the problem of the tracks without a point that two or more of the `last` keyframes see."""
        first = max(len(self.keyframes) - last, self.part_start)
        recent = np.arange(first, len(self.keyframes))
        views = np.zeros(len(self.points), dtype=np.intp)
        for k in recent:
            views[self.keyframes[k].view.tracks] += 1
        wanted = (views >= 2) & ~self.known
        parts = [self.keyframes[k].view.only(wanted[self.keyframes[k].view.tracks]) for k in recent]
        problem, tracks = self._problem(recent, parts)
        return LocalProblem(problem, recent, tracks)

    def take(self, local: LocalProblem) -> None:
        """Take over what has moved in `local`."""
        for k, pose in zip(local.keyframes, local.problem.cameras, strict=True):
            self.keyframes[k].pose = pose.copy()
        self.points[local.tracks] = local.problem.points

    def drop(self, local: LocalProblem, outliers: NDArray[np.bool_], min_views: int) -> None:
        """Forget the observations `outliers` (M,) of `local`, and points left with too few views."""
        problem = local.problem
        for camera in np.unique(problem.camera_index[outliers]):
            bad = local.tracks[problem.point_index[outliers & (problem.camera_index == camera)]]
            keyframe = self.keyframes[local.keyframes[camera]]
            keyframe.view = keyframe.view.only(~np.isin(keyframe.view.tracks, bad))
        views = np.bincount(problem.point_index[~outliers], minlength=problem.num_points)
        self.points[local.tracks[views < min_views]] = np.nan

    def _make_room(self, num_tracks: int) -> None:
        """Grow by doubling, so that each track is moved a few times at most."""
        have = len(self.points)
        if num_tracks <= have:
            return
        more = max(num_tracks, 2 * have) - have
        self.points = np.concatenate([self.points, np.full((more, 3), np.nan)])
        never = np.full(more, np.iinfo(np.intp).max)
        self._first_seen = np.concatenate([self._first_seen, never])

    def _problem(self, keyframes: NDArray[np.intp], views: list[View]) -> tuple[Problem, NDArray[np.intp]]:
        lengths = [len(view.tracks) for view in views]
        seen = np.concatenate([view.tracks for view in views]) if views else np.empty(0, dtype=np.int32)
        tracks, point_index = np.unique(seen, return_inverse=True)
        problem = Problem(
            "calibrated",
            np.stack([self.keyframes[k].pose for k in keyframes]),
            self.intrinsics[None],
            self.points[tracks],
            np.repeat(np.arange(len(views), dtype=np.int32), lengths),
            point_index.astype(np.int32),
            np.concatenate([view.pixels for view in views]),
            intrinsics_index=np.zeros(len(views), dtype=np.int32),
        )
        return problem, tracks.astype(np.intp)
