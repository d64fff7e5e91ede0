"""What one camera sees of points whose positions are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.model.arrays import ANY, FloatArray, finite_array
from sfmcpp.model.uncertainty import require_one_uncertainty

# No image is measured better: perfect synthetic ones have no variance to compare with.
LEAST_SIGMA = 1e-3


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
