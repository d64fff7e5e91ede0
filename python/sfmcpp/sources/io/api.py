"""Reading and writing problems in any format; a new one is a module with a `Format` and a line here."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike, fsdecode
from pathlib import Path
from typing import cast

from sfmcpp.ba.parts import Part, joined_parts, part_for_rank
from sfmcpp.ba.ranks import Ranks
from sfmcpp.errors import DatasetError
from sfmcpp.model import CameraFunction, Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.camera_models import PINHOLE_MODELS
from sfmcpp.model.checks import looked_up
from sfmcpp.model.selection import remade
from sfmcpp.sources.io import (
    alicevision,
    bal,
    bundler,
    colmap,
    g2o,
    npz,
    nvm,
    openmvg,
    parts,
    ply,
    rrd,
    sba,
    strecha,
    transforms,
)
from sfmcpp.sources.io.checks import require_magnitudes, require_valid
from sfmcpp.sources.io.colmap.database import is_database
from sfmcpp.sources.io.colmap.fisheye import is_fisheye
from sfmcpp.sources.io.files import (
    COMPRESSED_SUFFIXES,
    failures_named,
    is_present,
    is_regular_file,
    require_present,
)
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.shares import Share, part_of_share

AnyPath = str | PathLike[str]

# The first that claims a name gets it: sba's …cams….txt before BAL's .txt, .json by contents before OpenMVG's
# name, which AliceVision had, folders last.
FORMATS: tuple[Format, ...] = (
    sba.FORMAT,
    bal.FORMAT,
    bundler.FORMAT,
    nvm.FORMAT,
    g2o.FORMAT,
    alicevision.FORMAT,
    openmvg.FORMAT,
    npz.FORMAT,
    parts.FORMAT,
    ply.FORMAT,
    rrd.FORMAT,
    transforms.FORMAT,
    strecha.FORMAT,
    colmap.TEXT,
    colmap.BINARY,
)
_FORMATS_OF_FISHEYES = (colmap.TEXT, colmap.BINARY, ply.FORMAT)


@checked()
def read(path: AnyPath, *, format: str | None = None) -> Problem:
    """Read a problem.

    Parameters
    ----------
    path : path-like
        File, or folder of a COLMAP model (binary if it has both). ``…cams….txt`` is sba's format, with
        ``…pts.txt`` and ``calib.txt`` beside it; ``.txt``, ``.txt.bz2``, ``.txt.gz``, ``.txt.xz`` are BAL;
        ``.out`` is Bundler, ``.nvm`` VisualSFM, ``.g2o`` g2o, ``.sfm`` AliceVision; ``.json`` is OpenMVG's
        sfm_data, AliceVision's, or transforms.json, decided by its contents; ``.npz`` is this package's own
        format, and so is a folder named ``parts`` or ``….parts``, with parts for several ranks. A folder of
        ``IMAGE.camera`` is the ground truth of Strecha's benchmark. That and transforms.json have cameras but
        no points.
    format : str, optional
        Name of the format, one of :func:`formats`, where the file's name does not tell.

    Returns
    -------
    Problem
        In the conventions of this package: world_from_camera, z forward, y down, pixels. Cameras have the
        order of the file; in a COLMAP model that of the image ids, as from pycolmap.

    Raises
    ------
    DatasetError
        If the file is missing, unreadable, damaged, or in no known format; it names file, line and reason.
    InvalidArgument
        If `format` is not the name of a format.
    """
    source = _checked_path(path)
    with failures_named(source):
        chosen = _format_of_existing(source, format)
        if chosen.reader is None:
            raise DatasetError(source, f"format {chosen.name} can be written but not read")
        problem = chosen.reader(source)
        require_magnitudes(problem, source)
        return problem


@checked()
def write(problem: Problem, path: AnyPath, *, format: str | None = None) -> None:
    """Write a problem; the file is written completely or not at all.

    Masks of cameras and points are stored by ``.npz`` and ``.g2o``, standard deviations and covariances by
    these and sba's format, rigs by ``.npz`` and COLMAP's formats; other formats store independent cameras.

    Parameters
    ----------
    problem : Problem
        The problem; not changed.
    path : path-like
        Output file or folder; the name determines the format as in :func:`read`. ``.ply`` is for viewers,
        ``.rrd`` for the rerun viewer, ``transforms.json`` for nerfstudio and Gaussian splatting; a name
        without suffix is the folder of a binary COLMAP model.
    format : str, optional
        Name of the format, where the file's name does not tell.

    Raises
    ------
    DatasetError
        If the problem does not fit the format, a value is not finite or out of range, or the file cannot
        be written.
    InvalidArgument
        If `format` is not the name of a format, or a field of the problem was replaced by an array of
        another shape or dtype.
    """
    target = _checked_path(path)
    problem = remade(problem)
    with failures_named(target):
        chosen = format_of(target) if format is None else named_format(format)
        if chosen.writer is None:
            raise DatasetError(target, f"format {chosen.name} can be read but not written")
        if target.suffix.lower() in COMPRESSED_SUFFIXES and not chosen.compresses:
            raise DatasetError(target, f"format {chosen.name} is not written compressed: use another suffix")
        fits = is_fisheye(problem) and chosen in _FORMATS_OF_FISHEYES
        if isinstance(problem.camera_model, CameraFunction) and not fits:
            held = "only COLMAP models hold" if is_fisheye(problem) else "no file holds"
            raise DatasetError(
                target, f"camera model {problem.camera_model.name!r} is a function, which {held}"
            )
        if not (fits or problem.camera_model in PINHOLE_MODELS or chosen.holds_every_model):
            held = ", ".join(PINHOLE_MODELS) if problem.is_metric else "metric"
            raise DatasetError(target, f"format {chosen.name} holds {held} cameras only: use .npz")
        chosen.writer(problem, target)


@checked()
def read_part(path: AnyPath, ranks: Ranks) -> Part:
    """Read a problem with other processes, each a part of it; each calls this.

    A folder of parts is read by parts. Of a plain BAL or stored NPZ file each rank reads a share, and none
    ever holds the whole. Other files, compressed and damaged ones are read by rank 0, which deals out parts.

    Parameters
    ----------
    path : path-like
        As of :func:`read`, seen by all.
    ranks : Ranks
        The processes.

    Returns
    -------
    Part
        That of this rank.

    Raises
    ------
    DatasetError
        As :func:`read`, on all ranks.
    """
    source = _checked_path(path)
    chosen = ranks.from_root(lambda: _format_of_existing(source).name)
    format = named_format(chosen)
    if format.part_reader is not None:
        reader = format.part_reader
        return ranks.agreed(lambda: reader(source, ranks))
    part = None if format.share_reader is None else _part_in_shares(source, format.share_reader, ranks)
    return part_for_rank(lambda: read(source), ranks) if part is None else part


def _part_in_shares(source: Path, reader: Callable[[Path, Ranks], Share | None], ranks: Ranks) -> Part | None:
    """None where the file is not like that, or a reader of the whole finds a fault and can name it."""
    try:
        share = ranks.agreed(lambda: reader(source, ranks))
        if not all(ranks.everyones(share is not None and share.is_in_range)):
            return None
        part = part_of_share(cast(Share, share), ranks)
        ranks.agreed(lambda: require_valid(part.problem, source))
    except MemoryError:
        raise
    except Exception:  # as read_members: parsers fail in many ways
        return None
    return part


@checked()
def write_part(part: Part, path: AnyPath, ranks: Ranks) -> None:
    """Write a problem of which each rank has a part; each calls this.

    Into a folder of parts each writes its own; any other file is written by rank 0, which gathers all.

    Parameters
    ----------
    part : Part
        That of this rank.
    path : path-like
        As of :func:`write`.
    ranks : Ranks
        The processes.

    Raises
    ------
    DatasetError
        As :func:`write`, on all ranks.
    """
    target = _checked_path(path)
    chosen = ranks.agreed(lambda: format_of(target))
    if chosen.part_writer is not None:
        chosen.part_writer(part, target, ranks)
        return
    parts = ranks.collected(part)
    ranks.from_root(lambda: write(joined_parts(parts), target))


@checked()
def convert(
    source: AnyPath, target: AnyPath, *, source_format: str | None = None, target_format: str | None = None
) -> None:
    """Read one file and write its problem to another.

    Parameters
    ----------
    source, target : path-like
        The file or folder to read, and the one to write.
    source_format, target_format : str, optional
        Names of their formats. Default: by their names and contents.

    Raises
    ------
    DatasetError
        As :func:`read` and :func:`write`.
    """
    write(read(source, format=source_format), target, format=target_format)


def formats() -> tuple[Format, ...]:
    """All formats: name, description, suffixes, and whether they are readable and writable."""
    return FORMATS


def _format_of_existing(source: Path, format: str | None = None) -> Format:
    """The format of a file that is there."""
    require_present(source)
    return format_of(source) if format is None else named_format(format)


def _checked_path(path: AnyPath) -> Path:
    if "\0" in fsdecode(path):
        raise DatasetError(fsdecode(path), "a path cannot hold a NUL")
    return Path(path)


def named_format(name: str) -> Format:
    """Find the format of that name, or InvalidArgument."""
    return looked_up("format", name, {known.name: known for known in FORMATS})


def format_of(path: Path) -> Format:
    """Find the format that claims `path`, or a DatasetError that lists the known ones."""
    if path.name in colmap.FILE_NAMES and is_regular_file(path):
        raise DatasetError(path, "is one file of a COLMAP model: give the folder that it is in")
    for candidate in FORMATS:
        if candidate.claims(path):
            return candidate
    if is_database(path):
        raise DatasetError(path, "is a database of COLMAP: sfmcpp reconstruct makes a model of it")
    if path.suffix == ".db" and is_present(path):
        raise DatasetError(path, "is no database of SQLite, as COLMAP's are")
    suffixes = ", ".join(suffix for f in FORMATS for suffix in f.suffixes)
    raise DatasetError(
        path, f"its name tells no format: must end in {suffixes}, or be the folder of a COLMAP model"
    )
