"""A lens that distorts gives the trajectory of one that does not."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.geometry.pinhole import to_normalised, to_pixels
from sfmcpp.sensors import Mounting
from sfmcpp.slam import Gyroscope, SlamResult, TrackSequence, run_slam
from sfmcpp.sources.synthetic import DRIVES, SyntheticDrive
from sfmcpp.study.evaluation import evaluate

# As strong as that of EuRoC's cameras: k1 to k5, p1, p2.
DISTORTION = np.array([-0.28, 0.07, 0.0, 0.0, 0.0, 2e-4, 2e-5])
FRAMES = 150


def run(drive: SyntheticDrive, pixels: np.ndarray, intrinsics: np.ndarray) -> SlamResult:
    """SLAM with the gyroscope over the first frames."""
    kept = drive.frame_index < FRAMES
    frames, tracks = drive.frame_index[kept], drive.track_index[kept]
    sequence = TrackSequence(drive.t_s[:FRAMES], frames, tracks, pixels[kept], intrinsics)
    mounting = Mounting(drive.camera_from_body, drive.lever_arm_m)
    return run_slam(sequence, sensors=[Gyroscope(drive.angular_rate, mounting)])


def error_m(result: SlamResult, drive: SyntheticDrive) -> float:
    return evaluate(result.trajectory(), drive.truth, with_scale=True).mean_3d_error_m


@pytest.mark.parametrize("kind", ["vehicle", "table-walk"])
def test_distorted_pixels_give_the_trajectory_of_undistorted_ones(kind: str) -> None:
    drive = DRIVES[kind](seed=3)
    lens = np.concatenate([drive.intrinsics, DISTORTION])
    distorted = to_pixels(to_normalised(drive.pixels, drive.intrinsics), lens)
    assert np.linalg.norm(distorted - drive.pixels, axis=1).max() > 20
    ideal, seen = run(drive, drive.pixels, drive.intrinsics), run(drive, distorted, lens)
    assert len(seen.poses) == len(ideal.poses)
    assert error_m(seen, drive) < 1.5 * error_m(ideal, drive)
    unaware = run(drive, distorted, drive.intrinsics)
    assert error_m(unaware, drive) > 2 * error_m(seen, drive)
