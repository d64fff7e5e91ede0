"""Which positions of images a user wants to have used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from os import PathLike, fspath
from pathlib import Path

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.photos import Photo
from sfmcpp.sensors.gps import LEAST_POSITIONS
from sfmcpp.sfm.positions import Positions, positions_of
from sfmcpp.sources.io.position_csv import NamedPositions, Triple, read_position_csv
from sfmcpp.sources.vision.photos import open_photos

WORDS = ("auto", "exif", "none")


def known_positions(gps: str | PathLike[str]) -> NamedPositions | None:
    """Read the file that the argument `gps` of :func:`sfmcpp.sfm.reconstruct` names; None if it is a word.

    Raises
    ------
    DatasetError
        If the file cannot be read.
    """
    return None if fspath(gps) in WORDS else read_position_csv(gps)


def positions_of_photos(folder: Path) -> NamedPositions:
    """What the EXIF blocks of the photos in a folder tell of where they were taken.

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
    told = _told_by(photos)
    if not told:
        raise DatasetError(folder, "no photo tells its position")
    return NamedPositions(told, geodetic=True)


def _told_by(photos: Sequence[Photo]) -> dict[str, Triple]:
    """Positions with their heights: without one a photo is anywhere on a plumb line."""
    told = {photo.name: photo.position for photo in photos if photo.position is not None}
    return {name: position for name, position in told.items() if math.isfinite(position[2])}


def positions_wanted(
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
        If positions are asked for and there are none.
    """
    names = [photo.name for photo in photos]
    if known is not None:
        return positions_of(names, known.positions, geodetic=known.geodetic, sigmas=known.sigmas)
    told = _told_by(photos)
    if gps == "none" or (gps == "auto" and len(told) < LEAST_POSITIONS):
        return None
    if not told:
        raise InvalidArgument("gps = 'exif': no image tells its position with its height")
    return positions_of(names, told, geodetic=True)
