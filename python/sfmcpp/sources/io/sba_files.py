"""What sba's files consist of, and which of them belong together."""

from __future__ import annotations

import re
from pathlib import Path

INTRINSICS = ("f", "cx", "cy", "aspect", "skew")
DISTORTION = ("k1", "k2", "p1", "p2", "k3")
POSE_NUMBERS = 7

_CAMERAS_NAME = re.compile(r"(?P<stem>.*)cams[^/]*\.txt", re.IGNORECASE)


def is_cameras_name(path: Path) -> bool:
    """Whether a name is that of a cameras file: ``…cams….txt``."""
    return _CAMERAS_NAME.fullmatch(path.name) is not None


def points_path(cameras: Path) -> Path:
    """``7pts.txt`` beside ``7cams.txt`` or ``7camsvarK.txt``."""
    return cameras.with_name(f"{_stem(cameras)}pts.txt")


def calibration_path(cameras: Path) -> Path:
    """``7calib.txt`` beside ``7cams.txt``."""
    return cameras.with_name(f"{_stem(cameras)}calib.txt")


def shared_calibration_path(cameras: Path) -> Path:
    """``calib.txt``, which the cameras files of a folder may share."""
    return cameras.with_name("calib.txt")


def _stem(cameras: Path) -> str:
    match = _CAMERAS_NAME.fullmatch(cameras.name)
    return match["stem"] if match else f"{cameras.stem}_"
