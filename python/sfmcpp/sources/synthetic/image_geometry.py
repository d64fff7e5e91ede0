"""The camera that takes the images of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import camera_model
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.model.checks import require_finite, require_positive
from sfmcpp.sources.synthetic.distortion import NO_DISTORTION, Distortion, distort, undistorted_radius

SCENE_CAMERA_MODELS = ("calibrated", "perspective", "bal")


@dataclass(frozen=True)
class ImageGeometry:
    """The one camera that takes all images of a scene: square pixels, the principal point in the middle.

    Attributes
    ----------
    camera_model : str
        Camera model of the problem. ``"bal"`` has its pixel origin at the image centre, the others at
        the top left corner with the principal point at the image centre.
    focal_px : float
        Focal length [px].
    image_size : (int, int)
        Width and height [px].
    distortion : (float, float)
        Radial distortion k1, k2 of the camera model; none for ``"calibrated"``. It must be invertible within
        the image: what would be folded back into the image from beyond its corners is not seen.
    """

    camera_model: str
    focal_px: float
    image_size: tuple[int, int]
    distortion: Distortion = NO_DISTORTION

    def __post_init__(self) -> None:
        if self.camera_model not in SCENE_CAMERA_MODELS:
            known = ", ".join(SCENE_CAMERA_MODELS)
            raise InvalidArgument(f"camera_model = {self.camera_model!r}: must be one of {known}")
        require_positive("focal_px", self.focal_px)
        if np.shape(self.image_size) != (2,) or min(self.image_size) < 1:
            raise InvalidArgument(f"image_size = {self.image_size}: must be two positive numbers of pixels")
        self._check_distortion()

    def _check_distortion(self) -> None:
        if np.shape(self.distortion) != (2,):
            raise InvalidArgument(f"distortion = {self.distortion}: must be two numbers, k1 and k2")
        for name, value in zip(("k1", "k2"), self.distortion, strict=True):
            require_finite(f"distortion: {name}", value)
        if self.is_distorted and self.camera_model == "calibrated":
            raise InvalidArgument(f"distortion = {self.distortion}: camera model 'calibrated' has none")
        undistorted_radius(self._corner_radius, self.distortion)

    @property
    def is_distorted(self) -> bool:
        """Whether any coefficient of the distortion differs from zero."""
        return any(self.distortion)

    @property
    def half_size_px(self) -> FloatArray:
        """(2,) half the width and half the height [px]."""
        return np.array(self.image_size) / 2

    @property
    def principal_point_px(self) -> FloatArray:
        """(2,) principal point [px]."""
        return np.zeros(2) if self.camera_model == "bal" else self.half_size_px

    @cached_property
    def corner_tangent(self) -> float:
        """Tangent of the angle between the optical axis and the ray of an image corner."""
        return undistorted_radius(self._corner_radius, self.distortion)

    @property
    def _corner_radius(self) -> float:
        return float(np.hypot(*self.half_size_px)) / self.focal_px

    def intrinsics(self, num_cameras: int) -> FloatArray:
        """(C, K) intrinsics of that many equal cameras, in the order of the camera model."""
        cx, cy = self.principal_point_px
        k1, k2 = self.distortion
        values = {"f": self.focal_px, "aspect": 1.0, "cx": cx, "cy": cy, "k1": k1, "k2": k2}
        names = camera_model(self.camera_model).intrinsics
        return np.tile([values.get(name, 0.0) for name in names], (num_cameras, 1))

    def project(
        self, camera: FloatArray, points: FloatArray, max_depth_m: float | FloatArray = np.inf
    ) -> tuple[IndexArray, FloatArray]:
        """Project `points` (N, 3) into one `camera` (3, 4): indices of those it sees, and their pixels.

        It sees those in front of it, up to `max_depth_m` (of each, or of all), that fall into the image.
        """
        rotation, centre = camera[:, :3], camera[:, 3]
        points_in_camera = (points - centre) @ rotation
        depth = points_in_camera[:, 2]
        in_reach = np.flatnonzero((depth > 0) & (depth <= max_depth_m))
        x, y, z = points_in_camera[in_reach].T
        offset_px, unfolded = self._image(np.stack([x / z, y / z], axis=1))
        inside = (np.abs(offset_px) <= self.half_size_px).all(axis=1) & unfolded
        return in_reach[inside].astype(np.int32), offset_px[inside] + self.principal_point_px

    def _image(self, tangents: FloatArray) -> tuple[FloatArray, np.bool_ | np.ndarray]:
        """Offsets from the principal point [px], and which of them are no images of points far outside."""
        if not self.is_distorted:
            return self.focal_px * tangents, np.True_
        # The slack keeps a point on the corner itself; whether it is inside, its pixel tells.
        unfolded = np.hypot(*tangents.T) <= self.corner_tangent * (1 + 1e-9)
        kept = np.where(unfolded[:, None], tangents, 0.0)
        return self.focal_px * distort(kept, self.distortion), unfolded
