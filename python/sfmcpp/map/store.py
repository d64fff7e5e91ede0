"""What a map holds, as columns that grow: images with their keypoints, cameras, points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.map.column import Column
from sfmcpp.map.tracks import Rows, Tracks
from sfmcpp.model import camera_model as camera_model_of
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray

UNKNOWN_ERROR = -1.0


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
    """

    def __init__(self, camera_model: str = "perspective") -> None:
        model = camera_model_of(camera_model)
        self.camera_model = model.name
        self.camera_names: list[str] = []
        self.image_names: list[str] = []
        width = (len(model.intrinsics),)
        fixed = [name not in model.free_by_default for name in model.intrinsics]
        self._intrinsics, self._fixed = Column(np.float64, width), Column(np.bool_, width, fixed)
        self._camera_size, self._camera_id = Column(np.int64, (2,)), Column(np.int64)
        self._pose, self._camera = Column(np.float64, (3, 4), np.nan), Column(np.int32)
        self._image_id, self._begin = Column(np.int64), Column(np.intp)
        self._pixel, self._image = Column(np.float64, (2,)), Column(np.int32)
        self._keypoint_color = Column(np.uint8, (3,))
        self._scale = Column(np.float64, fill=np.nan)
        self._position, self._error = Column(np.float64, (3,), np.nan), Column(np.float64, fill=UNKNOWN_ERROR)
        self._color, self._point_id = Column(np.uint8, (3,)), Column(np.int64)
        self._tracks = Tracks()
        self._begin.grow(1)
        self._largest_id = {"camera": 0, "image": 0, "point": 0}

    @property
    def intrinsics(self) -> FloatArray:
        """(G, K) intrinsics of each camera, in the order of the camera model."""
        return self._intrinsics.rows

    @property
    def fixed_intrinsics(self) -> BoolArray:
        """(G, K) which of them no adjustment changes."""
        return self._fixed.rows

    @property
    def camera_sizes(self) -> NDArray[np.int64]:
        """(G, 2) width and height of each camera's images [px]; 0 where unknown."""
        return self._camera_size.rows

    @property
    def camera_ids(self) -> NDArray[np.int64]:
        """(G,) identifier of each camera in files."""
        return self._camera_id.rows

    @property
    def poses(self) -> FloatArray:
        """(I, 3, 4) pose ``[R | c]`` of each image, world_from_camera; not a number without one."""
        return self._pose.rows

    @property
    def registered(self) -> BoolArray:
        """(I,) whether each image has a pose."""
        return np.asarray(np.isfinite(self.poses[:, 0, 0]))

    @property
    def image_cameras(self) -> IndexArray:
        """(I,) camera of each image."""
        return self._camera.rows

    @property
    def image_ids(self) -> NDArray[np.int64]:
        """(I,) identifier of each image in files."""
        return self._image_id.rows

    @property
    def keypoint_begin(self) -> Rows:
        """(I + 1,) first keypoint of each image; those of one image follow each other."""
        return self._begin.rows

    @property
    def keypoints(self) -> FloatArray:
        """(K, 2) image position of each keypoint [px]."""
        return self._pixel.rows

    @property
    def keypoint_points(self) -> IndexArray:
        """(K,) point that each keypoint sees, or -1; changed by :meth:`observe` and :meth:`forget` alone."""
        return self._tracks.point

    @property
    def keypoint_images(self) -> IndexArray:
        """(K,) image of each keypoint."""
        return self._image.rows

    @property
    def keypoint_colors(self) -> NDArray[np.uint8]:
        """(K, 3) red, green, blue at each keypoint; black where unknown."""
        return self._keypoint_color.rows

    @property
    def keypoint_scales(self) -> FloatArray:
        """(K,) size of what was detected at each keypoint [px]; not a number where unknown."""
        return self._scale.rows

    @property
    def points(self) -> FloatArray:
        """(N, 3) position of each point; not a number without one."""
        return self._position.rows

    @property
    def known(self) -> BoolArray:
        """(N,) whether each point has a position."""
        return np.asarray(np.isfinite(self.points[:, 0]))

    @property
    def point_colors(self) -> NDArray[np.uint8]:
        """(N, 3) red, green, blue of each point; black where unknown."""
        return self._color.rows

    @property
    def point_errors(self) -> FloatArray:
        """(N,) mean reprojection error of each point [px] at the last :meth:`update_errors`; else -1."""
        return self._error.rows

    @property
    def point_ids(self) -> NDArray[np.int64]:
        """(N,) identifier of each point in files."""
        return self._point_id.rows

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
        begin, count = len(self.intrinsics), len(np.asarray(intrinsics))
        self._intrinsics.grow(count, intrinsics, "intrinsics")
        self._fixed.grow(count, fixed, "fixed")
        self._camera_size.grow(count, sizes, "sizes")
        self._camera_id.grow(count, self._ids("camera", count, ids), "ids")
        self.camera_names += names or [""] * count
        return np.arange(begin, begin + count)

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

        Returns
        -------
        (i,) int
            Their numbers.

        Raises
        ------
        InvalidArgument
            If a shape is wrong, there is no such camera or point, or an image would see a point twice.
        """
        begin, count = self.num_images, len(names)
        chosen, per_image = np.asarray(cameras, dtype=np.intp), np.asarray(counts, dtype=np.intp)
        if ((chosen < 0) | (chosen >= len(self.intrinsics))).any():
            raise InvalidArgument(f"cameras = {chosen}: must be from 0 to {len(self.intrinsics) - 1}")
        total, new_images = int(per_image.sum()), np.arange(begin, begin + count)
        rows, seen = np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
        if points is not None:
            rows = np.flatnonzero(np.asarray(points) >= 0)
            seen = np.asarray(points, dtype=np.intp)[rows]
            self._require_once(seen, np.repeat(new_images, per_image)[rows])
        self._camera.grow(count, chosen, "cameras")
        self._begin.grow(count, self.keypoint_begin[-1] + np.cumsum(per_image), "counts")
        self._pose.grow(count, poses, "poses")
        self._image_id.grow(count, self._ids("image", count, ids), "ids")
        self._pixel.grow(total, keypoints, "keypoints")
        self._image.grow(total, np.repeat(new_images, per_image))
        self._keypoint_color.grow(total, colors, "colors")
        self._scale.grow(total, scales, "scales")
        self._tracks.grow_keypoints(total)
        self._tracks.link(len(self.keypoints) - total + rows, seen)
        self.image_names += names
        return new_images

    def _require_once(self, points: Rows, images: NDArray[np.integer]) -> None:
        """Raise InvalidArgument unless there are all `points`, and no image sees one twice."""
        if ((points < 0) | (points >= len(self.points))).any():
            raise InvalidArgument(f"points: must be from 0 to {len(self.points) - 1}, or -1")
        pairs = images.astype(np.int64) * len(self.points) + points
        if len(np.unique(pairs)) != len(pairs):
            raise InvalidArgument("points: an image sees a point once at most")

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
        begin, count = len(self.points), len(np.asarray(positions))
        self._position.grow(count, positions, "positions")
        self._color.grow(count, colors, "colors")
        self._error.grow(count)
        self._point_id.grow(count, self._ids("point", count, ids), "ids")
        self._tracks.grow_points(count)
        return np.arange(begin, begin + count)

    def _ids(self, kind: str, count: int, given: ArrayLike | None) -> NDArray[np.int64]:
        largest = self._largest_id[kind]
        ids = np.arange(largest + 1, largest + 1 + count) if given is None else np.asarray(given, np.int64)
        self._largest_id[kind] = int(ids.max(initial=largest))
        return ids

    def keypoints_of(self, images: ArrayLike) -> Rows:
        """Rows of the keypoints of `images` (i,), image after image."""
        numbers = np.asarray(images, dtype=np.intp)
        begin, end = self.keypoint_begin[numbers], self.keypoint_begin[numbers + 1]
        counts = end - begin
        return np.asarray(np.repeat(end - np.cumsum(counts), counts) + np.arange(counts.sum()))

    def observations_of(self, points: ArrayLike) -> Rows:
        """Keypoints that see one of `points` (n,), point after point, in the order they were told of."""
        return self._tracks.in_order(np.asarray(points, dtype=np.intp))[0]
