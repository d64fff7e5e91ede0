"""Rendered photos of textured scenes with known cameras."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import (
    looked_up,
    require_count,
    require_not_negative,
    require_positive,
    require_seed,
)
from sfmcpp.sensors import geodetic_of
from sfmcpp.sources.synthetic.image_geometry import NO_DISTORTION, Distortion, ImageGeometry
from sfmcpp.sources.synthetic.photos.photo_files import ExifContent, write_photo
from sfmcpp.sources.synthetic.photos.rendering import Eye
from sfmcpp.sources.synthetic.photos.scenes import PLACES, Place

__all__ = ["PLACES", "WORLD_ORIGIN", "render_photos"]

WORLD_ORIGIN = np.array([50.0, 8.0, 120.0])
"""Latitude, longitude [deg, WGS84] and height [m] of the origin of all places, x to the east, z up."""

# Focal length over the width of an image, if none is given.
_FOCAL = 0.9


def render_photos(
    name: str,
    folder: str | PathLike[str],
    *,
    num_images: int = 24,
    image_size: tuple[int, int] = (480, 360),
    focal_px: float | None = None,
    distortion: Distortion = NO_DISTORTION,
    noise: float = 2.0,
    exif_focal: bool = False,
    gps_sigma_m: float | None = None,
    gps_outliers: int = 0,
    gps_outlier_m: float = 20.0,
    suffix: str = ".jpg",
    seed: int = 0,
) -> Problem:
    """Take photos of a place and write them into a folder.

    Parameters
    ----------
    name : str
        One of `PLACES`.
    folder : path-like
        Where to; made if missing. The files are ``0000.jpg``, ``0001.jpg`` …
    num_images : int
        Number of photos.
    image_size : (int, int)
        Width and height [px].
    focal_px : float, optional
        Focal length [px]. Default: 0.9 times the width.
    distortion : (float, float)
        Radial distortion k1, k2.
    noise : float
        Standard deviation of the noise of each grey level, of 256.
    exif_focal : bool
        Whether the files tell the focal length.
    gps_sigma_m : float, optional
        Standard deviation of each coordinate of the positions that the files tell [m]; None: they tell none.
    gps_outliers : int
        How many of these positions are wrong …
    gps_outlier_m : float
        … by so much, in a direction of its own each [m].
    suffix : str
        ``".jpg"`` or ``".png"``.
    seed : int
        Same seed, same photos.

    Returns
    -------
    Problem
        The truth: cameras and intrinsics (``"perspective"``), names and sizes of the images; no points. In
        ``metadata.extra``, ``"gps"`` (C, 3) holds the positions that the files tell, as metres east, north
        and up of `WORLD_ORIGIN`, and ``"gps_outliers"`` the names of the photos whose position is wrong.

    Raises
    ------
    InvalidArgument
        If an argument breaks a rule.
    DatasetError
        If a file cannot be written.
    ModuleNotFoundError
        If Pillow is not installed (extra ``vision``).
    """
    make = looked_up("name", name, PLACES)
    require_count("num_images", num_images)
    require_seed(seed)
    require_not_negative("noise", noise)
    if gps_sigma_m is None and gps_outliers:
        raise InvalidArgument(
            f"gps_outliers = {gps_outliers}: gps_sigma_m must be given, else files tell no position"
        )
    if suffix not in (".jpg", ".png"):
        raise InvalidArgument(f"suffix = {suffix!r}: must be .jpg or .png")
    focal = _FOCAL * image_size[0] if focal_px is None else focal_px
    geometry = ImageGeometry("perspective", focal, image_size, distortion)
    rng = np.random.default_rng(seed)
    place = make(num_images, rng)
    truth = _truth(place, geometry, [f"{k:04d}{suffix}" for k in range(num_images)])
    positions: list[tuple[float, float, float] | None] = [None] * num_images
    if gps_sigma_m is not None:
        gps_metres = _positions(truth, gps_sigma_m, gps_outliers, gps_outlier_m, rng)
        positions = [(float(a), float(b), float(h)) for a, b, h in geodetic_of(gps_metres, WORLD_ORIGIN)]
    _write(
        place,
        geometry,
        Path(folder),
        truth.metadata.image_names,
        [ExifContent(focal if exif_focal else None, p) for p in positions],
        noise,
        rng,
    )
    return truth


def _truth(place: Place, geometry: ImageGeometry, names: list[str]) -> Problem:
    count = len(names)
    sizes = np.tile(np.array(geometry.image_size, dtype=np.int64), (count, 1))
    none = np.empty(0, dtype=np.int32)
    return Problem(
        "perspective",
        place.cameras,
        geometry.intrinsics(1),
        np.empty((0, 3)),
        none,
        none,
        np.empty((0, 2)),
        intrinsics_index=np.zeros(count, dtype=np.int32),
        metadata=Metadata("synthetic", image_names=names, image_sizes=sizes),
    )


def _positions(
    truth: Problem, sigma_m: float, num_wrong: int, wrong_by_m: float, rng: np.random.Generator
) -> FloatArray:
    """Positions (C, 3) with noise, some of them wrong; noted in the truth."""
    require_not_negative("gps_sigma_m", sigma_m)
    require_positive("gps_outlier_m", wrong_by_m)
    require_count("gps_outliers", num_wrong, 0)
    if num_wrong > truth.num_cameras:
        raise InvalidArgument(f"gps_outliers = {num_wrong}: there are {truth.num_cameras} photos")
    found: FloatArray = truth.cameras[:, :, 3] + rng.normal(0, sigma_m, (truth.num_cameras, 3))
    wrong = np.sort(rng.choice(truth.num_cameras, num_wrong, replace=False))
    directions = rng.standard_normal((num_wrong, 3))
    found[wrong] += wrong_by_m * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    truth.metadata.extra["gps"] = found
    truth.metadata.extra["gps_outliers"] = [truth.metadata.image_names[k] for k in wrong]
    return found


def _write(
    place: Place,
    geometry: ImageGeometry,
    folder: Path,
    names: list[str],
    exif: list[ExifContent],
    noise: float,
    rng: np.random.Generator,
) -> None:
    eye, picture = Eye(geometry), None
    for number, name in enumerate(names):
        if picture is None or not place.same_photo:
            exact = eye.picture(place.faces, place.cameras[number])
            noisy = exact + noise * rng.standard_normal(exact.shape, dtype=np.float32)
            picture = np.rint(noisy.clip(0, 255)).astype(np.uint8)
        write_photo(folder / name, picture, exif[number])
