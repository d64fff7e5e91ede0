"""What matches of two images say of their cameras, known or not (thesis §3.1.4)."""

from __future__ import annotations

from dataclasses import dataclass

from sfmcpp.model.arrays import BoolArray, FloatArray

# From the most to the least that a pair tells.
KINDS = ("general", "planar", "rotation", "none")


@dataclass(frozen=True, eq=False)
class TwoViewGeometry:
    """What the matches of two images say of their cameras.

    Attributes
    ----------
    kind : str
        ``"general"``: two places and a scene in depth. ``"planar"``: a plane, or too little depth to tell.
        ``"rotation"``: the camera turned on the spot, or the photos are the same. ``"none"``: nothing agrees.
    inliers : (m,) bool
        Matches that agree with it.
    fundamental : (3, 3) float64
        ``(u₁, v₁, 1) F (u₂, v₂, 1)ᵀ = 0``; not a number unless ``"general"``, or both cameras are known and
        the translation too.
    homography : (3, 3) float64
        ``(u₂, v₂, 1) ∝ H (u₁, v₁, 1)``; not a number where it was not needed or not found.
    camera : (3, 4) float64
        ``[R | c]`` of camera 2 in the frame of camera 1, ‖c‖ = 1 (0 for a rotation); not a number unless both
        cameras are known, or good enough guessed.
    median_angle_deg : float
        Median angle between the rays of the inliers [deg]; not a number without a camera.
    message : str
        Why it is no better than it is; empty for ``"general"``.
    """

    kind: str
    inliers: BoolArray
    fundamental: FloatArray
    homography: FloatArray
    camera: FloatArray
    median_angle_deg: float
    message: str
