"""Result type of pose estimates, also of failed ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.model.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class PoseEstimate:
    """A camera pose from matches with outliers, or why there is none.

    Attributes
    ----------
    camera : (3, 4) float64
        ``[R | c]``, world_from_camera; not a number where a failure leaves it unknown.
    inliers : (N,) bool
        Matches that agree with the pose.
    failure : str
        Empty, or the name of what makes the pose unusable.
    message : str
        Why, with the numbers at fault; empty without a failure.
    """

    camera: FloatArray
    inliers: BoolArray
    failure: str
    message: str

    @property
    def success(self) -> bool:
        """Whether the pose can be used."""
        return not self.failure

    @property
    def num_inliers(self) -> int:
        """Number of matches that agree with the pose."""
        return int(np.count_nonzero(self.inliers))


def unknown_camera() -> FloatArray:
    """``[R | c]`` of a camera that nothing is known of: not a number everywhere."""
    return np.full((3, 4), np.nan)


def failed_pose(count: int, failure: str, message: str) -> PoseEstimate:
    """No pose from `count` matches, and why."""
    return PoseEstimate(unknown_camera(), np.zeros(count, dtype=np.bool_), failure, message)


def pose_with_inliers(camera: FloatArray, inliers: BoolArray, least: int) -> PoseEstimate:
    """The pose, if it has the `least` inliers."""
    count = int(np.count_nonzero(inliers))
    if count < least:
        return failed_pose(len(inliers), *too_few("inliers", count, least))
    return PoseEstimate(camera, inliers, "", "")


def too_few(kind: str, count: int, least: int) -> tuple[str, str]:
    """Failure and message of having `count` matches or inliers where `least` are needed."""
    return f"too few {kind}", f"{count} {kind}: must be at least {least}"
