"""Tracks of uncalibrated images from any file that holds some; of models the observations alone are used."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.image_tracks import ImageTracks, image_tracks
from sfmcpp.sources.io import api, malaga_mat, npz, track_files, track_text
from sfmcpp.sources.io.files import COMPRESSED_SUFFIXES, failures_named, read_text_bytes

# Formats whose pixels are counted from the centre of the image.
_CENTRED = ("bal", "bundler")
_ARRAYS = ("camera_index", "point_index", "pixels")
_TABLE_SUFFIXES = (".txt", ".csv", ".tsv", ".tracks")


def read_image_tracks(path: str | PathLike[str]) -> ImageTracks:
    """Read tracks.

    Parameters
    ----------
    path : path-like
        ``….xy``: VGG's matrix, a row for each track, a pair ``x y`` for each image, ``-1 -1`` where it is not
        seen. ``.txt``, ``.csv``, ``.tsv``, ``.tracks``: lines ``image track x y``, see
        :func:`~sfmcpp.sources.io.track_text.read_track_table`, or tracks of a calibrated camera, or a BAL
        problem. ``.npz``: arrays ``camera_index``, ``point_index``, ``pixels`` and, optional, ``names``
        and ``image_sizes``; also a problem of this package. A folder with ``Image1.mat``, ``Image2.mat`` …
        as Malaga's, or of a COLMAP model. A file of Bundler or sba.

    Returns
    -------
    ImageTracks
        Images in the order of the file or of their numbers, tracks numbered without gaps.

    Raises
    ------
    DatasetError
        If the file is missing, unreadable, damaged, in no known format, or holds no observations; it names
        file, reason and, of a text, the line.
    """
    source = Path(path)
    with failures_named(source):
        if not source.exists():
            raise DatasetError(source, "no such file or directory")
        tracks = _reader(source)(source)
    if not len(tracks):
        raise DatasetError(source, "holds no observations of tracks")
    return tracks


def _reader(path: Path) -> Callable[[Path], ImageTracks]:
    name = path.name.lower()
    if name.endswith(COMPRESSED_SUFFIXES):
        name = name.rpartition(".")[0]
    if path.is_dir():
        return malaga_mat.read_malaga if malaga_mat.claims(path) else _read_problem
    if name.endswith(".xy"):
        return track_text.read_vgg
    if name.endswith(".npz"):
        return _read_npz
    if name.endswith(_TABLE_SUFFIXES):
        return _reader_of_text(path)
    return _read_problem


def _reader_of_text(path: Path) -> Callable[[Path], ImageTracks]:
    """What a table of numbers is, as its head tells: BAL's and sba's first line has not four numbers."""
    data = read_text_bytes(path)
    if track_files.has_title(data):
        return _read_camera_tracks
    return track_text.read_track_table if track_text.looks_like_table(data) else _read_problem


def _read_problem(path: Path) -> ImageTracks:
    return _of_problem(path, api.read(path))


def _of_problem(path: Path, problem: Problem) -> ImageTracks:
    metadata = problem.metadata
    names = metadata.image_names or [f"image_{number:06d}" for number in range(problem.num_cameras)]
    centred = metadata.source_format in _CENTRED
    sizes = metadata.image_sizes
    return _checked(path, problem.camera_index, problem.point_index, problem.pixels, names, sizes, centred)


def _read_npz(path: Path) -> ImageTracks:
    members = npz.read_members(path)
    if npz.METADATA in members:
        return _of_problem(path, npz.read_npz(path))
    missing = [name for name in _ARRAYS if name not in members]
    if missing:
        raise DatasetError(path, f"lacks the arrays {', '.join(missing)}: tracks are {', '.join(_ARRAYS)}")
    names = members.get("names")
    labels = None if names is None else [str(name) for name in names.ravel()]
    image, track, pixels = (members[name] for name in _ARRAYS)
    return _checked(path, image, track, pixels, labels, members.get("image_sizes"))


def _read_camera_tracks(path: Path) -> ImageTracks:
    tracks = track_files.read_tracks(path)
    names = [f"image_{number:06d}" for number in range(len(tracks.t_s))]
    return _checked(path, tracks.frame_index, tracks.track_index, tracks.pixels, names)


def _checked(
    path: Path,
    image_index: NDArray[Any],
    track_index: NDArray[Any],
    pixels: NDArray[Any],
    names: list[str] | None = None,
    sizes: NDArray[Any] | None = None,
    centred: bool = False,
) -> ImageTracks:
    """The tracks, numbered without gaps."""
    try:
        found = image_tracks(image_index, track_index, pixels, names=names, sizes=sizes, centred=centred)
    except InvalidArgument as error:
        raise DatasetError(path, str(error)) from error
    track = np.unique(found.track_index, return_inverse=True)[1].astype(np.int32)
    return ImageTracks(found.names, found.sizes, found.centres, found.image_index, track, found.pixels)
