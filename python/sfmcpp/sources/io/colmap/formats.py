"""COLMAP's two formats as the rest of the package sees them: a folder is read and written as one file is."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from itertools import chain
from pathlib import Path

from sfmcpp.errors import DatasetError
from sfmcpp.model import Problem
from sfmcpp.sources.io.atomic import atomic_folder
from sfmcpp.sources.io.colmap import binary, text
from sfmcpp.sources.io.colmap.from_tables import problem_from_tables
from sfmcpp.sources.io.colmap.tables import Tables
from sfmcpp.sources.io.colmap.to_tables import tables_from_problem
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.origin_file import ORIGIN, origin_files, with_origin


def read_colmap_text(folder: Path) -> Problem:
    """Read cameras.txt, images.txt and points3D.txt; see :func:`read_colmap_binary`."""
    _require_model(folder, text.FILES)
    _require_single_sensors(folder / "rigs.txt", text.sensors_of_rigs)
    return with_origin(problem_from_tables(text.read_text(folder), "colmap-text"), folder)


def read_colmap_binary(folder: Path) -> Problem:
    """Read cameras.bin, images.bin and points3D.bin; camera model ``"perspective"``.

    Images become cameras, in the order of their ids; COLMAP's cameras are rows of `intrinsics`. Free are the
    focal lengths and the distortion coefficients that the camera model has. Observations follow the
    points' tracks. Names, identifiers, sizes, colours and keypoints without a point are metadata; errors of
    points are not kept. Where an image observes a point by several keypoints, which COLMAP allows (SIFT gives
    one corner several orientations), the first in the track counts; the others become keypoints without a
    point, ``metadata.extra["colmap_second_sightings"]`` (D, 3) has camera, keypoint and point id of each, and
    writing puts them back into the tracks, unless the first has gone.

    Raises
    ------
    DatasetError
        If a file is missing or damaged, files contradict each other, a track has a keypoint twice, a rig
        has several sensors, or a camera model is none of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL,
        OPENCV.
    """
    _require_model(folder, binary.FILES)
    _require_single_sensors(folder / "rigs.bin", binary.sensors_of_rigs)
    return with_origin(problem_from_tables(binary.read_binary(folder), "colmap-binary"), folder)


def write_colmap_text(problem: Problem, folder: Path) -> None:
    """Write cameras.txt, images.txt and points3D.txt; see :func:`write_colmap_binary`."""
    _write(problem, folder, text.FILES, text.text_files)


def write_colmap_binary(problem: Problem, folder: Path) -> None:
    """Write cameras.bin, images.bin and points3D.bin into `folder`, which is made if it does not exist.

    The error of a point is its mean reprojection error [px] over the images it is in front of, computed here.
    Masks, standard deviations and covariances are not kept. Pixels stay as they are: COLMAP counts them from
    the top left corner of the image, data sets with the origin elsewhere keep theirs.

    Raises
    ------
    DatasetError
        If no supported camera model holds the intrinsics, `folder` already has rigs or frames (they would
        contradict the new poses), or a file cannot be written.
    """
    _write(problem, folder, binary.FILES, binary.binary_files)


def _write(
    problem: Problem,
    folder: Path,
    names: tuple[str, ...],
    contents: Callable[[Tables], Iterable[Iterable[bytes]]],
) -> None:
    if folder.exists() and not folder.is_dir():
        raise DatasetError(folder, "is a file, a folder is wanted for a COLMAP model")
    _require_no_rigs(folder, Path(names[0]).suffix)
    tables = tables_from_problem(problem, folder)
    origin = origin_files(problem)
    with atomic_folder(folder, (*names, *origin)) as files:
        for file, content in zip(files, chain(contents(tables), origin.values()), strict=True):
            file.writelines(content)
    if not origin and (folder / ORIGIN).exists():
        (folder / ORIGIN).unlink()


def _require_no_rigs(folder: Path, suffix: str) -> None:
    for name in (f"rigs{suffix}", f"frames{suffix}"):
        if (folder / name).exists():
            reason = "is of the model that is there: it would be replaced, and this contradict its poses"
            raise DatasetError(folder / name, f"{reason}; write to another folder")


def _require_model(folder: Path, names: tuple[str, ...]) -> None:
    if not folder.is_dir():
        raise DatasetError(folder, "is not a folder, a COLMAP model is one")
    missing = [name for name in names if not (folder / name).exists()]
    if missing:
        raise DatasetError(folder, f"is a directory without a COLMAP model: it lacks {', '.join(missing)}")


def _require_single_sensors(path: Path, sensors_of: Callable[[Path], Iterable[tuple[int, int]]]) -> None:
    """Refuse cameras that are mounted together: they would be solved as if each moved by itself."""
    if not path.exists():
        return
    for rig, sensors in sensors_of(path):
        if sensors > 1:
            raise DatasetError(path, f"rig {rig} has {sensors} sensors: rigs are not supported yet")


def _has_any(folder: Path, names: tuple[str, ...]) -> bool:
    return any((folder / name).exists() for name in names)


def _claims_text(path: Path) -> bool:
    return path.is_dir() and _has_any(path, text.FILES) and not _has_any(path, binary.FILES)


def _claims_binary(path: Path) -> bool:
    return path.is_dir() or (not path.exists() and not path.suffix)


TEXT = Format(
    "colmap-text",
    "COLMAP model as text: a folder with cameras.txt, images.txt, points3D.txt",
    (),
    read_colmap_text,
    write_colmap_text,
    _claims_text,
    target_check=partial(_require_no_rigs, suffix=".txt"),
    lacks=(
        "masks",
        "uncertainties of observations",
    ),
)
BINARY = Format(
    "colmap-binary",
    "COLMAP model, binary: a folder with cameras.bin, images.bin, points3D.bin",
    (),
    read_colmap_binary,
    write_colmap_binary,
    _claims_binary,
    target_check=partial(_require_no_rigs, suffix=".bin"),
    lacks=(
        "masks",
        "uncertainties of observations",
    ),
)
