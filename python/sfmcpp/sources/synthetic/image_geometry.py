"""Intrinsics, distortion and image size of a synthetic camera.

Its radial distortion has two coefficients: ``r ↦ r (1 + k1 r² + k2 r⁴)``, where that can be undone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.pinhole import unit
from sfmcpp.model import camera_model
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.model.checks import require_at_most, require_finite, require_one_of, require_positive

Distortion = tuple[float, float]

NO_DISTORTION: Distortion = (0.0, 0.0)
UP = np.array([0.0, 0.0, 1.0])
"""World direction that points up in every scene."""

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
        require_one_of("camera_model", self.camera_model, SCENE_CAMERA_MODELS)
        require_positive("focal_px", self.focal_px)
        if np.shape(self.image_size) != (2,) or min(self.image_size) < 1:
            raise InvalidArgument(f"image_size = {self.image_size}: must be two positive numbers of pixels")
        self._check_distortion()

    def _check_distortion(self) -> None:
        if np.shape(self.distortion) != (2,):
            raise InvalidArgument(f"distortion = {self.distortion}: must be two numbers, k1 and k2")
        for name, value in zip(("k1", "k2"), self.distortion, strict=True):
            require_finite(f"distortion: {name}", value)
            require_at_most(f"distortion: |{name}|", abs(value), _LARGEST_DISTORTION)
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
        offset_px, unfolded = self.image(np.stack([x / z, y / z], axis=1))
        inside = self.contains(offset_px) & unfolded
        return in_reach[inside].astype(np.int32), offset_px[inside] + self.principal_point_px

    def contains(self, offset_px: FloatArray) -> BoolArray:
        """(N,) whether offsets (N, 2) from the principal point are in the image."""
        across, down = np.abs(offset_px).T
        return np.asarray((across <= self.half_size_px[0]) & (down <= self.half_size_px[1]))

    def image(self, tangents: FloatArray) -> tuple[FloatArray, BoolArray | np.bool_]:
        """Offsets from the principal point [px], and which of them are no images of points far outside."""
        if not self.is_distorted:
            return self.focal_px * tangents, np.True_
        # The slack keeps a point on the corner itself; whether it is inside, its pixel tells.
        unfolded = np.hypot(*tangents.T) <= self.corner_tangent * (1 + 1e-9)
        kept = np.where(unfolded[:, None], tangents, 0.0)
        return self.focal_px * distort(kept, self.distortion), unfolded


def looking_at(centres: FloatArray, targets: FloatArray, up: FloatArray) -> FloatArray:
    """Aim cameras ``[R | c]`` from `centres` at `targets`, z forward, y down.

    Parameters
    ----------
    centres : (C, 3) float64
        Camera centres in the world.
    targets : (C, 3) or (3,) float64
        World points on the optical axes.
    up : (3,) float64
        World direction that points up in every image; not parallel to any optical axis.

    Returns
    -------
    (C, 3, 4) float64
        Rotation world_from_camera and centre of each camera.
    """
    forward = unit(targets - centres)
    right = unit(np.cross(forward, up))
    down = np.cross(forward, right)
    return np.stack([right, down, forward, centres], axis=2)


def distort(offsets: FloatArray, distortion: Distortion) -> FloatArray:
    """Distort image offsets (N, 2), in units of the focal length."""
    k1, k2 = distortion
    squared_radius = (offsets**2).sum(axis=1, keepdims=True)
    distorted: FloatArray = offsets * (1 + squared_radius * (k1 + squared_radius * k2))
    return distorted


def undistorted_radius(radius: float, distortion: Distortion) -> float:
    """The radius that becomes `radius`, both in units of the focal length.

    Raises
    ------
    InvalidArgument
        If the distortion folds the image over before that radius.
    """
    fold = _fold_radius(distortion)
    if math.isfinite(fold) and _distorted(fold, distortion) <= radius:
        raise InvalidArgument(
            f"distortion = {distortion}: folds the image at {_distorted(fold, distortion):.4g} focal lengths "
            f"from its centre, must be invertible up to its corner at {radius:.4g}"
        )
    above = radius
    while above < fold and _distorted(above, distortion) < radius:
        above *= 2
    return _radius_by_bisection(radius, min(above, fold), distortion)


# Whose square is a number.
_LARGEST_DISTORTION = 1e100


def _distorted(radius: float, distortion: Distortion) -> float:
    k1, k2 = distortion
    return radius * (1 + radius**2 * (k1 + radius**2 * k2))


def _fold_radius(distortion: Distortion) -> float:
    """Smallest radius where the derivative ``1 + 3 k1 r² + 5 k2 r⁴`` vanishes; infinite if nowhere."""
    k1, k2 = distortion
    discriminant = 9 * k1**2 - 20 * k2
    if discriminant < 0:
        return math.inf
    denominator = math.sqrt(discriminant) - 3 * k1
    return math.sqrt(2 / denominator) if denominator > 0 else math.inf


def _radius_by_bisection(radius: float, above: float, distortion: Distortion) -> float:
    below = 0.0
    while below < (middle := (below + above) / 2) < above:
        if _distorted(middle, distortion) < radius:
            below = middle
        else:
            above = middle
    return above
