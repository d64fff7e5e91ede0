"""Simulated observations: distortion-free cameras with square pixels looking at points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem, camera_model
from sfmcpp.model.problem import FloatArray, IndexArray
from sfmcpp.synthetic.checks import require_not_negative, require_positive


@dataclass(frozen=True)
class ImageGeometry:
    """The one camera that takes all images of a scene.

    Attributes
    ----------
    camera_model : str
        Camera model of the problem. ``"bal"`` has its pixel origin at the image centre, the others at
        the top left corner with the principal point at the image centre.
    focal_px : float
        Focal length [px].
    image_size : (int, int)
        Width and height [px].
    """

    camera_model: str
    focal_px: float
    image_size: tuple[int, int]

    def __post_init__(self) -> None:
        camera_model(self.camera_model)
        require_positive("focal_px", self.focal_px)
        if np.shape(self.image_size) != (2,) or min(self.image_size) < 1:
            raise InvalidArgument(f"image_size = {self.image_size}: must be two positive numbers of pixels")

    @property
    def half_size_px(self) -> FloatArray:
        """(2,) half the width and half the height [px]."""
        return np.array(self.image_size) / 2

    @property
    def principal_point_px(self) -> FloatArray:
        """(2,) principal point [px]."""
        return np.zeros(2) if self.camera_model == "bal" else self.half_size_px

    def intrinsics(self, num_cameras: int) -> FloatArray:
        """(C, K) intrinsics of that many equal cameras, in the order of the camera model."""
        cx, cy = self.principal_point_px
        values = {"f": self.focal_px, "aspect": 1.0, "cx": cx, "cy": cy}
        names = camera_model(self.camera_model).intrinsics
        return np.tile([values.get(name, 0.0) for name in names], (num_cameras, 1))

    def project(self, camera: FloatArray, points: FloatArray) -> tuple[IndexArray, FloatArray]:
        """Project `points` (N, 3) into one `camera` (3, 4): indices of those it sees, and their pixels."""
        rotation, centre = camera[:, :3], camera[:, 3]
        points_in_camera = (points - centre) @ rotation
        in_front = np.flatnonzero(points_in_camera[:, 2] > 0)
        x, y, z = points_in_camera[in_front].T
        offset_px = self.focal_px * np.stack([x / z, y / z], axis=1)
        inside = (np.abs(offset_px) <= self.half_size_px).all(axis=1)
        return in_front[inside].astype(np.int32), offset_px[inside] + self.principal_point_px


def observe(
    geometry: ImageGeometry,
    cameras: FloatArray,
    points: FloatArray,
    pixel_sigma_px: float,
    rng: np.random.Generator,
) -> Problem:
    """Make the problem of `cameras` (C, 3, 4) that look at `points` (N, 3), its state the truth.

    A camera observes the points in front of it whose exact projection lies in the image; Gaussian noise of
    `pixel_sigma_px` is then added to each coordinate. Observations are sorted by point, then by camera.

    Raises
    ------
    InvalidArgument
        If `pixel_sigma_px` is negative or not finite.
    """
    require_not_negative("pixel_sigma_px", pixel_sigma_px)
    seen = [geometry.project(camera, points) for camera in cameras]
    point_index = np.concatenate([indices for indices, _ in seen])
    camera_index = np.repeat(np.arange(len(cameras), dtype=np.int32), [len(i) for i, _ in seen])
    pixels = np.concatenate([exact for _, exact in seen])
    by_point = np.argsort(point_index, kind="stable")
    problem = Problem(
        geometry.camera_model,
        cameras,
        geometry.intrinsics(len(cameras)),
        points,
        camera_index[by_point],
        point_index[by_point],
        pixels[by_point] + pixel_sigma_px * rng.standard_normal(pixels.shape),
    )
    problem.metadata.image_sizes = np.tile(np.array(geometry.image_size, dtype=np.int64), (len(cameras), 1))
    return problem
