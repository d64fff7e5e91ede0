"""Storage of a map as growing columns: images with their keypoints, cameras, points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.map.table import Table
from sfmcpp.map.tracks import NONE, Rows, Tracks
from sfmcpp.model import camera_model as camera_model_of
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray, numbers_below
from sfmcpp.model.camera_models import require_pinhole
from sfmcpp.model.metadata import WorldOrigin

UNKNOWN_ERROR = -1.0
_MOST_KEYPOINTS = 2**31


class Store:
    """Images, cameras and points; each is known by its number, counted from 0 in the order of coming.

    A point is what keypoints of several images see: it may have no position yet, or no longer. All arrays
    are views of the rows so far: write into them to change a pose or a position, and ask for them anew after
    something was added.

    Parameters
    ----------
    camera_model : str
        Of all cameras: ``"perspective"`` holds what ``"calibrated"`` and ``"bal"`` do.

    Attributes
    ----------
    camera_names : list of str
        What a file calls the model of each camera (COLMAP's ``RADIAL``, say), or empty.
    image_names : list of str
        Name of each image.
    origin : WorldOrigin or None
        Of the world, where that is known; it stays where the map is moved.
    """

    def __init__(self, camera_model: str = "perspective") -> None:
        model = camera_model_of(require_pinhole(camera_model))
        self.camera_model = model.name
        self.camera_names: list[str] = []
        self.image_names: list[str] = []
        self.origin: WorldOrigin | None = None
        width = (len(model.intrinsics),)
        fixed = [name not in model.free_by_default for name in model.intrinsics]
        self._cameras = Table(
            intrinsics=(np.float64, width, np.nan),
            fixed=(np.bool_, width, fixed),
            sizes=(np.int64, (2,), 0),
            ids=(np.int64, (), 0),
        )
        self._images = Table(
            poses=(np.float64, (3, 4), np.nan),
            cameras=(np.int32, (), 0),
            begin=(np.intp, (), 0),
            counts=(np.intp, (), 0),
            ids=(np.int64, (), 0),
        )
        self._keypoints = Table(
            keypoints=(np.float64, (2,), np.nan),
            images=(np.int32, (), 0),
            colors=(np.uint8, (3,), 0),
            scales=(np.float64, (), np.nan),
            covariances=(np.float64, (3,), np.nan),
        )
        self._points = Table(
            positions=(np.float64, (3,), np.nan),
            colors=(np.uint8, (3,), 0),
            errors=(np.float64, (), UNKNOWN_ERROR),
            ids=(np.int64, (), 0),
        )
        self._tracks = Tracks()

    @property
    def intrinsics(self) -> FloatArray:
        """(G, K) intrinsics of each camera, in the order of the camera model."""
        return self._cameras["intrinsics"]

    @property
    def fixed_intrinsics(self) -> BoolArray:
        """(G, K) which of them no adjustment changes."""
        return self._cameras["fixed"]

    @property
    def camera_sizes(self) -> NDArray[np.int64]:
        """(G, 2) width and height of each camera's images [px]; 0 where unknown."""
        return self._cameras["sizes"]

    @property
    def camera_ids(self) -> NDArray[np.int64]:
        """(G,) identifier of each camera in files."""
        return self._cameras["ids"]

    @property
    def poses(self) -> FloatArray:
        """(I, 3, 4) pose ``[R | c]`` of each image, world_from_camera; not a number without one."""
        return self._images["poses"]

    @property
    def registered(self) -> BoolArray:
        """(I,) whether each image has a pose."""
        return np.asarray(np.isfinite(self.poses[:, 0, 0]))

    @property
    def image_cameras(self) -> IndexArray:
        """(I,) camera of each image."""
        return self._images["cameras"]

    @property
    def image_ids(self) -> NDArray[np.int64]:
        """(I,) identifier of each image in files."""
        return self._images["ids"]

    @property
    def keypoint_begin(self) -> Rows:
        """(I,) first keypoint of each image; those of one image follow each other."""
        return self._images["begin"]

    @property
    def keypoint_counts(self) -> Rows:
        """(I,) how many keypoints each image has."""
        return self._images["counts"]

    @property
    def keypoints(self) -> FloatArray:
        """(K, 2) image position of each keypoint [px]."""
        return self._keypoints["keypoints"]

    @property
    def keypoint_points(self) -> IndexArray:
        """(K,) point that each keypoint sees, or -1; changed by :meth:`observe` and :meth:`forget` alone."""
        return self._tracks.point

    @property
    def keypoint_images(self) -> IndexArray:
        """(K,) image of each keypoint."""
        return self._keypoints["images"]

    @property
    def keypoint_colors(self) -> NDArray[np.uint8]:
        """(K, 3) red, green, blue at each keypoint; black where unknown."""
        return self._keypoints["colors"]

    @property
    def keypoint_scales(self) -> FloatArray:
        """(K,) size of what was detected at each keypoint [px]; not a number where unknown."""
        return self._keypoints["scales"]

    @property
    def keypoint_covariances(self) -> FloatArray:
        """(K, 3) covariance of each keypoint, Σ_uu, Σ_uv, Σ_vv [px²]; not a number where 1 px is meant."""
        return self._keypoints["covariances"]

    @property
    def points(self) -> FloatArray:
        """(N, 3) position of each point; not a number without one."""
        return self._points["positions"]

    @property
    def known(self) -> BoolArray:
        """(N,) whether each point has a position."""
        return np.asarray(np.isfinite(self.points[:, 0]))

    @property
    def point_colors(self) -> NDArray[np.uint8]:
        """(N, 3) red, green, blue of each point; black where unknown."""
        return self._points["colors"]

    @property
    def point_errors(self) -> FloatArray:
        """(N,) mean reprojection error of each point [px] at the last :meth:`update_errors`; else -1."""
        return self._points["errors"]

    @property
    def point_ids(self) -> NDArray[np.int64]:
        """(N,) identifier of each point in files."""
        return self._points["ids"]

    @property
    def num_images(self) -> int:
        """Number of images, I."""
        return len(self.image_names)

    def add_cameras(
        self,
        intrinsics: ArrayLike,
        *,
        fixed: ArrayLike | None = None,
        sizes: ArrayLike | None = None,
        ids: ArrayLike | None = None,
        names: Sequence[str] | None = None,
    ) -> Rows:
        """Add cameras, which images may share.

        Parameters
        ----------
        intrinsics : (g, K) float64
            In the order of the camera model.
        fixed : (g, K) bool, optional
            Which of them no adjustment changes. Default: the camera model's.
        sizes : (g, 2) int, optional
            Width and height of their images [px].
        ids : (g,) int, optional
            Identifiers in files. Default: the next ones, from 1.
        names : sequence of str, optional
            What a file calls the model of each.

        Returns
        -------
        (g,) int
            Their numbers.

        Raises
        ------
        InvalidArgument
            If a shape is wrong.
        """
        count = len(np.asarray(intrinsics))
        if names and len(names) != count:
            raise InvalidArgument(f"names: {len(names)}, must be {count}")
        new = self._cameras.grow(
            count, intrinsics=intrinsics, fixed=fixed, sizes=sizes, ids=_ids(self._cameras, count, ids)
        )
        self.camera_names += names or [""] * count
        return new

    def add_images(
        self,
        names: Sequence[str],
        cameras: ArrayLike,
        counts: ArrayLike,
        keypoints: ArrayLike,
        *,
        points: ArrayLike | None = None,
        poses: ArrayLike | None = None,
        ids: ArrayLike | None = None,
        colors: ArrayLike | None = None,
        scales: ArrayLike | None = None,
        covariances: ArrayLike | None = None,
    ) -> Rows:
        """Add images with their keypoints.

        Parameters
        ----------
        names : sequence of i str
            Their names.
        cameras : (i,) int
            Their cameras.
        counts : (i,) int
            How many keypoints each has.
        keypoints : (k, 2) float64
            Image positions [px], image after image.
        points : (k,) int, optional
            The point that each sees, or -1, which is the default.
        poses : (i, 3, 4) float64, optional
            ``[R | c]``, world_from_camera; not a number where unknown, which is the default.
        ids : (i,) int, optional
            Identifiers in files. Default: the next ones, from 1.
        colors : (k, 3) uint8, optional
            Red, green, blue at each keypoint.
        scales : (k,) float64, optional
            Size of what was detected at each [px].
        covariances : (k, 3) float64, optional
            Σ_uu, Σ_uv, Σ_vv of each [px²]; not a number where 1 px is meant, which is the default.

        Returns
        -------
        (i,) int
            Their numbers.

        Raises
        ------
        InvalidArgument
            If a shape is wrong, there is no such camera or point, or an image would see a point twice.
        """
        counts = numbers_below("counts", counts, _MOST_KEYPOINTS)
        cameras = numbers_below("cameras", cameras, len(self.intrinsics))
        if counts.shape != (len(names),):
            raise InvalidArgument(f"counts: shape {counts.shape}, must be ({len(names)},)")
        total = int(counts.sum())
        images = np.repeat(np.arange(self.num_images, self.num_images + len(names)), counts)
        seen = np.full(total, NONE) if points is None else np.asarray(points, dtype=np.intp)
        if seen.shape != (total,):
            raise InvalidArgument(f"points: shape {seen.shape}, must be ({total},)")
        sees = np.flatnonzero(seen >= 0)
        self._require_once(seen[sees], images[sees])
        begin = len(self._keypoints) + np.cumsum(counts) - counts
        ids = _ids(self._images, len(names), ids)
        of_images = {"poses": poses, "cameras": cameras, "begin": begin, "counts": counts, "ids": ids}
        self._images.check(len(names), **of_images)
        of_keypoints = {"colors": colors, "scales": scales, "covariances": covariances}
        self._keypoints.grow(total, keypoints=keypoints, images=images, **of_keypoints)
        new = self._images.grow(len(names), **of_images)
        self._tracks.link(self._tracks.grow_keypoints(total)[sees], seen[sees])
        self.image_names += names
        return new

    def _require_once(self, points: Rows, images: NDArray[np.integer]) -> None:
        """Raise InvalidArgument unless there are all `points`, and no image sees one twice."""
        if ((points < 0) | (points >= len(self.points))).any():
            raise InvalidArgument(f"points: must be from 0 to {len(self.points) - 1}, or -1")
        # np.unique, which hashes, takes twenty times as long for millions.
        pairs = np.sort(images.astype(np.int64) * len(self.points) + points)
        if (pairs[1:] == pairs[:-1]).any():
            raise InvalidArgument("points: an image sees a point once at most")

    def _enter_world_of(self, other: Store) -> None:
        """Take over the origin of another map's world; InvalidArgument where this one has another."""
        if self.num_images == 0 and self.origin is None:
            self.origin = other.origin
        if self.origin is None or other.origin is None:
            return
        here, there = (origin.to_dict() for origin in (self.origin, other.origin))
        if here != there:
            raise InvalidArgument(
                f"other.origin: {there}, must be {here} as that of this map, or similarity be given"
            )

    def add_points(
        self, positions: ArrayLike, *, colors: ArrayLike | None = None, ids: ArrayLike | None = None
    ) -> Rows:
        """Add points that no keypoint sees yet.

        Parameters
        ----------
        positions : (n, 3) float64
            World points; not a number where unknown.
        colors : (n, 3) uint8, optional
            Red, green, blue of each.
        ids : (n,) int, optional
            Identifiers in files. Default: the next ones, from 1.

        Returns
        -------
        (n,) int
            Their numbers.

        Raises
        ------
        InvalidArgument
            If a shape is wrong.
        """
        count = len(np.asarray(positions))
        ids = _ids(self._points, count, ids)
        new = self._points.grow(count, positions=positions, colors=colors, ids=ids)
        self._tracks.grow_points(count)
        return new

    def keypoints_of(self, images: ArrayLike) -> Rows:
        """Rows of the keypoints of `images` (i,), image after image."""
        numbers = numbers_below("images", images, self.num_images)
        begin, counts = self.keypoint_begin[numbers], self.keypoint_counts[numbers]
        return np.asarray(np.repeat(begin + counts - np.cumsum(counts), counts) + np.arange(counts.sum()))

    def observations_of(self, points: ArrayLike) -> Rows:
        """Keypoints that see one of `points` (n,), point after point, in the order they came."""
        return self._tracks.in_order(numbers_below("points", points, len(self.points)))[0]

    def observations_with_places(self, points: ArrayLike) -> tuple[Rows, Rows]:
        """:meth:`observations_of`, with the place in `points` of what each sees; some may be there twice."""
        return self._tracks.in_order(numbers_below("points", points, len(self.points)))


def _ids(table: Table, count: int, given: ArrayLike | None) -> NDArray[np.int64]:
    """Identifiers of new rows: those given, else the next ones."""
    if given is not None:
        return np.asarray(given, dtype=np.int64)
    first = int(table["ids"].max(initial=0)) + 1
    return np.arange(first, first + count)
