"""The map: operations on images, points and observations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import Similarity, mean_reprojection_errors_px
from sfmcpp.map.store import UNKNOWN_ERROR, Store
from sfmcpp.map.tracks import NONE, Rows
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, numbers_below, typed_array
from sfmcpp.model.checks import require_not_negative, require_positive
from sfmcpp.model.uncertainty import Uncertainty


@dataclass(frozen=True, eq=False)
class LocalProblem:
    """Part of a map as a bundle adjustment problem, and where its rows are in the map.

    Attributes
    ----------
    problem : Problem
        Its cameras are `images`, its rows of intrinsics `cameras`, its points `points`. Standard deviations
        or covariances are those of the keypoints, where the map has them.
    images : (C,) int
        Numbers of images.
    cameras : (G,) int
        Numbers of cameras.
    points : (N,) int
        Numbers of points.
    rows : (M,) int
        Keypoint of each observation.
    """

    problem: Problem
    images: Rows
    cameras: Rows
    points: Rows
    rows: Rows


class Map(Store):
    """A map of images, cameras and points; see :class:`Store` for its arrays and for how it grows.

    Parameters
    ----------
    camera_model : str
        Of all cameras: ``"perspective"`` holds what ``"calibrated"`` and ``"bal"`` do.
    """

    made_into: ClassVar[dict[str, str]] = {"Problem": "sfmcpp.map.problem_of_map"}

    def __repr__(self) -> str:
        posed, known = int(self.registered.sum()), int(self.known.sum())
        return (
            f"{type(self).__name__}({self.camera_model!r}: {self.num_images} images, {posed} with a pose, "
            f"{known} points)"
        )

    def observe(self, rows: ArrayLike, points: ArrayLike) -> None:
        """Add observations: points that some keypoints see.

        Parameters
        ----------
        rows : (k,) int
            Keypoints that see no point.
        points : (k,) int
            Their points; no image sees one twice.

        Raises
        ------
        InvalidArgument
            If there is no such point, a keypoint sees one already, or an image would see one twice.
        """
        chosen = numbers_below("rows", rows, len(self.keypoints))
        seen = numbers_below("points", points, len(self.points))
        if len(chosen) != len(seen):
            raise InvalidArgument(f"points: {len(seen)} for {len(chosen)} rows")
        if (self.keypoint_points[chosen] != NONE).any() or len(np.unique(chosen)) != len(chosen):
            raise InvalidArgument("rows: a keypoint sees one point at most")
        others = self.observations_of(np.unique(seen))
        both = np.concatenate([chosen, others])
        self._require_once(np.concatenate([seen, self.keypoint_points[others]]), self.keypoint_images[both])
        self._tracks.link(chosen, seen)

    def forget(self, rows: ArrayLike) -> None:
        """Let keypoints `rows` (k,) see nothing; their points keep their positions."""
        self._tracks.unlink(numbers_below("rows", rows, len(self.keypoints)))

    def remove_points(self, points: ArrayLike) -> None:
        """Take `points` (n,) out of the map: no keypoint sees them, no position; their numbers stay empty."""
        chosen = numbers_below("points", points, len(self.points))
        self.forget(self.observations_of(chosen))
        self.points[chosen] = np.nan

    @checked()
    def merge(self, kept: int, gone: int) -> None:
        """Let all that sees the point `gone` see `kept`, except in images that see both; empty `gone`."""
        if kept == gone:
            raise InvalidArgument(f"gone = {gone}: must be another point than the one kept")
        rows, kept_rows = self.observations_of([gone]), self.observations_of([kept])
        self.remove_points([gone])
        rows = rows[~np.isin(self.keypoint_images[rows], self.keypoint_images[kept_rows])]
        self.observe(rows, np.full(len(rows), kept))

    @checked()
    def transform(self, similarity: Similarity) -> None:
        """Move the whole map (thesis eqs 5.16–5.17)."""
        self.points[:] = similarity.apply(self.points)
        self.poses[:] = similarity.apply_to_poses(self.poses)

    @checked()
    def join(
        self,
        other: Map,
        similarity: Similarity | None = None,
        *,
        cameras: ArrayLike | None = None,
        points: ArrayLike | None = None,
    ) -> tuple[Rows, Rows]:
        """Take over the images and points of another map, which is left as it is.

        Parameters
        ----------
        other : Map
            Of the same camera model.
        similarity : Similarity, optional
            Where it is put, this_from_other. Default: where it is, in a world of the same origin. A map
            without images takes over an origin.
        cameras : (G,) int, optional
            Numbers here of its cameras. Default: they are new.
        points : (N,) int, optional
            Numbers here of its points, whose positions its own replace where it knows them. Default: all new.

        Returns
        -------
        images : (I,) int
            Numbers here of its images.
        points : (N,) int
            Numbers here of its points.

        Raises
        ------
        InvalidArgument
            If the camera models differ, there is no such camera or point, an image would see a point twice,
            or the worlds have two origins and `similarity` is not given. Nothing is changed then.
        """
        self._require_joinable(other, cameras, points)
        if similarity is None:
            self._enter_world_of(other)
        if cameras is None:
            cameras = self.add_cameras(
                other.intrinsics,
                fixed=other.fixed_intrinsics,
                sizes=other.camera_sizes,
                names=other.camera_names,
            )
        if points is None:
            points = self.add_points(np.full(other.points.shape, np.nan), colors=other.point_colors)
        place = Similarity.identity() if similarity is None else similarity
        numbers = np.asarray(points, dtype=np.intp)
        known, begin = other.known, len(self.keypoints)
        self.points[numbers[known]] = place.apply(other.points)[known]
        images = self.add_images(
            other.image_names,
            np.asarray(cameras)[other.image_cameras],
            other.keypoint_counts,
            other.keypoints,
            poses=place.apply_to_poses(other.poses),
            colors=other.keypoint_colors,
            scales=other.keypoint_scales,
            covariances=other.keypoint_covariances,
        )
        rows, places = other._tracks.of(np.arange(len(other.points)))
        self.observe(begin + rows, numbers[places])
        return images, numbers

    def _require_joinable(self, other: Map, cameras: ArrayLike | None, points: ArrayLike | None) -> None:
        """Raise InvalidArgument unless another map can be taken over with these numbers."""
        if other is self:
            raise InvalidArgument("other: is the map itself, must be another one")
        if other.camera_model != self.camera_model:
            raise InvalidArgument(
                f"other: camera model {other.camera_model!r}, must be {self.camera_model!r}"
            )
        for name, given, known, wanted in (
            ("cameras", cameras, len(self.intrinsics), len(other.intrinsics)),
            ("points", points, len(self.points), len(other.points)),
        ):
            if given is not None and (count := len(numbers_below(name, given, known))) != wanted:
                raise InvalidArgument(f"{name}: {count}, must be {wanted}, as many as the other map has")
        if points is not None:
            rows, places = other._tracks.of(np.arange(len(other.points)))
            self._require_once(np.asarray(points, dtype=np.intp)[places], other.keypoint_images[rows])

    def set_sigmas_by_scale(self, sigma_per_scale: float, least_px: float = 0.0) -> None:
        """Let the standard deviation of each keypoint grow with its scale s: ``σ² = least² + (factor s)²``.

        What is detected at a coarse scale is located no better than that scale allows. It replaces
        :attr:`keypoint_covariances`; keypoints without a scale count as 1 px.

        Parameters
        ----------
        sigma_per_scale : float
            Standard deviation of each coordinate over the scale, where the scale is large.
        least_px : float
            What it is where the scale is small [px]. Residuals of SIFT on two sets of photos had some
            0.15 px, and 0.08 over the scale.

        Raises
        ------
        InvalidArgument
            If `sigma_per_scale` is not finite and positive, or `least_px` not finite or negative.
        """
        require_positive("sigma_per_scale", sigma_per_scale)
        require_not_negative("least_px", least_px)
        variances = least_px**2 + (sigma_per_scale * self.keypoint_scales) ** 2
        self.keypoint_covariances[:] = variances[:, None] * [1.0, 0.0, 1.0]

    def local_problem(self, images: ArrayLike, also: ArrayLike = ()) -> LocalProblem:
        """Make the problem of some images and their points, and of every image that sees these.

        Free are the `images` that see a point and all these points; other images are fixed.

        Parameters
        ----------
        images : (i,) int
            Images with a pose.
        also : (a,) int
            Images that take part, fixed, even if they see nothing of it: for constraints to them.

        Returns
        -------
        LocalProblem
            Images, cameras, points and, within an image, keypoints are in the order of their numbers.
        """
        free = np.unique(numbers_below("images", images, self.num_images))
        seen = np.unique(self.keypoint_points[self.keypoints_of(free)])
        points = seen[(seen >= 0) & np.isfinite(self.points[seen, 0])].astype(np.intp)
        rows = np.sort(self._tracks.of(points)[0])
        rows = rows[np.isfinite(self.poses[self.keypoint_images[rows], 0, 0])]
        moves, sees, used = np.zeros((3, self.num_images), dtype=np.bool_)
        moves[free], sees[self.keypoint_images[rows]] = True, True
        used[numbers_below("also", also, self.num_images)] = True
        local = self._local_problem(np.flatnonzero(used | moves | sees), points, rows)
        local.problem.fixed_cameras[:] = ~(moves & sees)[local.images]
        return local

    @checked()
    def whole_problem(self, min_views: int = 1) -> LocalProblem:
        """Make the problem of all images with a pose and all points; nothing is fixed.

        Parameters
        ----------
        min_views : int
            Fewest images that see a point of it.

        Returns
        -------
        LocalProblem
            With names, sizes and colours as metadata where they are known.
        """
        images = np.flatnonzero(self.registered)
        local = self._seen_points(images, self.known, min_views)
        metadata = local.problem.metadata
        metadata.image_names = [self.image_names[i] for i in images]
        if self.camera_sizes.all():
            metadata.image_sizes = self.camera_sizes[self.image_cameras[images]]
        if self.point_colors.any():
            metadata.point_colors = self.point_colors[local.points]
        return local

    @checked()
    def untriangulated(self, images: ArrayLike, min_views: int = 2) -> LocalProblem:
        """Make the problem of the points without a position that some images see.

        Parameters
        ----------
        images : (i,) int
            Images with a pose; only these take part.
        min_views : int
            Fewest of them that see a point of it.

        Returns
        -------
        LocalProblem
            Its points are not a number.
        """
        chosen = np.unique(numbers_below("images", images, len(self.poses)))
        rows = self.keypoints_of(chosen)
        rows = rows[self.keypoint_points[rows] >= 0]
        points, place, views = np.unique(self.keypoint_points[rows], return_inverse=True, return_counts=True)
        wanted = ~np.isfinite(self.points[points, 0]) & (views >= min_views)
        return self._local_problem(chosen, points[wanted].astype(np.intp), rows[wanted[place]])

    @checked()
    def seen_from(self, images: ArrayLike, points: ArrayLike) -> LocalProblem:
        """Make the problem of some points, and of those of `images` that see them.

        Parameters
        ----------
        images : (I,) bool
            Which images may take part; they have poses.
        points : (n,) int
            Points, with a position or without.

        Returns
        -------
        LocalProblem
            It costs what these points are seen, however large the map is.
        """
        chosen = np.unique(numbers_below("points", points, len(self.points)))
        allowed = typed_array("images", images, np.bool_, (len(self.poses),))
        rows = np.sort(self._tracks.of(chosen)[0])
        rows = rows[allowed[self.keypoint_images[rows]]]
        return self._local_problem(np.unique(self.keypoint_images[rows]).astype(np.intp), chosen, rows)

    def _seen_points(self, images: Rows, wanted: BoolArray, min_views: int) -> LocalProblem:
        """Make the problem of `images`, and of the points `wanted` (N,) that enough of them see."""
        rows = self.keypoints_of(images)
        rows = rows[self.keypoint_points[rows] >= 0]
        views = np.bincount(self.keypoint_points[rows], minlength=len(self.points))
        chosen = wanted & (views >= min_views)
        return self._local_problem(images, np.flatnonzero(chosen), rows[chosen[self.keypoint_points[rows]]])

    def _local_problem(self, images: Rows, points: Rows, rows: Rows) -> LocalProblem:
        cameras, camera_of_image = np.unique(self.image_cameras[images], return_inverse=True)
        place = np.empty(len(self.points), dtype=np.int32)
        place[points] = np.arange(len(points))
        uncertainty = self._uncertainty(rows)
        problem = Problem(
            self.camera_model,
            self.poses[images],
            self.intrinsics[cameras],
            self.points[points],
            np.searchsorted(images, self.keypoint_images[rows]).astype(np.int32),
            place[self.keypoint_points[rows]],
            self.keypoints[rows],
            intrinsics_index=camera_of_image.astype(np.int32),
            fixed_intrinsics=self.fixed_intrinsics[cameras],
            sigma_px=uncertainty.sigma_px,
            covariance_px2=uncertainty.covariance_px2,
        )
        return LocalProblem(problem, images, cameras.astype(np.intp), points, rows)

    def _uncertainty(self, rows: Rows) -> Uncertainty:
        """Uncertainties of some keypoints, as a problem has them."""
        upper = self.keypoint_covariances[rows]
        unknown = np.isnan(upper).any(axis=1)
        if unknown.all():
            return Uncertainty()
        upper[unknown] = [1.0, 0.0, 1.0]
        return Uncertainty.of_covariances(upper[:, [0, 1, 1, 2]].reshape(-1, 2, 2))

    @checked()
    def take(self, local: LocalProblem) -> None:
        """Take over what has moved in `local`: poses, intrinsics and points."""
        self.poses[local.images] = local.problem.cameras
        self.intrinsics[local.cameras] = local.problem.intrinsics
        self.points[local.points] = local.problem.points

    @checked()
    def drop(self, local: LocalProblem, outliers: BoolArray, min_views: int) -> None:
        """Forget the observations `outliers` (M,) of `local`, and where points with too few views are."""
        problem = local.problem
        self.forget(local.rows[outliers])
        views = np.bincount(problem.point_index[~outliers], minlength=problem.num_points)
        self.points[local.points[views < min_views]] = np.nan

    def update_errors(self) -> None:
        """Compute the mean reprojection error of each point anew, over the images it is in front of [px]."""
        local = self.whole_problem()
        self.point_errors[:] = UNKNOWN_ERROR
        errors = mean_reprojection_errors_px(local.problem, local.problem.points)
        self.point_errors[local.points] = np.where(np.isfinite(errors), errors, UNKNOWN_ERROR)

    def update_colors(self) -> None:
        """Give each point the mean colour of the keypoints of images with a pose that see it.

        Points that none sees keep theirs, and all do where nothing is known of the colours of keypoints.
        """
        rows = np.flatnonzero((self.keypoint_points >= 0) & self.registered[self.keypoint_images])
        if not self.keypoint_colors[rows].any():
            return
        points = self.keypoint_points[rows]
        counts = np.bincount(points, minlength=len(self.points))
        sums = [np.bincount(points, one, minlength=len(counts)) for one in self.keypoint_colors[rows].T]
        seen = counts > 0
        means = np.stack(sums, axis=1)[seen] / counts[seen, None]
        self.point_colors[seen] = np.round(means).astype(np.uint8)
