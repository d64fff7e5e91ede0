"""Inputs of the weight of one pose: what its camera sees, and what a second sensor measures."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import CONSTRAINT_KINDS
from sfmcpp.model.arguments import check_fields
from sfmcpp.model.arrays import ANY, FloatArray, finite_array
from sfmcpp.model.checks import require_not_negative, require_one_of, require_positive
from sfmcpp.model.uncertainty import require_one_uncertainty
from sfmcpp.weighting.units import ConstraintUnit, unit_of

# No image is measured better: perfect synthetic ones have no variance to compare with.
LEAST_SIGMA = 1e-3
# Constraints on intrinsics are no constraints on one pose.
POSE_KINDS = tuple(name for name, kind in CONSTRAINT_KINDS.items() if kind.on_poses)


@dataclass(frozen=True)
class PoseView:
    """Observations from which the pose of one metric camera is fitted.

    Only inliers belong here: every observation counts in full.

    Parameters
    ----------
    points : (n, 3) float64
        World points, fixed; at least 4.
    pixels : (n, 2) float64
        Their images [px].
    intrinsics : (K,) float64
        Intrinsic parameters in the order of the camera model.
    camera_model : str
        ``"calibrated"``, ``"perspective"`` or ``"bal"``.
    sigma_px : (n,) float64, optional
        Standard deviation of each image [px]; None: 1 px. Errors of images are in units of it.
    covariance_px2 : (n, 2, 2) float64, optional
        Covariance of each image [px²], in place of `sigma_px`; errors of images are then whitened by it.

    Raises
    ------
    InvalidArgument
        If an array has the wrong shape or is not finite, or both `sigma_px` and `covariance_px2` are given.
        Values are checked when the pose is fitted.
    """

    points: FloatArray
    pixels: FloatArray
    intrinsics: FloatArray
    camera_model: str = "calibrated"
    sigma_px: FloatArray | None = None
    covariance_px2: FloatArray | None = None

    def __post_init__(self) -> None:
        points = finite_array("points", self.points, (ANY, 3))
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "pixels", finite_array("pixels", self.pixels, (len(points), 2)))
        object.__setattr__(self, "intrinsics", finite_array("intrinsics", self.intrinsics, (ANY,)))
        if self.sigma_px is not None:
            object.__setattr__(self, "sigma_px", finite_array("sigma_px", self.sigma_px, (len(points),)))
        if self.covariance_px2 is not None:
            covariances = finite_array("covariance_px2", self.covariance_px2, (len(points), 2, 2))
            object.__setattr__(self, "covariance_px2", covariances)
        require_one_uncertainty(self.sigma_px, self.covariance_px2)

    @property
    def count(self) -> int:
        """Number of observations."""
        return len(self.points)

    def pixel_sigma(self, vision: float) -> float:
        """Standard deviation of the images, in units of `sigma_px`, from the error of an unconstrained fit.

        Parameters
        ----------
        vision : float
            Mean squared reprojection error at the minimum.

        Returns
        -------
        float
            Root of the sum of squares over the 2n − 6 degrees of freedom, at least `LEAST_SIGMA`.
        """
        return max(float(np.sqrt(self.count * vision / (2 * self.count - 6))), LEAST_SIGMA)

    def arrays(self) -> dict[str, object]:
        """The arrays by name as the core takes them."""
        return {
            "camera_model": self.camera_model,
            "intrinsics": self.intrinsics,
            "points": self.points,
            "pixels": self.pixels,
            "sigma_px": self.sigma_px,
            "covariance_px2": self.covariance_px2,
        }


@dataclass(frozen=True)
class PoseConstraint:
    """One row of thesis table 5.1 for one pose, the earlier pose held fixed.

    Each kind reads its part of the measurement. The frames of displacements: translations are in the world
    (thesis dt), rotations and poses in the earlier camera.

    =============================  ============================================================
    kind                           reads
    =============================  ============================================================
    ``pose``                       `rotation`, `translation`: the pose, world_from_camera
    ``position``                   `translation`: the centre
    ``orientation``                `rotation`, world_from_camera
    ``orientation-reprojections``  `rotation`; `points`, `intrinsics` turn it into pixels
    ``displacement-pose``          `rotation`, `translation`: previous_from_camera; `previous`
    ``displacement-translation``   `translation`, in the world; `previous`
    ``displacement-rotation``      `rotation`, previous_from_camera; `previous`
    ``displacement-rotation-log``  the same; the error is an angle instead of a matrix
    ``scale``                      `distance` between the two centres; `previous`
    ``smoothing``                  `previous`: the projection matrices should not differ
    ``smoothing-reprojections``    `previous`, `points`, `intrinsics`
    =============================  ============================================================

    Parameters
    ----------
    kind : str
        One of `POSE_KINDS`.
    rotation : (3, 3) float64
        Measured rotation.
    translation : (3,) float64
        Measured centre or displacement [m].
    distance : float
        Measured distance [m], not negative.
    previous : (3, 4) float64
        The earlier pose, world_from_camera.
    points : (N, 3) float64
        World points at which reprojections are compared, in front of both cameras.
    intrinsics : (5,) float64
        ``(f, aspect, cx, cy, skew)`` of these reprojections.
    sensor_sigma : float, optional
        Declared standard deviation of the sensor, in the unit of the kind; None: unknown.
    yields : bool
        Whether a conflict with the images lowers the bounds of its weight. Not where the sensor shows by
        itself when it is wrong: then the map is.
    slack : float
        What the sensor may be off beyond `sensor_sigma`, where a conflict is judged; its weight is that of
        `sensor_sigma` alone.
    name : str
        What reports call it; empty: its kind.

    Raises
    ------
    InvalidArgument
        If the kind is unknown or a part has the wrong shape or is not finite.
    """

    kind: str
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    translation: FloatArray = field(default_factory=lambda: np.zeros(3))
    distance: float = 0.0
    previous: FloatArray | None = None
    points: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    intrinsics: FloatArray = field(default_factory=lambda: np.array([1.0, 1.0, 0.0, 0.0, 0.0]))
    sensor_sigma: float | None = None
    yields: bool = True
    slack: float = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        require_one_of("kind", self.kind, POSE_KINDS)
        check_fields(self, "distance", "yields", "name")
        if CONSTRAINT_KINDS[self.kind].cameras == (2,) and self.previous is None:
            raise InvalidArgument(f"previous = None: a {self.kind} constraint needs the earlier pose")
        if self.sensor_sigma is not None:
            require_positive("sensor_sigma", self.sensor_sigma)
        require_not_negative("slack", self.slack)
        self._freeze("rotation", self.rotation, (3, 3))
        self._freeze("translation", self.translation, (3,))
        self._freeze("points", self.points, (ANY, 3))
        self._freeze("intrinsics", self.intrinsics, (5,))
        if self.previous is not None:
            self._freeze("previous", self.previous, (3, 4))
        if not self.name:
            object.__setattr__(self, "name", self.kind)

    def _freeze(self, name: str, value: ArrayLike, shape: tuple[int, ...]) -> None:
        object.__setattr__(self, name, finite_array(name, value, shape))

    @property
    def unit(self) -> ConstraintUnit:
        """Unit of the sensor's error, and how it relates to the mean squared error."""
        return unit_of(self.kind, [self.points])

    def arrays(self, weight: float) -> dict[str, object]:
        """The constraint at a weight as the core takes it."""
        return {
            "kind": self.kind,
            "rotation": self.rotation,
            "translation": self.translation,
            "distance": float(self.distance),
            "previous": np.eye(3, 4) if self.previous is None else self.previous,
            "points": self.points,
            "intrinsics": self.intrinsics,
            "weight": float(weight),
        }
