"""COLMAP's database: images, cameras, keypoints and matches, in SQLite."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.photos import Photo
from sfmcpp.sources.io.checks import LARGEST_COUNT, fault_of_image_name
from sfmcpp.sources.io.colmap.camera_models import (
    DIVISOR_RULE,
    MODELS,
    NAME_OF_NUMBER,
    has_divisor,
    intrinsics_from_params,
    unsupported,
)
from sfmcpp.sources.io.colmap.tables import LARGEST_ID
from sfmcpp.sources.io.files import failures_named, is_regular_file, require_present
from sfmcpp.sources.io.sqlite_tables import log_beside, read_only_uri, require_stored

_MAGIC = b"SQLite format 3\0"
_TABLES = ("cameras", "images", "keypoints", "matches")
_OPTIONAL_TABLES = ("two_view_geometries", "pose_priors", "rig_sensors")
# A pair of images is numbered `lower id · this + higher id`.
_PAIR_BASE = 2**31 - 1
_WATERMARK = 7
_LEAST_FOCAL_PX = 1.0
_CAMERA_SENSOR = 0
_UNDEFINED, _WGS84, _CARTESIAN = -1, 0, 1
_Triple = tuple[float, float, float]
# Columns of keypoints: x, y; then scale and angle, or the four numbers of an affine shape.
_SCALED, _AFFINE = 4, 6


@dataclass(frozen=True, eq=False)
class DatabaseCamera:
    """A camera of a database: identifier, COLMAP's name of its model, and (12,) perspective intrinsics."""

    id: int
    model: str
    intrinsics: FloatArray


@dataclass(frozen=True, eq=False)
class ColmapDatabase:
    """Contents of a database for I images, in the order of their names.

    Attributes
    ----------
    photos : list of Photo
        Names, sizes, cameras, and what is known from their files: focal length and position.
    image_ids : list of int
        Identifiers.
    cameras : list of DatabaseCamera
        Of each image; its focal length is a guess where that of the photo is None.
    keypoints : list of (n, 2) float64
        Places [px].
    scales : list of (n,) float64
        Sizes [px]; not a number where unknown.
    matches : dict of (m, 2) int32
        For each pair of numbers of images, which keypoints look alike: those that COLMAP has verified, or
        all where it has verified none.
    unused : list of str
        Sentences on what it holds and this has not.
    """

    photos: list[Photo]
    image_ids: list[int]
    cameras: list[DatabaseCamera]
    keypoints: list[FloatArray]
    scales: list[FloatArray]
    matches: dict[tuple[int, int], NDArray[np.int32]]
    unused: list[str]


def is_database(path: Path) -> bool:
    """Whether a file is one of SQLite."""
    if not is_regular_file(path):
        return False
    with failures_named(path), path.open("rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC


def read_database(path: str | PathLike[str]) -> ColmapDatabase:
    """Read a database of COLMAP, which is not changed.

    Raises
    ------
    DatasetError
        If the file is missing, damaged or no such database, or a camera model is not supported.
    """
    source = Path(path)
    with failures_named(source):
        require_present(source)
    if not is_database(source):
        raise DatasetError(source, "is no database of SQLite")
    try:
        with closing(sqlite3.connect(_uri(source.resolve()), uri=True)) as connection:
            return _Reader(source, connection).database()
    except (sqlite3.Error, OverflowError, UnicodeDecodeError) as error:  # as its parts fail in many ways
        raise DatasetError(source, f"is a damaged database: {error}") from error


def _uri(path: Path) -> str:
    """How to open a file so that nothing is made beside it, and a folder that is read-only will do.

    COLMAP's databases have a write-ahead log, for which every reader else needs a file to lock. Where a log
    or a journal has something that the file lacks, that is needed, too.
    """
    return read_only_uri(path, is_unchanged=log_beside(path) is None)


class _Reader:
    """Tables of one file; a number or an array that cannot be right is named."""

    def __init__(self, path: Path, connection: sqlite3.Connection) -> None:
        self._path, self._connection = path, connection
        # Views and virtual tables have no page of their own: they could run any query.
        found = connection.execute("SELECT name FROM sqlite_master WHERE type = 'table' AND rootpage > 0")
        self._tables = {name for (name,) in found}
        require_stored(connection, path, self._tables.intersection((*_TABLES, *_OPTIONAL_TABLES)))

    def database(self) -> ColmapDatabase:
        missing = [name for name in _TABLES if name not in self._tables]
        if missing:
            raise self._error(f"is no database of COLMAP: it lacks {', '.join(missing)}")
        photos, cameras, number_of = self._photos()
        keypoints, scales = self._keypoints(number_of)
        counts = [len(places) for places in keypoints]
        matches = dict(self._matches(number_of, counts))
        unused = [*self._unused(), *_unused_sigmas(photos)]
        return ColmapDatabase(photos, list(number_of), cameras, keypoints, scales, matches, unused)

    def _photos(self) -> tuple[list[Photo], list[DatabaseCamera], dict[int, int]]:
        """Images with what is known of their cameras, and their numbers by identifier."""
        cameras, positions = dict(self._cameras()), dict(self._positions())
        photos: list[Photo] = []
        used: list[DatabaseCamera] = []
        number_of: dict[int, int] = {}
        for image, name, camera in self._rows("SELECT image_id, name, camera_id FROM images ORDER BY name"):
            self._require_name(name)
            if camera not in cameras:
                raise self._error(f"images: {name!r}: camera {camera} is not in the list of cameras")
            self._require_id(f"images: {name!r}: id", image)
            if image in number_of:
                raise self._error(f"images: {name!r}: id {image} is used twice")
            size, found, known = cameras[camera]
            focal = float(found.intrinsics[0]) if known else None
            number_of[image] = len(photos)
            position, sigmas = positions.get(image, (None, None))
            photo = Photo(name, None, size, focal, str(camera), position, position_sigmas_m=sigmas)
            photos.append(photo)
            used.append(found)
        if not photos:
            raise self._error("holds no images")
        return photos, used, number_of

    def _cameras(self) -> Iterator[tuple[int, tuple[tuple[int, int], DatabaseCamera, bool]]]:
        """Size, camera, and whether the focal length is known, by identifier."""
        columns = "camera_id, model, width, height, params, prior_focal_length"
        for camera, model, width, height, params, known in self._rows(f"SELECT {columns} FROM cameras"):
            what = f"cameras: camera {camera}"
            self._require_id(what, camera)
            if NAME_OF_NUMBER.get(model) not in MODELS:
                raise self._error(f"{what}: {unsupported(model, MODELS)}")
            if not all(isinstance(side, int) and 0 < side <= LARGEST_COUNT for side in (width, height)):
                raise self._error(f"{what}: image size {width!r}x{height!r} is impossible")
            name = NAME_OF_NUMBER[model]
            numbers = self._array(what, params, 1, len(MODELS[name].params), np.float64)[0]
            focals = numbers[: 2 if MODELS[name].has_aspect else 1]
            if not (_are_plausible(numbers).all() and (focals >= _LEAST_FOCAL_PX).all()):
                raise self._error(f"{what}: parameters {numbers.tolist()} are impossible")
            if has_divisor(name, numbers.tolist()):
                raise self._error(f"{what}: {DIVISOR_RULE}")
            row = intrinsics_from_params([name], [numbers.tolist()])[0][0]
            yield camera, ((width, height), DatabaseCamera(camera, name, row), bool(known))

    def _positions(self) -> Iterator[tuple[int, tuple[_Triple, _Triple | None]]]:
        """Latitude, longitude [deg] and height [m], and standard deviations [m] if there are, by image."""
        for image, blob, covariance in self._priors(_WGS84):
            latitude, longitude, height = self._array("pose_priors", blob, 1, 3, np.float64)[0].tolist()
            if np.isfinite([latitude, longitude]).all():
                if not (abs(latitude) <= 90 and abs(longitude) <= 180):
                    place = f"latitude {latitude:g}°, longitude {longitude:g}°"
                    raise self._error(f"pose_priors: image {image}: {place}: out of range")
                yield image, ((latitude, longitude, height), self._sigmas(covariance))

    def _sigmas(self, covariance: object) -> _Triple | None:
        """Standard deviations east, north and up [m]; None where they are unknown or impossible."""
        if covariance is None:
            return None
        variances = self._array("pose_priors: covariance", covariance, 3, 3, np.float64).diagonal()
        if not (_are_plausible(variances) & (variances > 0)).all():
            return None
        east, north, up = np.sqrt(variances).tolist()
        return east, north, up

    def _priors(self, system: int) -> Iterator[tuple[Any, Any, Any]]:
        """Image, position and its covariance of each pose prior in a coordinate system."""
        if "pose_priors" not in self._tables:
            return
        known = self._columns("pose_priors")
        covariance = "position_covariance" if "position_covariance" in known else "NULL"
        image, which = "image_id", ""
        if "corr_data_id" in known:
            image, which = "corr_data_id", f"corr_sensor_type = {_CAMERA_SENSOR} AND"
        columns = f"{image}, position, {covariance}"
        yield from self._rows(f"SELECT {columns} FROM pose_priors WHERE {which} coordinate_system = {system}")

    def _unused(self) -> Iterator[str]:
        if "rig_sensors" in self._tables:
            (rigs,) = self._rows("SELECT COUNT(DISTINCT rig_id) FROM rig_sensors").fetchone()
            if rigs:
                yield (
                    f"rigs of several cameras in the database ({rigs}) are not used: every image has a pose "
                    "of its own, and COLMAP cannot continue the model with this database"
                )
        yield from self._unused_positions()
        if count := self._count_unverified():
            pairs = "1 pair" if count == 1 else f"{count} pairs"
            yield (
                f"matches of {pairs} of images in the database are not used, as only those of others are "
                "verified: verify all in COLMAP, or empty two_view_geometries"
            )
        if count := self._count_gravities():
            yield f"gravity priors in the database ({count}) are not used"

    def _unused_positions(self) -> Iterator[str]:
        remedy = "give them as a file of positions (name, x, y, z)"
        for system, name in ((_CARTESIAN, "Cartesian"), (_UNDEFINED, "undefined")):
            if count := sum(self._is_known(blob) for _, blob, _ in self._priors(system)):
                yield (
                    f"position priors in {name} coordinates in the database ({count}) are not used, only "
                    f"those in WGS84 are: {remedy}"
                )
        if count := self._count_old_positions():
            yield (
                f"positions in the table of images ({count}), where COLMAP before 3.10 has them, are not "
                f"used, as it does not tell their coordinates: {remedy} or (name, lat, lon, height)"
            )

    def _is_known(self, blob: object) -> bool:
        """Whether there is a vector in a cell of pose_priors; unknown ones are stored as not a number."""
        return blob is not None and bool(
            np.isfinite(self._array("pose_priors", blob, 1, 3, np.float64)).any()
        )

    def _count_gravities(self) -> int:
        """Measured directions of gravity; along an axis is what COLMAP takes every photo's for by EXIF."""
        has_gravity = "gravity" in self._columns("pose_priors")
        blobs = self._rows("SELECT gravity FROM pose_priors WHERE gravity IS NOT NULL") if has_gravity else ()
        found = [self._array("pose_priors: gravity", blob, 1, 3, np.float64) for (blob,) in blobs]
        return sum(bool(np.isfinite(v).all() and np.count_nonzero(v) > 1) for v in found)

    def _count_old_positions(self) -> int:
        """Images with a translation other than zero, which scripts store where none is known."""
        if "prior_tx" not in self._columns("images"):
            return 0
        (count,) = self._rows("SELECT COUNT(*) FROM images WHERE prior_tx != 0 OR prior_ty != 0").fetchone()
        return int(count)

    def _columns(self, table: str) -> set[str]:
        """Names of the columns of a table, none if there is no such table."""
        return {name for _, name, *_ in self._rows(f"PRAGMA table_info({table})") if table in self._tables}

    def _keypoints(self, number_of: dict[Any, int]) -> tuple[list[FloatArray], list[FloatArray]]:
        keypoints = [np.empty((0, 2)) for _ in number_of]
        scales = [np.empty(0) for _ in number_of]
        for image, rows, columns, blob in self._rows('SELECT image_id, rows, "cols", data FROM keypoints'):
            what = f"keypoints: image {image}"
            if image not in number_of:
                raise self._error(f"{what} is not in the list of images")
            if not isinstance(columns, int) or columns not in (2, _SCALED, _AFFINE):
                raise self._error(f"{what} has {columns!r} columns: must be 2, {_SCALED} or {_AFFINE}")
            table = self._array(what, blob, rows, columns, np.float32).astype(np.float64)
            if not (good := _are_plausible(table).all(axis=1)).all():
                worst = int(np.argmin(good))
                raise self._error(f"{what}: keypoint {worst} is impossible: {table[worst].tolist()}")
            keypoints[number_of[image]] = np.ascontiguousarray(table[:, :2])
            scales[number_of[image]] = _scales(table)
        return keypoints, scales

    def _matches(
        self, number_of: dict[Any, int], counts: list[int]
    ) -> Iterator[tuple[tuple[int, int], NDArray[np.int32]]]:
        every = "SELECT pair_id, rows, data FROM matches WHERE rows > 0"
        for pair, rows, blob in list(self._verified()) or self._rows(every):
            images = divmod(pair, _PAIR_BASE) if isinstance(pair, int) else (None, None)
            what = f"matches: pair {pair!r} of images {images}"
            if not all(image in number_of for image in images):
                raise self._error(f"{what}: they are not in the list of images")
            if images[0] == images[1]:
                raise self._error(f"{what}: an image is matched with itself")
            first, second = (number_of[image] for image in images)
            found = self._array(what, blob, rows, 2, np.uint32)
            if (found >= [counts[first], counts[second]]).any():
                raise self._error(f"{what}: a keypoint is not in the list of keypoints")
            yield (first, second), found.astype(np.int32)

    def _verified(self) -> Iterator[tuple[Any, ...]]:
        """Matches that agree with a geometry; those of a watermark agree, and tell nothing of the scene."""
        if "two_view_geometries" in self._tables:
            which = f"two_view_geometries WHERE rows > 0 AND config != {_WATERMARK}"
            yield from self._rows(f"SELECT pair_id, rows, data FROM {which}")

    def _count_unverified(self) -> int:
        """Pairs whose matches nobody has tried to verify, where those of others count as verified."""
        if next(self._verified(), None) is None:
            return 0
        tried = "SELECT pair_id FROM two_view_geometries"
        query = f"SELECT COUNT(*) FROM matches WHERE rows > 0 AND pair_id NOT IN ({tried})"
        return int(self._rows(query).fetchone()[0])

    def _require_name(self, name: object) -> None:
        """Raise a DatasetError for a name that no model could hold."""
        fault = "must be text" if not isinstance(name, str) else fault_of_image_name(name)
        if fault is not None:
            raise self._error(f"images: name {name!r}: {fault}")

    def _require_id(self, what: str, number: object) -> None:
        if not isinstance(number, int) or not 0 <= number <= LARGEST_ID:
            raise self._error(f"{what} = {number!r}: must be a whole number from 0 to {LARGEST_ID}")

    def _rows(self, query: str) -> sqlite3.Cursor:
        return self._connection.execute(query)

    def _array(
        self, what: str, blob: object, rows: object, columns: int, dtype: type[np.generic]
    ) -> NDArray[Any]:
        """The array (rows, columns) that a cell holds."""
        data = b"" if blob is None else blob
        size = np.dtype(dtype).itemsize * columns
        if not isinstance(data, bytes) or not isinstance(rows, int) or len(data) != rows * size:
            found = f"{len(data)} bytes" if isinstance(data, bytes) else type(data).__name__
            kind = f"{columns} {np.dtype(dtype).name}"
            raise self._error(f"{what}: has {found}, must have {rows!r} rows of {size} bytes ({kind})")
        return np.frombuffer(data, np.dtype(dtype).newbyteorder("<")).reshape(rows, columns)

    def _error(self, reason: str) -> DatasetError:
        return DatasetError(self._path, reason)


def _unused_sigmas(photos: list[Photo]) -> Iterator[str]:
    """Say that standard deviations of some positions cannot count beside positions without."""
    placed = [photo for photo in photos if photo.position is not None and np.isfinite(photo.position[2])]
    without = [photo.name for photo in placed if photo.position_sigmas_m is None]
    if 0 < len(without) < len(placed):
        yield (
            f"covariances of position priors in the database ({len(placed) - len(without)}) are not used, as "
            f"{len(without)} positions have none, or one without positive variances ({without[0]})"
        )


def _are_plausible(numbers: NDArray[Any]) -> BoolArray:
    return np.asarray(np.isfinite(numbers) & (np.abs(numbers) <= LARGEST_COUNT))


def _scales(table: FloatArray) -> FloatArray:
    """Sizes of keypoints of 2, 4 or 6 columns."""
    if table.shape[1] == _SCALED:
        return np.ascontiguousarray(table[:, 2])
    if table.shape[1] == _AFFINE:
        a, b, c, d = table[:, 2:].T
        return np.asarray(np.sqrt(np.abs(a * d - b * c)), dtype=np.float64)
    return np.full(len(table), np.nan)
