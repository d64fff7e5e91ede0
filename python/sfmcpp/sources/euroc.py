"""Folders of EuRoC (ASL): images of ``cam0``, rates of ``imu0``, and the truth, all on one body."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sfmcpp.model import Trajectory
from sfmcpp.sensors import Mounting
from sfmcpp.sources.io.trajectories import read_trajectory

_ROOT, _IMAGES, _RATES = "mav0", "cam0/data", "imu0/data.csv"
_TRUTH = "state_groundtruth_estimate0/data.csv"


@dataclass(frozen=True)
class EurocFolder:
    """What a folder of EuRoC holds.

    Attributes
    ----------
    images : Path
        Those of the first camera.
    rates : Path or None
        What the IMU measured.
    truth : Path or None
        Poses of the body.
    """

    images: Path
    rates: Path | None
    truth: Path | None

    def camera_truth(self, mounting: Mounting) -> Trajectory | None:
        """True poses of a camera that sits so on the body; None where the folder knows none."""
        if self.truth is None:
            return None
        body = read_trajectory(self.truth)
        return Trajectory(body.t_s, mounting.camera_poses(body.poses))


def euroc_folder(path: Path) -> EurocFolder | None:
    """Find what ``mav0``, or the folder that holds it, has; None if `path` is no such folder."""
    root = path / _ROOT if (path / _ROOT).is_dir() else path
    if not (root / _IMAGES).is_dir():
        return None
    rates, truth = (file if file.is_file() else None for file in (root / _RATES, root / _TRUTH))
    return EurocFolder(root / _IMAGES, rates, truth)
