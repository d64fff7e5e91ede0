"""The map of a drive: keyframes in order of time, with their sensor measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry.pinhole import PINHOLE
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.map import LocalProblem, Map
from sfmcpp.map.table import Table
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray, IndexArray
from sfmcpp.model.frames import Frame, View
from sfmcpp.slam.measurement import Measurement


@dataclass(frozen=True, eq=False)
class WeightedMeasurement:
    """A measurement and its λ: λ² times the mean squared error is added to that of the pixels (eq. 5.1)."""

    measurement: Measurement
    weight: float


@dataclass(eq=False)
class Keyframe:
    """A frame whose pose is part of the map: an image of it with a time.

    Attributes
    ----------
    world : WorldMap
        The map.
    image : int
        Its number there.
    frame : int
        Number of the frame.
    t_s : float
        Its time [s].
    constraints : list of WeightedMeasurement
        What sensors say of the motion from the keyframe before, with the weight chosen when it came.
    """

    world: WorldMap = field(repr=False)
    image: int
    frame: int
    t_s: float
    constraints: list[WeightedMeasurement] = field(default_factory=list)

    @property
    def pose(self) -> FloatArray:
        """``[R | c]`` (3, 4), world_from_camera."""
        return np.array(self.world.poses[self.image])

    @property
    def view(self) -> View:
        """Its observations without outliers."""
        begin = self.world.keypoint_begin[self.image]
        rows = slice(begin, begin + self.world.keypoint_counts[self.image])
        tracks = self.world.keypoint_points[rows]
        return View(tracks, self.world.keypoints[rows]).only(tracks >= 0)

    @property
    def depths(self) -> FloatArray:
        """(n,) depths of the points that it sees, in units of the map."""
        points, pose = self.world.points[self.view.tracks], self.pose
        return np.asarray((points[np.isfinite(points[:, 0])] - pose[:, 3]) @ pose[:, 2])


class WorldMap(Map):
    """A map whose images are keyframes; the points have the numbers of the tracks.

    It grows with the tracks that keyframes see; others take no room.

    Parameters
    ----------
    intrinsics : (5,) or (12,) float64
        Of the camera: of the model ``"calibrated"``, or ``"perspective"`` where the lens distorts.

    Attributes
    ----------
    metric : bool
        Whether its unit is the metre.
    right_centre_m : (3,) float64 or None
        Where the right camera is, in the axes of the left one [m]; None where there is none.
    """

    @checked(intrinsics=(ANY,))
    def __init__(self, intrinsics: FloatArray) -> None:
        super().__init__("calibrated" if len(intrinsics) == PINHOLE else "perspective")
        self.add_cameras(intrinsics[None], fixed=np.ones((1, len(intrinsics)), dtype=np.bool_))
        self.keyframes: list[Keyframe] = []
        self.metric = False
        self.right_centre_m: FloatArray | None = None
        self._right = Table(pixels=(np.float64, (2,), np.nan))
        # Number of the oldest keyframe of the part that images hold together.
        self.part_start = 0

    @property
    def stereo(self) -> bool:
        """Whether right images determine its scale: it is in metres, and there are some."""
        return self.metric and self.right_centre_m is not None

    @property
    def right_px(self) -> FloatArray:
        """(K, 2) where the right image sees what each keypoint sees [px]; not a number where it does not."""
        return self._right["pixels"]

    def knows(self, tracks: IndexArray) -> NDArray[np.bool_]:
        """(n,) whether each of the `tracks` (n,) has a point."""
        found = np.zeros(len(tracks), dtype=np.bool_)
        met = tracks < len(self.points)
        found[met] = np.isfinite(self.points[tracks[met], 0])
        return found

    def add(
        self, frame: Frame, pose: FloatArray, constraints: Sequence[WeightedMeasurement] = ()
    ) -> Keyframe:
        """Make a keyframe of a frame; its new tracks have no points yet."""
        view = frame.view
        self._make_room(int(view.tracks.max(initial=-1)) + 1)
        name, count = f"frame_{frame.number:06d}", len(view.tracks)
        (image,) = self.add_images([name], [0], [count], view.pixels, points=view.tracks, poses=pose[None])
        self._right.grow(count, pixels=None if view.right is None else view.right.pixels)
        if view.right is not None:
            self.right_centre_m = view.right.centre_m
        self.keyframes.append(Keyframe(self, int(image), frame.number, frame.t_s, list(constraints)))
        return self.keyframes[-1]

    def _make_room(self, num_tracks: int) -> None:
        missing = num_tracks - len(self.points)
        if missing > 0:
            self.add_points(np.full((missing, 3), np.nan))

    def append(self, part: WorldMap, similarity: Similarity) -> None:
        """Take over another map of later keyframes, placed by `similarity`, world_from_part.

        Images tie it to nothing before: the local adjustment will not look behind its first keyframe.
        """
        self.part_start = len(self.keyframes)
        self._make_room(len(part.points))
        self.join(part, similarity, cameras=[0], points=np.arange(len(part.points)))
        self._right.grow(len(part.right_px), pixels=part.right_px)
        for keyframe in part.keyframes:
            image = self.part_start + keyframe.image
            self.keyframes.append(Keyframe(self, image, keyframe.frame, keyframe.t_s, keyframe.constraints))

    def move_recent(self, first: int, similarity: Similarity) -> None:
        """Move the keyframes from `first` on, and their points: a new part that images tie to nothing before.

        Older keyframes forget the points that have moved.
        """
        moved = np.unique(self.keypoint_points[self.keypoint_begin[first] :])
        moved = moved[moved >= 0]
        self.poses[first:] = similarity.apply_to_poses(self.poses[first:])
        self.points[moved] = similarity.apply(self.points[moved])
        rows = self.observations_of(moved)
        self.forget(rows[self.keypoint_images[rows] < first])
        self.part_start = first

    def around(self, moving: int) -> LocalProblem:
        """Make the problem of the last `moving` keyframes, and of every keyframe that sees their points.

        Only those last keyframes and their points are free (thesis §3.3.2), and none of an earlier part. The
        keyframe before them takes part for the constraint that ties them to it.
        """
        first = max(self.num_images - moving, self.part_start)
        return self.local_problem(np.arange(first, self.num_images), np.arange(max(first - 1, 0), first))

    def triangulation(self, last: int) -> LocalProblem:
        """Make the problem of the tracks without a point that two or more of the `last` keyframes see.

        Where there are right images, one will do.
        """
        least = 1 if self.stereo else 2
        first = max(self.num_images - last, self.part_start)
        return self.untriangulated(np.arange(first, self.num_images), least)
