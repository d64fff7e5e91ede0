"""Positions of images in a local metric frame, from EXIF blocks or tables, and the argument `gps`."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike, fspath
from pathlib import Path, PurePath, PureWindowsPath
from unicodedata import normalize

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.photos import Photo
from sfmcpp.sensors.gps import LEAST_POSITIONS, east_north_up, middle_of, require_metres
from sfmcpp.sfm.photo_numbers import match_photo_numbers
from sfmcpp.sources.io.named_positions import NamedPositions
from sfmcpp.sources.io.position_columns import Triple
from sfmcpp.sources.io.position_csv import read_position_csv
from sfmcpp.sources.vision.photos import open_photos

# Origins of metric frames are whole multiples of this: what lies nearer to zero stays as it is [m].
_GRID_M = 1000.0
# A position at zero is none where the others are farther from there than any flight goes [m].
_FAR_M = 100e3
# Positions lie on a line where their second spread is below this part of their first.
_LINE = 0.01
GPS_WORDS = ("auto", "exif", "none")


@dataclass(frozen=True, eq=False)
class Positions:
    """Positions of images in a metric frame.

    Attributes
    ----------
    metres : (I, 3) float64
        East, north, up of the origin, or along the axes of the user's frame [m]; not a number where unknown.
    origin : (3,) float64
        Latitude, longitude [deg, WGS84] and height [m] of the origin, or its x, y, z in the user's frame [m].
    geodetic : bool
        Which of both.
    sigmas_m : (I, 3) float64 or None
        Standard deviations along the axes, as stated [m].
    no_fix : (I,) bool or None
        Which of the unknown ones a receiver without a fix has put at zero.
    unread : tuple of str
        Columns of their table that seem to be standard deviations, where none were read.
    """

    metres: FloatArray
    origin: FloatArray = field(default_factory=lambda: np.zeros(3))
    geodetic: bool = False
    sigmas_m: FloatArray | None = None
    no_fix: BoolArray | None = None
    unread: tuple[str, ...] = ()

    @property
    def known(self) -> BoolArray:
        """(I,) which images have a position."""
        return np.asarray(np.isfinite(self.metres[:, 0]))

    @property
    def stated_sigma_m(self) -> float | None:
        """The median stated standard deviation of a coordinate [m]; None if none is."""
        return None if self.sigmas_m is None else float(np.median(self.sigmas_m[self.known]))

    @property
    def member_weights(self) -> FloatArray:
        """(I, 3) weights of the coordinates beside one of the median standard deviation."""
        if self.sigmas_m is None or self.stated_sigma_m is None:
            return np.ones(self.metres.shape)
        return np.asarray((self.stated_sigma_m / self.sigmas_m) ** 2)

    def of(self, images: NDArray[np.intp] | BoolArray) -> Positions:
        """The positions of some of the images."""
        sigmas = None if self.sigmas_m is None else self.sigmas_m[images]
        no_fix = None if self.no_fix is None else self.no_fix[images]
        return replace(self, metres=self.metres[images], sigmas_m=sigmas, no_fix=no_fix)


def local_positions(rows: FloatArray, geodetic: bool, sigmas_m: FloatArray | None = None) -> Positions:
    """Take positions of images over into a metric frame whose origin is near them.

    Parameters
    ----------
    rows : (I, 3) float64
        Latitude, longitude [deg, WGS84] and height [m], or x, y, z [m]; not a number where unknown.
    geodetic : bool
        Which of both.
    sigmas_m : (I, 3) float64, optional
        Stated standard deviations; positive where positions are known.

    Returns
    -------
    Positions
        Geodetic ones in the tangent plane of their median, others from an origin on whole kilometres, as
        coordinates of millions of metres would cost digits. Positions at zero, far from the others, are
        unknown.

    Raises
    ------
    InvalidArgument
        If no position is known, a latitude is out of range, x and y look like degrees, or a standard
        deviation is not positive.
    """
    known = np.isfinite(rows).all(axis=1)
    if not known.any():
        raise InvalidArgument("gps: no position is known")
    if not geodetic:
        require_metres(rows[known])
    if sigmas_m is not None:
        wrong = known & ~((sigmas_m > 0) & np.isfinite(sigmas_m)).all(axis=1)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InvalidArgument(f"sigmas_m[{row}] = {sigmas_m[row]}: must be positive and finite")
    middle = middle_of(rows[known]) if geodetic else np.asarray(np.median(rows[known], axis=0))
    metres = np.full(rows.shape, np.nan)
    origin = middle if geodetic else np.trunc(middle / _GRID_M) * _GRID_M + 0.0  # no -0
    metres[known] = east_north_up(rows[known], origin) if geodetic else rows[known] - origin
    lost = ~rows[:, :2].any(axis=1) & (np.linalg.norm(metres, axis=1) > _FAR_M)
    metres[lost] = np.nan
    return Positions(metres, origin, geodetic, sigmas_m, lost)


def positions_of(names: list[str], known: NamedPositions) -> Positions:
    """Put positions of images in the order of the images.

    Parameters
    ----------
    names : list of I str
        Names of images.
    known : NamedPositions
        Positions by name, see :func:`match_names`, or number; those that are no image's are left alone.

    Returns
    -------
    Positions
        See :func:`local_positions`.

    Raises
    ------
    InvalidArgument
        If no name is an image's, one may be that of several, there must be as many as images and are not,
        or a latitude is out of range.
    """
    table_names = _names_in_table(names, known)
    stated = None if known.sigmas is None else _rows_by_image(table_names, known.sigmas)
    found = local_positions(_rows_by_image(table_names, known.positions), known.geodetic, stated)
    return replace(found, unread=known.unread)


def _names_in_table(names: list[str], known: NamedPositions) -> list[str | None]:
    """What the table calls each image; None for those that it has not."""
    if known.named_by in ("index", "order"):
        return _numbers_in_table(names, known)
    if known.named_by == "photo number":
        alike = match_photo_numbers(names, known.positions)
        _require_different(names, alike)
    else:
        alike = match_names(names, known.positions)
    if not alike:
        listed, wanted = (", ".join(list(some)[:3]) for some in (known.positions, names))
        raise InvalidArgument(f"gps: none of its names ({listed}) is the name of an image ({wanted})")
    return [alike.get(name) for name in names]


def _numbers_in_table(names: list[str], known: NamedPositions) -> list[str | None]:
    if known.named_by == "order" and len(names) != len(known.positions):
        raise InvalidArgument(
            f"gps: {len(known.positions):,} positions for {len(names):,} images: without names there must be "
            "one for each, in their order, as RTKLIB writes for the triggers of a camera (_events.pos)"
        )
    numbers = [str(number) for number in range(len(names))]
    if known.positions.keys().isdisjoint(numbers):
        listed = ", ".join(list(known.positions)[:3])
        raise InvalidArgument(
            f"gps: none of its numbers ({listed}) is below {len(names)}, that of the images"
        )
    return [number if number in known.positions else None for number in numbers]


def _rows_by_image(
    table_names: list[str | None], known: Mapping[str, tuple[float, float, float]]
) -> FloatArray:
    return np.array([(np.nan,) * 3 if name is None else known[name] for name in table_names]).reshape(-1, 3)


def match_names(images: Iterable[str], table: Iterable[str]) -> dict[str, str]:
    """Find for each image the name that a table has for it.

    It is the same; else it may have more or fewer folders in front, a suffix of another case or none, and
    letters with accents in another form of Unicode, if it is the only one like it.

    Parameters
    ----------
    images, table : iterable of str
        Names of images, and those in the table.

    Returns
    -------
    dict of str to str
        Names in the table by names of images, of those that have one.

    Raises
    ------
    InvalidArgument
        If a name may be that of several images, also of images that are called the same, or an image has
        several.
    """
    table, images = set(table), list(images)
    found = {name: name for name in images if name in table}
    left = defaultdict(list)
    for name in sorted(table - found.keys()):
        left[_name_parts(name)[-1]].append(name)
    users: dict[str, str] = {}
    for image in images:
        if image not in found:
            for name in _similar_names(image, left):
                _require_single(image, name, found, users)
                found[image], users[name] = name, image
    _require_different(images, found)
    return found


def _require_different(images: Sequence[str], found: Mapping[str, str]) -> None:
    """Raise InvalidArgument if several images have the same name, and a table has it, too."""
    twice = next((image for image, count in Counter(images).items() if count > 1 and image in found), None)
    if twice is not None:
        count = images.count(twice)
        raise InvalidArgument(f"gps: {count} images are called {twice!r}: their names must be different")


def _similar_names(image: str, table: dict[str, list[str]]) -> Iterator[str]:
    *folders, file = _name_parts(image)
    for called in dict.fromkeys((file, PurePath(file).stem)):
        parts = (*folders, called)
        for name in table.get(called, ()):
            others = _name_parts(name)
            shared = min(len(parts), len(others))
            if parts[-shared:] == others[-shared:]:
                yield name


def _require_single(image: str, name: str, found: dict[str, str], users: dict[str, str]) -> None:
    if image in found:
        raise InvalidArgument(
            f"gps: the positions of {found[image]} and of {name} may both be those of {image}"
        )
    if name in users:
        raise InvalidArgument(f"gps: the position of {name} may be that of {users[name]} or of {image}")


def _name_parts(name: str) -> tuple[str, ...]:
    """Folders and file, the suffix in lower case; names may be from Windows, or macOS with é in two parts."""
    name = normalize("NFC", name)
    *folders, file = PureWindowsPath(name).parts or (name,)
    path = PurePath(file)
    return (*folders, path.stem + path.suffix.lower())


def read_gps_argument(gps: str | PathLike[str]) -> NamedPositions | None:
    """Read the file that the argument `gps` of :func:`sfmcpp.sfm.reconstruct` names; None if it is a word.

    Raises
    ------
    DatasetError
        If the file cannot be read.
    """
    return None if fspath(gps) in GPS_WORDS else read_position_csv(gps)


def exif_positions_of_folder(folder: Path) -> NamedPositions:
    """Positions of the photos of a folder, from their EXIF blocks.

    Raises
    ------
    DatasetError
        If there is no photo, or none tells.
    InvalidArgument
        If Pillow is not installed.
    """
    try:
        photos = open_photos(folder).photos
    except ModuleNotFoundError as error:  # it says how to install what is missing
        raise InvalidArgument(str(error)) from None
    positions = _exif_positions(photos)
    if not positions:
        raise DatasetError(folder, "no photo tells its position")
    return NamedPositions(positions, geodetic=True, sigmas=_sigmas_of(photos, positions))


def _exif_positions(photos: Sequence[Photo]) -> dict[str, Triple]:
    """Positions of photos from EXIF, those with a height only."""
    positions = {photo.name: photo.position for photo in photos if photo.position is not None}
    return {name: position for name, position in positions.items() if math.isfinite(position[2])}


def _sigmas_of(photos: Sequence[Photo], placed: Mapping[str, Triple]) -> dict[str, Triple] | None:
    """Standard deviations of the positions of photos; None unless all have them."""
    known = {photo.name: photo.position_sigmas_m for photo in photos if photo.name in placed}
    stated = {name: sigmas for name, sigmas in known.items() if sigmas is not None}
    return stated if len(stated) == len(placed) else None


def choose_positions(
    gps: str | PathLike[str], known: NamedPositions | None, photos: Sequence[Photo]
) -> Positions | None:
    """Positions of images, or None where none are to be used.

    Parameters
    ----------
    gps : str or path-like
        ``"none"``; ``"exif"``: those that the files tell; ``"auto"``: the same, if enough files do; or the
        file that `known` was read from.
    known : NamedPositions or None
        What the file holds.
    photos : sequence of Photo
        The images.

    Returns
    -------
    Positions or None

    Raises
    ------
    InvalidArgument
        If positions are asked for, and there are too few or they lie on a line.
    """
    names = [photo.name for photo in photos]
    if known is not None:
        return _enough_positions(positions_of(names, known))
    from_exif = _exif_positions(photos)
    if gps == "none" or (gps == "auto" and len(from_exif) < LEAST_POSITIONS):
        return None
    if not from_exif:
        raise InvalidArgument("gps = 'exif': no image tells its position with its height")
    stated = NamedPositions(from_exif, geodetic=True, sigmas=_sigmas_of(photos, from_exif))
    found = positions_of(names, stated)
    return found if gps == "auto" else _enough_positions(found)


def _enough_positions(positions: Positions) -> Positions:
    """The positions; InvalidArgument, before hours of work, where no model could be brought to them."""
    count = np.count_nonzero(positions.known)
    if count < LEAST_POSITIONS:
        raise InvalidArgument(f"gps: {count} images have a position, {LEAST_POSITIONS} are needed")
    require_no_line(positions.metres[positions.known], [])
    return positions


def require_enough_of_model(metres: FloatArray) -> None:
    """Raise InvalidArgument if positions (n, 3) of the images of a model are too few."""
    if len(metres) < LEAST_POSITIONS:
        raise InvalidArgument(
            f"gps: {len(metres)} images of the model have a position, {LEAST_POSITIONS} are needed"
        )


def is_on_a_line(metres: FloatArray) -> bool:
    """Whether positions (n, 3) leave a model free to turn about a line."""
    spread = np.linalg.svd(metres - np.median(metres, axis=0), compute_uv=False)
    return bool(spread[1] <= _LINE * spread[0])


def require_no_line(metres: FloatArray, wrong: list[str]) -> None:
    """Raise InvalidArgument if positions (n, 3) lie on a line, but for those of the images named."""
    but = f" but for those that disagree ({', '.join(wrong[:3])})" if wrong else ""
    if not np.ptp(metres, axis=0).any():
        raise InvalidArgument(
            f"gps: the positions{but} are all the same, which tells neither scale nor direction: each image "
            "needs its own"
        )
    if is_on_a_line(metres):
        raise InvalidArgument(
            f"gps: the positions{but} lie on a line, which leaves the model free to turn round it: positions "
            "or control points (--gcp) off the line hold it"
        )


def unused_positions(gps: str | PathLike[str], photos: Sequence[Photo]) -> list[str]:
    """Warn of positions that the files tell, where they are too few to be used and were not refused."""
    count = len(_exif_positions(photos))
    without = sum(photo.position is not None for photo in photos) - count
    if gps != "auto" or count >= LEAST_POSITIONS or not count + without:
        return []
    height = f" with a height, {without} without" if without else ""
    return [
        f"positions that the files tell are not used: {count} photos have one{height}, {LEAST_POSITIONS} are "
        "needed; the model is not in metres"
    ]
