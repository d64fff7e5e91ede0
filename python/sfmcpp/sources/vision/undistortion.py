"""Photos as cameras without distortion would have taken them, and the model of these cameras.

Dense reconstruction and Gaussian splatting mostly know no lens.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry.pinhole import to_normalised, to_pixels
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.camera_models import require_pinhole
from sfmcpp.model.metadata import Metadata
from sfmcpp.model.photos import Photo
from sfmcpp.model.threads import no_progress, results_in_order, thread_count
from sfmcpp.sources.io.api import write
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.colmap import FILE_NAMES
from sfmcpp.sources.io.files import failures_named
from sfmcpp.sources.io.intrinsics import as_perspective
from sfmcpp.sources.vision.images import load_cv2, one_opencv_thread
from sfmcpp.sources.vision.kept_metadata import encoded_with, kept_metadata
from sfmcpp.sources.vision.photo_pixels import with_8_bits
from sfmcpp.sources.vision.photos import open_photos, read_levels

IMAGES, MODEL = "images", "sparse/0"

_JPEG_QUALITY = 95
# Points of each side of a photo that are looked at for how far it reaches without distortion.
_BORDER_POINTS = 65
# An image without distortion is at most so many times as wide and high as the photo.
_MOST_LARGER = 2.0
# Rows of an image whose places are computed at once.
_BAND_ROWS = 128
# OpenCV counts source pixels in 16 bits.
_LONGEST_PX = 32766
# Of kinds that OpenCV does not write by their suffix.
_WRITTEN_AS = {".jfif": ".jpg"}
# Kinds of files that hold 16 bits a colour, and those that hold transparent parts.
_DEEP_KINDS = (".png", ".tif", ".tiff", ".ppm", ".pgm")
_TRANSPARENT_KINDS = (".png", ".tif", ".tiff", ".webp")

Levels = NDArray[np.uint8] | NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class UndistortedCameras:
    """Pinhole cameras that take the place of those of a model.

    Attributes
    ----------
    lenses : (G, 12) float64
        Intrinsics of the model ``"perspective"`` that photos were taken with.
    pinholes : (G, 5) float64
        ``(f, aspect, cx, cy, 0)`` of the images without distortion; the principal point is their centre.
    sizes : (G, 2) int64
        Width and height of these images [px].
    index : (C,) int64
        Row that each camera uses.
    """

    lenses: FloatArray
    pinholes: FloatArray
    sizes: NDArray[np.int64]
    index: NDArray[np.int64]


def undistorted_cameras(problem: Problem, photo_sizes: NDArray[np.int64]) -> UndistortedCameras:
    """Find pinhole cameras whose whole image the photos show, with their focal lengths.

    Parameters
    ----------
    problem : Problem
        With cameras of the model ``"calibrated"`` or ``"perspective"``; pixels count from the corner of the
        first one, as COLMAP's.
    photo_sizes : (C, 2) int
        Width and height of the photo of each camera [px].

    Returns
    -------
    UndistortedCameras
        Their images are the largest around the principal point without a blank pixel.

    Raises
    ------
    InvalidArgument
        If the cameras are of another model, or a principal point is outside its photo.
    """
    if require_pinhole(problem.camera_model) == "bal":
        rule = "must be 'calibrated' or 'perspective', with pixels that count from the corner of the photo"
        raise InvalidArgument(f"camera_model = 'bal': {rule}")
    cameras = np.column_stack([problem.intrinsics_index, photo_sizes])
    groups, index = np.unique(cameras, axis=0, return_inverse=True)
    lenses = as_perspective(problem)[0][groups[:, 0]]
    found = [_pinhole_of(lens, size) for lens, size in zip(lenses, groups[:, 1:], strict=True)]
    pinholes, sizes = np.stack([p for p, _ in found]), np.stack([s for _, s in found])
    return UndistortedCameras(lenses, pinholes, sizes, index.reshape(-1))


def _pinhole_of(lens: FloatArray, size: NDArray[np.int64]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Intrinsics and size of the largest image around the principal point that a photo covers."""
    reach = _reach(lens, size)
    if not (reach > 0).all():
        centre, photo = f"({lens[2]:.5g}, {lens[3]:.5g}) px", "×".join(map(str, size))
        raise InvalidArgument(f"intrinsics: principal point {centre}: must be inside the photo of {photo} px")
    whole = 2 * reach * lens[0] * [1.0, lens[1]]
    kept = np.clip(np.floor(whole + 1e-6), 1, _MOST_LARGER * size).astype(np.int64)
    return np.array([lens[0], lens[1], *(kept / 2), 0.0]), kept


def _reach(lens: FloatArray, size: NDArray[np.int64]) -> FloatArray:
    """How far to each side of the axis a photo shows everything, at depth one: across, and down."""
    along, (width, height) = np.linspace(0, 1, _BORDER_POINTS), size

    def border(x: FloatArray, y: FloatArray, axis: int) -> FloatArray:
        return to_normalised(np.stack(np.broadcast_arrays(x * width, y * height), axis=-1), lens)[:, axis]

    across = min(-border(0 * along, along, 0).max(), border(0 * along + 1, along, 0).min())
    down = min(-border(along, 0 * along, 1).max(), border(along, 0 * along + 1, 1).min())
    return np.array([across, down])


def undistorted_photo(
    pixels: Levels, lens: FloatArray, pinhole: FloatArray, size: NDArray[np.int64]
) -> Levels:
    """Resample a photo (cubic) as a pinhole camera at its place would have taken it.

    Parameters
    ----------
    pixels : (height, width, 3 or 4) uint8 or uint16
        The photo.
    lens : (12,) float64
        Its camera, of the model ``"perspective"``.
    pinhole : (5,) float64
        The camera of the result.
    size : (2,) int
        Width and height of the result [px].

    Returns
    -------
    (size[1], size[0], 3 or 4) uint8 or uint16
        The image.
    """
    cv2 = load_cv2()
    width, height = int(size[0]), int(size[1])
    made = np.empty((height, width, pixels.shape[2]), dtype=pixels.dtype)
    for top in range(0, height, _BAND_ROWS):
        rows = np.arange(top, min(top + _BAND_ROWS, height))
        centres = np.stack(np.meshgrid(np.arange(width) + 0.5, rows + 0.5), axis=-1)
        # OpenCV counts from the centre of the first pixel.
        places = (to_pixels(to_normalised(centres, pinhole), lens) - 0.5).astype(np.float32)
        cv2.remap(
            pixels,
            places,
            None,
            cv2.INTER_CUBIC,
            dst=made[rows[0] : rows[-1] + 1],
            borderMode=cv2.BORDER_REPLICATE,
        )
    return made


def undistorted_problem(problem: Problem, cameras: UndistortedCameras) -> Problem:
    """The same cameras, points and observations without distortion; pixels of one pixel of noise each."""
    of_view = cameras.index[problem.camera_index]
    rays = to_normalised(problem.pixels, cameras.lenses[of_view])
    given, known = problem.metadata, ("colmap_image_ids", "colmap_point_ids")
    metadata = Metadata(
        image_names=given.names(problem.num_cameras),
        image_sizes=cameras.sizes[cameras.index],
        point_colors=given.point_colors,
        extra={key: given.extra[key] for key in known if key in given.extra},
    )
    return Problem(
        "calibrated",
        problem.cameras,
        cameras.pinholes,
        problem.points,
        problem.camera_index,
        problem.point_index,
        to_pixels(rays, cameras.pinholes[of_view]),
        intrinsics_index=cameras.index.astype(np.int32),
        metadata=metadata,
    )


@checked()
def undistort_photos(
    problem: Problem,
    photos: str | PathLike[str],
    folder: str | PathLike[str],
    *,
    threads: int | None = None,
    progress: Callable[[str, int, int], bool] = no_progress,
) -> Problem:
    """Write the photos of a model without distortion, and the model of these images.

    Parameters
    ----------
    problem : Problem
        A model with names of photos, such as :func:`sfmcpp.read` gives of a COLMAP folder; see
        :func:`undistorted_cameras`.
    photos : path-like
        Folder of the photos.
    folder : path-like
        Gets ``images/``, with the names of the photos, their bits (8 or 16), transparent parts, colour
        profiles and EXIF (JPEG, and 8 bits of PNG and WebP; no orientation, thumbnail or maker's notes), and
        ``sparse/0``, a binary COLMAP model with PINHOLE cameras: the layout that programs for Gaussian
        splatting read. The model comes last: as long as there is none, images may be missing.
    threads : int, optional
        Default: as many as the process may use.
    progress : callable, optional
        Called as ``progress("photos", done, total)``; returning True stops.

    Returns
    -------
    Problem
        The model that was written: pinhole cameras whose principal point is the centre of the image.

    Raises
    ------
    DatasetError
        If a photo of the model is missing, cannot be decoded or has another size, or a file cannot be
        written.
    InvalidArgument
        If the model has no names of photos, two cameras have the same one, its lenses are not pinholes with a
        distortion (:func:`undistorted_cameras`), or the images would replace the photos.
    """
    chosen = _photos_of(problem, Path(photos))
    cameras = undistorted_cameras(problem, np.array([photo.size for photo in chosen]).reshape(-1, 2))
    target = Path(folder)
    if (target / IMAGES).resolve() == Path(photos).resolve():
        raise InvalidArgument(f"folder = {str(folder)!r}: has the photos in {IMAGES}: must be another one")

    def written(number: int) -> None:
        row, photo = cameras.index[number], chosen[number]
        image = undistorted_photo(
            read_levels(photo), cameras.lenses[row], cameras.pinholes[row], cameras.sizes[row]
        )
        width, height = cameras.sizes[row].tolist()
        _write_image(image, target / IMAGES / photo.name, kept_metadata(photo, (width, height)))

    model = target / MODEL
    with failures_named(model):
        for name in FILE_NAMES:  # of an earlier run, whose images are replaced
            (model / name).unlink(missing_ok=True)
    with one_opencv_thread():
        numbers = range(len(chosen))
        results_in_order(written, numbers, thread_count(threads), stage="photos", progress=progress)
    result = undistorted_problem(problem, cameras)
    with failures_named(model):
        model.mkdir(parents=True, exist_ok=True)
    write(result, model, format="colmap-binary")
    return result


def _photos_of(problem: Problem, folder: Path) -> list[Photo]:
    """The photo of each camera, of the size that the model says."""
    names, sizes = problem.metadata.image_names, problem.metadata.image_sizes
    if len(names) != problem.num_cameras:
        counts = f"{len(names)} names of photos for {problem.num_cameras} cameras"
        raise InvalidArgument(f"problem: {counts}: must be one for each (metadata.image_names)")
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InvalidArgument(f"problem: two cameras have the photo {twice!r}: must be one each")
    there = {photo.name: photo for photo in open_photos(folder).photos}
    missing = [name for name in names if name not in there]
    if missing:
        share = f"{len(missing)} of {len(names)} photos of the model"
        raise DatasetError(folder, f"{share} are missing, the first is {missing[0]!r}")
    chosen = [there[name] for name in names]
    for number, photo in enumerate(chosen):
        if sizes is not None and tuple(sizes[number]) != photo.size:
            now, then = ("×".join(map(str, size)) for size in (photo.size, sizes[number]))
            raise DatasetError(folder / photo.name, f"has {now} pixels, in the model {then}")
        if max(photo.size) > _LONGEST_PX:
            raise DatasetError(folder / photo.name, f"{max(photo.size)} px: must be at most {_LONGEST_PX} px")
    return chosen


def _as_written(image: Levels, suffix: str) -> NDArray[Any]:
    """Grey levels, or red, green, blue and opacity, as far as a kind of file has room for them."""
    cv2 = load_cv2()
    levels: Levels = image if suffix in _DEEP_KINDS else with_8_bits(image)
    if suffix == ".pgm":
        return np.asarray(cv2.cvtColor(levels[:, :, :3], cv2.COLOR_RGB2GRAY), dtype=levels.dtype)
    return np.ascontiguousarray(levels[:, :, : 4 if suffix in _TRANSPARENT_KINDS else 3])


def _encoded(shown: NDArray[Any], path: Path) -> bytes:
    """Content of a file by OpenCV, whose colours are blue, green and red."""
    cv2, suffix = load_cv2(), path.suffix.lower()
    if shown.ndim == 3:
        shown = np.ascontiguousarray(shown[:, :, [2, 1, 0, 3][: shown.shape[2]]])
    options = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    is_made, data = cv2.imencode(_WRITTEN_AS.get(suffix, suffix), shown, options)
    if not is_made:
        raise DatasetError(path, f"OpenCV cannot write {suffix} files")
    return bytes(data)


def _write_image(image: Levels, path: Path, metadata: dict[str, bytes]) -> None:
    suffix = path.suffix.lower()
    shown, data = _as_written(image, suffix), None
    if shown.dtype == np.uint8:
        data = encoded_with(metadata, shown, suffix, _JPEG_QUALITY)
    with failures_named(path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_files(path, durable=False) as (file,):
        file.write(_encoded(shown, path) if data is None else data)
