"""Points of a growing model: triangulation, observations, merged tracks, outliers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry import (
    depths,
    reprojection_errors_px,
    robust_triangulation,
    triangulation_angles_deg,
)
from sfmcpp.map import LocalProblem, Map
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.sfm.tracks import NO_TRACK, TrackMembers

Numbers = NDArray[np.intp]
# A point so much nearer than the usual one makes all else that a camera sees disappear beside it.
_IN_CAMERA = 1e-5


class Sightings:
    """Which keypoints see a point that has a position: kept up to date, as few of very many change at a time.

    Parameters
    ----------
    world : Map
        Images and keypoints stay; all else of it may change.

    Attributes
    ----------
    sees : (K,) bool
        Which keypoints they are, at the last :meth:`update`.
    counts : (I,) int
        How many each image has.
    changed : (I,) bool
        Images of which any has changed; set back by who takes notice.
    """

    def __init__(self, world: Map) -> None:
        self._world = world
        self._points = np.full(len(world.keypoint_points), NO_TRACK, dtype=np.int32)
        self._known = np.zeros(len(world.points), dtype=np.bool_)
        self.sees = np.zeros(len(self._points), dtype=np.bool_)
        self.counts = np.zeros(world.num_images, dtype=np.intp)
        self.changed = np.zeros(world.num_images, dtype=np.bool_)

    def update(self) -> None:
        """Look again at keypoints that see another point, and whose point has got or lost a position."""
        world, known = self._world, self._world.known
        others = np.flatnonzero(world.keypoint_points != self._points)
        rows = np.union1d(others, world.observations_of(np.flatnonzero(known != self._known)))
        self._points[others], self._known = world.keypoint_points[others], known
        turned = rows[_see_known(world, rows) != self.sees[rows]]
        self.sees[turned] ^= True
        images = world.keypoint_images[turned]
        np.add.at(self.counts, images, np.where(self.sees[turned], 1, -1))
        self.changed[images] = True


def _see_known(world: Map, rows: Numbers) -> BoolArray:
    """Which keypoints `rows` (m,) see a point that has a position."""
    points = world.keypoint_points[rows]
    return np.asarray((points >= 0) & np.isfinite(world.points[points, 0]))


class Structure:
    """Points of one map and the tracks they come from.

    A keypoint belongs to its track for good; whether it observes the track's point in the map is decided
    anew as poses and points get better.

    Parameters
    ----------
    world : Map
        Its points are numbered as the tracks.
    tracks : (K,) int32
        Track of each keypoint, or -1.
    apart : (e, 2) int
        Matches, as keypoints, whose tracks differ.
    settings : IncrementalSettings
        Limits.

    Attributes
    ----------
    sightings : Sightings
        Which keypoints see known points.
    given_up : (K,) bool
        Keypoints whose track is not theirs, as an attempt to close a loop with them has shown.
    """

    def __init__(
        self, world: Map, tracks: NDArray[np.int32], apart: Numbers, settings: IncrementalSettings
    ) -> None:
        self.world, self._settings = world, settings
        self.tracks = tracks.copy()
        self._apart = apart
        self.sightings = Sightings(world)
        self.given_up = np.zeros(len(tracks), dtype=np.bool_)
        self._members = TrackMembers(self.tracks, len(world.points))

    def state(self) -> tuple[NDArray[np.int32], BoolArray]:
        """Copies of the tracks (K,) and of `given_up` (K,), for :meth:`restore`."""
        return self.tracks.copy(), self.given_up.copy()

    def restore(self, tracks: NDArray[np.int32], given_up: BoolArray) -> None:
        """Make tracks and `given_up` what they were; what the map has of them is its own."""
        self.tracks[:], self.given_up[:] = tracks, given_up
        self._members = TrackMembers(self.tracks, len(self.world.points))

    def seeing_known(self, image: int) -> Numbers:
        """Keypoints of an image that see a point that has a position."""
        rows = self.world.keypoints_of([image])
        return np.asarray(rows[_see_known(self.world, rows)])

    def triangulate(self, images: Numbers) -> int:
        """Give positions to tracks that `images` (n,) and others with a pose see; how many.

        Observations that disagree with a new point see nothing.
        """
        world = self.world
        seen = np.unique(self.tracks[world.keypoints_of(images)])
        waiting = seen[seen != NO_TRACK]
        waiting = waiting[~world.known[waiting]]
        self._restore_observations(waiting)
        local = world.seen_from(world.registered, waiting)
        if not local.problem.num_observations:
            return 0
        points, agree = robust_triangulation(
            local.problem,
            max_error_px=self._settings.outlier_px,
            min_angle_deg=self._settings.min_angle_deg,
            min_views=self._min_views,
        )
        found = np.isfinite(points[:, 0])
        world.points[local.points[found]] = points[found]
        world.forget(local.rows[~agree & found[local.problem.point_index]])
        return int(np.count_nonzero(found))

    @property
    def _min_views(self) -> int:
        """Fewest views of a point; as many as there are, while the model is smaller than that."""
        return max(2, min(self._settings.min_views, int(np.count_nonzero(self.world.registered))))

    def _restore_observations(self, tracks: NDArray[np.integer]) -> None:
        """Let all keypoints of `tracks` without a position belong to them again, as at the start."""
        rows = self._members.of(tracks)
        rows = rows[self.world.keypoint_points[rows] < 0]
        self.observe(rows, self.tracks[rows])

    def complete(self, images: Numbers) -> int:
        """Let `images` (n,) with a pose see the points of their tracks that fit; how many more."""
        world = self.world
        rows = world.keypoints_of(images)
        rows = rows[(self.tracks[rows] != NO_TRACK) & (world.keypoint_points[rows] < 0)]
        rows = rows[world.known[self.tracks[rows]]]
        good = self.errors_px(rows, self.tracks[rows]) <= self._settings.outlier_px
        return self.observe(rows[good], self.tracks[rows][good])

    def observe(self, rows: Numbers, points: NDArray[np.integer]) -> int:
        """Let keypoints see points, except where their image sees the point already; how many do."""
        _, first = np.unique(self._keys(rows, points), return_index=True)
        once = np.zeros(len(rows), dtype=np.bool_)
        once[first] = True
        chosen = once & ~self.sees_already(rows, points)
        self.world.observe(rows[chosen], points[chosen])
        return int(np.count_nonzero(chosen))

    def sees_already(self, rows: Numbers, points: NDArray[np.integer]) -> BoolArray:
        """Whether the image of each keypoint `rows` (m,) sees the point of `points` (m,), by any keypoint."""
        others = self.world.observations_of(np.unique(points))
        return np.isin(self._keys(rows, points), self._keys(others, self.world.keypoint_points[others]))

    def _keys(self, rows: Numbers, points: NDArray[np.integer]) -> NDArray[np.int64]:
        return self.world.keypoint_images[rows].astype(np.int64) * len(self.world.points) + points

    def errors_px(self, rows: Numbers, points: NDArray[np.integer]) -> FloatArray:
        """Reprojection errors [px] that keypoints `rows` (m,) would have as images of `points` (m,)."""
        world = self.world
        images, camera_index = np.unique(world.keypoint_images[rows], return_inverse=True)
        numbers, point_index = np.unique(points, return_inverse=True)
        problem = Problem(
            world.camera_model,
            world.poses[images],
            world.intrinsics,
            world.points[numbers],
            camera_index.astype(np.int32),
            point_index.astype(np.int32),
            world.keypoints[rows],
            intrinsics_index=world.image_cameras[images],
        )
        return reprojection_errors_px(problem, problem.points)

    def merge(self) -> int:
        """Join tracks whose keypoints were matched and whose points fit each other's images; how many."""
        world = self.world
        pairs = self.tracks[self._apart]
        pairs = pairs[(pairs != NO_TRACK).all(axis=1) & (pairs[:, 0] != pairs[:, 1])]
        pairs = np.unique(np.sort(pairs, axis=1), axis=0)
        pairs = pairs[world.known[pairs].all(axis=1)] if len(pairs) else pairs
        return self.join_tracks(pairs[self._fit_mutually(pairs)])

    def join_tracks(self, pairs: NDArray[np.integer]) -> int:
        """Let tracks (p, 2) be one, each second one becoming part of the first; how many there are fewer."""
        world = self.world
        if not len(pairs):  # all keypoints would be gone through for nothing
            return 0
        same = np.arange(len(world.points), dtype=np.int32)
        for kept, gone in pairs.tolist():
            a, b = int(same[kept]), int(same[gone])
            if a != b and world.known[a]:
                world.merge(a, b)
                same[same == b] = a
        tracked = self.tracks != NO_TRACK
        self.tracks[tracked] = same[self.tracks[tracked]]
        self._members = TrackMembers(self.tracks, len(world.points))
        return int(np.count_nonzero(same != np.arange(len(same))))

    def _fit_mutually(self, pairs: NDArray[np.integer]) -> BoolArray:
        """Which pairs (p, 2) of points have errors within the limit in all images that see the other one."""
        world, fits = self.world, np.ones(len(pairs), dtype=np.bool_)
        for here, there in ((0, 1), (1, 0)):
            rows, places = world.observations_with_places(pairs[:, here])
            posed = world.registered[world.keypoint_images[rows]]
            rows, places = rows[posed], places[posed]
            far = self.errors_px(rows, pairs[places, there]) > self._settings.outlier_px
            fits &= np.bincount(places, far, len(pairs)) == 0
        return fits

    def drop_outliers(self, local: LocalProblem) -> int:
        """Leave out observations with large errors and points under small angles; how many observations.

        So are points that have moved into a camera, where they fit any pixel.
        """
        problem, settings = local.problem, self._settings
        outliers = reprojection_errors_px(problem, problem.points) > settings.outlier_px
        narrow = triangulation_angles_deg(problem, problem.points) < settings.min_angle_deg
        self.world.drop(local, outliers, self._min_views)
        self.world.points[local.points[narrow | are_in_cameras(problem)]] = np.nan
        return int(np.count_nonzero(outliers))


def are_in_cameras(problem: Problem) -> BoolArray:
    """(N,) which points are at no distance from a camera that sees them: it has them at any pixel."""
    if not problem.num_observations:
        return np.zeros(problem.num_points, dtype=np.bool_)
    distances = np.abs(depths(problem, problem.points))
    inside = distances < _IN_CAMERA * np.median(distances)
    found = np.zeros(problem.num_points, dtype=np.bool_)
    found[problem.point_index[inside]] = True
    return found
