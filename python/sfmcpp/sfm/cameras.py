"""Cameras of a set of photos: known and free intrinsics, sharing, and the argument `camera`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray, finite_array
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.model.checks import looked_up
from sfmcpp.model.photos import Photo
from sfmcpp.sources.cameras import camera_file, read_camera
from sfmcpp.sources.io.colmap.camera_models import MODELS
from sfmcpp.sources.io.files import failures_named, is_present
from sfmcpp.sources.io.intrinsics import matrix_fault, pinhole_of_matrix

if TYPE_CHECKING:
    from sfmcpp.sources.io.colmap.database import DatabaseCamera

# Intrinsics that a reconstruction estimates at first, by the name that COLMAP gives the model. The principal
# point stays at the centre of the image until a model of all photos tells it (camera_choice.py).
FREE_INTRINSICS: dict[str, tuple[str, ...]] = {
    "simple-pinhole": ("f",),
    "pinhole": ("f", "aspect"),
    "simple-radial": ("f", "k1"),
    "radial": ("f", "k1", "k2"),
    "opencv": ("f", "aspect", "k1", "k2", "p1", "p2"),
    "fixed": (),
}
SHARING = ("auto", "one", "folder", "each")
# A first guess: the field of view of a usual lens.
USUAL_FOCAL = 1.2
# Focal lengths of lenses, from the widest to the longest, as parts of the longer side of an image.
_SHORTEST, _LONGEST = 0.1, 100.0
CameraArgument = str | float | PathLike[str] | ArrayLike
_RULE = (
    "must be 'auto', 'exif', a focal length in pixels, a file (K.txt, calib.txt, YAML, XML), or intrinsics"
)


@dataclass(frozen=True, eq=False)
class Cameras:
    """Cameras of images.

    Attributes
    ----------
    intrinsics : (G, 12) float64
        First values, in the order of the perspective model.
    fixed : (G, 12) bool
        Which of them stay.
    of_image : (I,) int32
        Camera of each image.
    sizes : (G, 2) int64
        Width and height of the images of each [px]; 0 where unknown.
    guessed : (G,) bool
        Whether the focal length is a guess that may be far off.
    names : list of str
        COLMAP's name of the model of each.
    model_is_open : bool
        Whether more intrinsics may be freed where the images show that they are needed.
    ids : (G,) int64 or None
        Identifiers in the database that they are from.
    """

    intrinsics: FloatArray
    fixed: BoolArray
    of_image: IndexArray
    sizes: NDArray[np.int64]
    guessed: BoolArray
    names: list[str]
    model_is_open: bool = False
    ids: NDArray[np.int64] | None = None


def shared_by(photos: Sequence[Photo], sharing: str) -> IndexArray:
    """Numbers of the cameras that photos share.

    Parameters
    ----------
    photos : sequence of Photo
        The images.
    sharing : str
        ``"each"``: none do. ``"one"``: all do. ``"folder"``: those of one folder. ``"auto"``: those of one
        size whose files tell the same camera and focal length, or tell no focal length. Never do photos of
        different sizes.

    Returns
    -------
    (I,) int32
        Camera of each photo, numbered in the order of their first photos.

    Raises
    ------
    InvalidArgument
        If `sharing` is none of these, or photos of different sizes are to share one camera.
    """
    looked_up("shared_camera", sharing, dict.fromkeys(SHARING))
    if sharing == "one" and len({photo.size for photo in photos}) > 1:
        sizes = sorted({photo.size for photo in photos})
        listed = ", ".join(f"{width}×{height}" for width, height in sizes[:4])
        raise InvalidArgument(f"shared_camera = 'one': the images have {len(sizes)} sizes ({listed})")
    keys: dict[object, int] = {}
    return np.array(
        [keys.setdefault(_sharing_key(i, p, sharing), len(keys)) for i, p in enumerate(photos)],
        dtype=np.int32,
    )


def _sharing_key(number: int, photo: Photo, sharing: str) -> object:
    folder = str(PurePosixPath(photo.name).parent)
    names = {"each": number, "one": "", "folder": folder, "auto": photo.camera}
    return names[sharing], photo.size


def cameras_of(
    photos: Sequence[Photo],
    *,
    sharing: str = "auto",
    model: str = "auto",
    focal_px: float | None = None,
    calibration: FloatArray | None = None,
    use_exif: bool = True,
) -> Cameras:
    """Make the cameras of a set of photos.

    Parameters
    ----------
    photos : sequence of Photo
        The images.
    sharing : str
        See :func:`shared_by`.
    model : str
        What is estimated: a key of `FREE_INTRINSICS`; ``"auto"``: ``"simple-radial"``, and more where the
        images show that it is needed. Nothing is where a calibration is given, or with ``"fixed"``, which
        wants a focal length.
    focal_px : float, optional
        Focal length of all, a good first value [px], or the value that stays.
    calibration : (12,) float64, optional
        Known intrinsics of all, which stay.
    use_exif : bool
        Whether focal lengths that the files tell are used.

    Returns
    -------
    Cameras

    Raises
    ------
    InvalidArgument
        If a name is unknown, a number out of its range, or a calibration is of another image size.
    """
    start = "simple-radial" if model == "auto" else model
    free = looked_up("camera_model", start, FREE_INTRINSICS)
    of_image = shared_by(photos, sharing)
    count = int(of_image.max(initial=-1)) + 1
    members = [
        [photo for photo, camera in zip(photos, of_image, strict=True) if camera == g] for g in range(count)
    ]
    sizes = np.array([some[0].size for some in members], dtype=np.int64).reshape(-1, 2)
    focals = [_median_focal(some) if use_exif and focal_px is None else focal_px for some in members]
    given_focals = [focal_px] if calibration is None else [calibration[0], calibration[0] * calibration[1]]
    for width, height in sizes.tolist():
        for given in given_focals:
            _require_usual(given, max(width, height))
        if calibration is not None:
            _require_inside(calibration, width, height)
    if calibration is not None:
        rows = np.tile(calibration, (count, 1))
        known = np.ones((count, len(PERSPECTIVE)), dtype=np.bool_)
        return Cameras(rows, known, of_image, sizes, np.zeros(count, dtype=np.bool_), [""] * count)
    rows = np.array([first_intrinsics(size, focal) for size, focal in zip(sizes, focals, strict=True)])
    fixed = np.tile([name not in free for name in PERSPECTIVE], (count, 1))
    guessed = np.array([focal is None for focal in focals], dtype=np.bool_)
    if not free and guessed.any():
        raise InvalidArgument("camera_model = 'fixed': wants a focal length, in camera or in the files")
    names = [start.upper().replace("-", "_") if free else ""] * count
    rows = rows.reshape(-1, len(PERSPECTIVE))
    return Cameras(rows, fixed, of_image, sizes, guessed, names, model == "auto")


def first_intrinsics(size: NDArray[np.int64], focal_px: float | None) -> FloatArray:
    """(12,) row of square pixels, the principal point at the centre, and a usual focal length if unknown."""
    row = np.zeros(len(PERSPECTIVE))
    width, height = (float(side) for side in size)
    row[:4] = focal_px or USUAL_FOCAL * max(width, height), 1.0, width / 2, height / 2
    return row


def _median_focal(photos: Sequence[Photo]) -> float | None:
    focals = [photo.focal_px for photo in photos if photo.focal_px is not None]
    return float(np.median(focals)) if focals else None


def _require_usual(focal_px: float | None, side: int) -> None:
    """Raise InvalidArgument if no lens has such a focal length before images of that size."""
    if focal_px is not None and side and not _SHORTEST * side <= focal_px <= _LONGEST * side:
        rule = f"must be from {_SHORTEST * side:g} to {_LONGEST * side:g} px for images of {side} px"
        raise InvalidArgument(f"camera: focal length {focal_px:g} px: {rule}")


def _require_inside(row: FloatArray, width: int, height: int) -> None:
    """Raise InvalidArgument if the principal point is far from the middle of an image of that size."""
    for name, at, side in (("cx", row[2], width), ("cy", row[3], height)):
        if side and not 0.25 * side < at < 0.75 * side:
            rule = "must be near the middle: is the calibration of images of another size?"
            raise InvalidArgument(f"camera: {name} = {at:g} px in images of {width}×{height}: {rule}")


def _require_size(photos: Sequence[Photo], size: tuple[int, int]) -> None:
    """Raise InvalidArgument at the first photo that a calibration for images of `size` cannot be of.

    Images that are known by their tracks may be larger than these reach.
    """
    for photo in photos:
        fits = photo.size == size if photo.path else np.less_equal(photo.size, size).all()
        if not fits:
            has, wanted = ("×".join(map(str, sides)) for sides in (photo.size, size))
            rule = f"is for images of {wanted} px, {photo.name} has {has}: scale one of them to the other"
            raise InvalidArgument(f"camera: the calibration {rule}")


@dataclass(frozen=True, eq=False)
class CameraInput:
    """The argument `camera` of a reconstruction: known intrinsics or focal length, use of EXIF.

    Attributes
    ----------
    focal_px : float or None
        Focal length to start from [px].
    calibration : (12,) float64 or None
        Known intrinsics, which stay.
    exif : str
        ``"use"``: where files tell a focal length. ``"need"``: all must. ``"ignore"``: none is used.
    source : Path or None
        File of the calibration.
    size : tuple of int or None
        Width and height [px] of the images that the calibration is for, if its file tells.
    """

    focal_px: float | None = None
    calibration: FloatArray | None = None
    exif: str = "use"
    source: Path | None = None
    size: tuple[int, int] | None = None

    def cameras(self, photos: Sequence[Photo], *, sharing: str, model: str) -> Cameras:
        """Make the cameras of `photos`.

        Raises
        ------
        InvalidArgument
            If photos do not tell a focal length that is needed, or the calibration is of another size.
        DatasetError
            If that of a file is.
        """
        if self.exif == "need" and (silent := [p.name for p in photos if p.focal_px is None]):
            listed = ", ".join(silent[:3])
            raise InvalidArgument(f"camera = 'exif': {len(silent)} images tell no focal length ({listed})")
        try:
            if self.size is not None:
                _require_size(photos, self.size)
            return cameras_of(
                photos,
                sharing=sharing,
                model=model,
                focal_px=self.focal_px,
                calibration=self.calibration,
                use_exif=self.exif != "ignore",
            )
        except InvalidArgument as error:
            reason = str(error).removeprefix("camera: ")
            if self.source is None or reason == str(error):
                raise
            raise DatasetError(self.source, reason) from None


def parse_camera_argument(camera: CameraArgument) -> CameraInput:
    """Understand the argument `camera` of :func:`sfmcpp.sfm.reconstruct`.

    Raises
    ------
    InvalidArgument
        If it is none of what it may be.
    DatasetError
        If it is a file that cannot be read.
    """
    if isinstance(camera, str) and camera in ("auto", "exif"):
        return CameraInput(exif="use" if camera == "auto" else "need")
    if isinstance(camera, (str, PathLike)):
        return _input_of_text(str(camera))
    values = np.asarray(camera, dtype=np.float64)
    return (
        _input_of_focal(float(values))
        if values.ndim == 0
        else CameraInput(calibration=_complete_intrinsics(values))
    )


def _input_of_text(text: str) -> CameraInput:
    try:
        return _input_of_focal(float(text))
    except ValueError:
        path = Path(text)
    with failures_named(path):
        is_there = is_present(camera_file(path)[0])
    if not is_there:
        if path.suffix:
            raise DatasetError(path, "there is no such file")
        raise InvalidArgument(f"camera = {text!r}: {_RULE}")
    found = read_camera(path)
    return CameraInput(calibration=_complete_intrinsics(found.from_corner()), source=path, size=found.size)


def _input_of_focal(focal_px: float) -> CameraInput:
    if not (np.isfinite(focal_px) and focal_px > 0):
        raise InvalidArgument(f"camera = {focal_px:g}: a focal length must be positive [px]")
    return CameraInput(focal_px=focal_px, exif="ignore")


def _complete_intrinsics(values: FloatArray) -> FloatArray:
    if values.shape == (3, 3):
        if (fault := matrix_fault(values)) is not None:
            raise InvalidArgument(f"camera: {fault}")
        values = pinhole_of_matrix(values)
    row = finite_array("camera", values, (-1,))
    if len(row) not in (5, len(PERSPECTIVE)):
        raise InvalidArgument(f"camera: {len(row)} numbers, {_RULE}")
    if row[:2].min() <= 0:
        raise InvalidArgument(f"camera = {row[:5].tolist()}: f and aspect must be positive")
    return np.concatenate([row, np.zeros(len(PERSPECTIVE) - len(row))])


def as_in_database(cameras: Cameras, known: Sequence[DatabaseCamera], *, keep_models: bool) -> Cameras:
    """Give cameras the identifiers of those of a COLMAP database, which can then go on with the model.

    Parameters
    ----------
    cameras : Cameras
        Made for images of the database.
    known : sequence of DatabaseCamera
        Camera of each image in the database.
    keep_models : bool
        Whether their parameters are estimated, and no others. The focal lengths stay those of `cameras`.

    Returns
    -------
    Cameras
        The same ones where images share cameras otherwise than in the database.
    """
    count = len(cameras.intrinsics)
    of_camera = {int(g): camera for g, camera in zip(cameras.of_image, known, strict=True)}
    shared = {(int(g), camera.id) for g, camera in zip(cameras.of_image, known, strict=True)}
    ids = [of_camera[g].id for g in range(count)]
    if len(shared) > count or len(set(ids)) < count:
        return cameras
    numbered = replace(cameras, ids=np.array(ids, dtype=np.int64))
    if not keep_models:
        return numbered
    models = [of_camera[g].model for g in range(count)]
    rows = np.array([of_camera[g].intrinsics for g in range(count)])
    rows[:, 0] = cameras.intrinsics[:, 0]
    fixed = np.array([[name not in MODELS[model].free for name in PERSPECTIVE] for model in models])
    return replace(numbered, intrinsics=rows, fixed=fixed, names=models, model_is_open=False)
