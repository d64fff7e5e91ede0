"""What a user says of the cameras, and what the files say, as first intrinsics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.arrays import FloatArray, finite_array
from sfmcpp.model.photos import Photo
from sfmcpp.sfm.cameras import PERSPECTIVE, Cameras, cameras_of
from sfmcpp.sources.cameras import camera_file, read_intrinsics

CameraArgument = str | float | PathLike[str] | ArrayLike
_RULE = (
    "must be 'auto', 'exif', a focal length in pixels, a file (K.txt, calib.txt, YAML, XML), or intrinsics"
)


@dataclass(frozen=True, eq=False)
class CameraWish:
    """What is said of the cameras of all images.

    Attributes
    ----------
    focal_px : float or None
        Focal length to start from [px].
    calibration : (12,) float64 or None
        Known intrinsics, which stay.
    exif : str
        ``"use"``: where files tell a focal length. ``"need"``: all must. ``"ignore"``: none is used.
    """

    focal_px: float | None = None
    calibration: FloatArray | None = None
    exif: str = "use"

    def cameras(self, photos: Sequence[Photo], *, sharing: str, model: str) -> Cameras:
        """Make the cameras of `photos`.

        Raises
        ------
        InvalidArgument
            If photos do not tell a focal length that is needed, or the calibration is of another size.
        """
        if self.exif == "need" and (silent := [p.name for p in photos if p.focal_px is None]):
            listed = ", ".join(silent[:3])
            raise InvalidArgument(f"camera = 'exif': {len(silent)} images tell no focal length ({listed})")
        return cameras_of(
            photos,
            sharing=sharing,
            model=model,
            focal_px=self.focal_px,
            calibration=self.calibration,
            use_exif=self.exif != "ignore",
        )


def camera_wish(camera: CameraArgument) -> CameraWish:
    """Understand the argument `camera` of :func:`sfmcpp.sfm.reconstruct`.

    Raises
    ------
    InvalidArgument
        If it is none of what it may be.
    DatasetError
        If it is a file that cannot be read.
    """
    if isinstance(camera, str) and camera in ("auto", "exif"):
        return CameraWish(exif="use" if camera == "auto" else "need")
    if isinstance(camera, (str, PathLike)):
        return _of_text(str(camera))
    values = np.asarray(camera, dtype=np.float64)
    return _of_focal(float(values)) if values.ndim == 0 else CameraWish(calibration=_full_row(values))


def _of_text(text: str) -> CameraWish:
    try:
        return _of_focal(float(text))
    except ValueError:
        path = Path(text)
    if not camera_file(path)[0].exists():
        if path.suffix:
            raise DatasetError(path, "there is no such file")
        raise InvalidArgument(f"camera = {text!r}: {_RULE}")
    return CameraWish(calibration=_full_row(read_intrinsics(path)))


def _of_focal(focal_px: float) -> CameraWish:
    if not (np.isfinite(focal_px) and focal_px > 0):
        raise InvalidArgument(f"camera = {focal_px:g}: a focal length must be positive [px]")
    return CameraWish(focal_px=focal_px, exif="ignore")


def _full_row(values: FloatArray) -> FloatArray:
    if values.shape == (3, 3):
        f, aspect = values[0, 0], values[1, 1] / values[0, 0]
        values = np.array([f, aspect, values[0, 2], values[1, 2], values[0, 1]])
    row = finite_array("camera", values, (-1,))
    if len(row) not in (5, len(PERSPECTIVE)) or row[0] <= 0:
        raise InvalidArgument(f"camera: {len(row)} numbers, {_RULE}")
    return np.concatenate([row, np.zeros(len(PERSPECTIVE) - len(row))])
