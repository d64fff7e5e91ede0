"""COLMAP's text and binary formats, each a folder that is read and written like one file."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sources.io.atomic import atomic_folder
from sfmcpp.sources.io.colmap import binary, text
from sfmcpp.sources.io.colmap.from_tables import problem_from_tables
from sfmcpp.sources.io.colmap.rig_files import (
    BINARY_FILES,
    TEXT_FILES,
    RigModel,
    binary_rig_files,
    read_binary_rigs,
    read_text_rigs,
    text_rig_files,
)
from sfmcpp.sources.io.colmap.rigs import (
    add_rigs,
    require_poses_of_frames,
    rig_model_of,
    trivial_rigs_in,
    with_poses_of,
)
from sfmcpp.sources.io.colmap.tables import Tables
from sfmcpp.sources.io.colmap.to_tables import tables_from_problem
from sfmcpp.sources.io.files import is_folder, is_present, read_bytes, require_folder
from sfmcpp.sources.io.format import Format

_ReadRigs = Callable[..., RigModel | None]


def read_colmap_text(folder: Path) -> Problem:
    """Read cameras.txt, images.txt and points3D.txt, and rigs; see :func:`read_colmap_binary`."""
    _require_model(folder, text.FILES)
    return with_origin(_problem(text.read_text(folder), read_text_rigs, folder, "colmap-text"), folder)


def read_colmap_binary(folder: Path) -> Problem:
    """Read cameras.bin, images.bin and points3D.bin, and rigs; camera model ``"perspective"``.

    Of a model with fisheye lenses the camera model is :data:`sfmcpp.sources.io.colmap.fisheye.FISHEYE`.

    Images become cameras, in the order of their ids; COLMAP's cameras are rows of `intrinsics`. Free are the
    focal lengths and the distortion coefficients that the camera model has. Observations follow the
    points' tracks. Names, identifiers, sizes, colours and keypoints without a point are metadata; errors of
    points are not kept. Where an image observes a point by several keypoints, which COLMAP allows (SIFT gives
    one corner several orientations), the first in the track counts; the others become keypoints without a
    point, ``metadata.extra["colmap_second_sightings"]`` (D, 3) has camera, keypoint and point id of each, and
    writing puts them back into the tracks, unless the first has gone. Where a rig in
    rigs.bin has several cameras, the problem has `rigs`, with the poses of frames.bin.

    Raises
    ------
    DatasetError
        If a file is missing or damaged; files contradict each other, also images and frames about a pose; a
        track has a keypoint twice; a sensor of a rig is no camera or has no pose; or a camera model is none
        of SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV without a divisor, or, alone,
        of SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, OPENCV_FISHEYE, SIMPLE_FISHEYE, FISHEYE.
    """
    _require_model(folder, binary.FILES)
    return with_origin(
        _problem(binary.read_binary(folder), read_binary_rigs, folder, "colmap-binary"), folder
    )


def _problem(tables: Tables, read_rigs: _ReadRigs, folder: Path, source_format: str) -> Problem:
    tables = replace(tables, images=tables.images.by_id())
    problem = problem_from_tables(tables, source_format)
    if (rigs := read_rigs(folder)) is not None:
        add_rigs(problem, tables, rigs)
    elif (single := read_rigs(folder, alone=True)) is not None:
        require_poses_of_frames(problem, tables, single)
    return problem


def write_colmap_text(problem: Problem, folder: Path) -> None:
    """Write cameras.txt, images.txt and points3D.txt, and rigs; see :func:`write_colmap_binary`."""
    _write(problem, folder, _TEXT)


def write_colmap_binary(problem: Problem, folder: Path) -> None:
    """Write cameras.bin, images.bin and points3D.bin into `folder`, which is made if it does not exist.

    Text files of a model that are there are replaced with them, so that the folder has one model.
    A problem with rigs becomes rigs.bin and frames.bin as well, the first sensor of each rig its origin; rigs
    of one camera each, which COLMAP writes with every model, are rewritten if `folder` has them.

    The error of a point is its mean reprojection error [px] over the images it is in front of, computed here.
    Masks, standard deviations and covariances are not kept. Pixels of the BAL model, which count from the
    principal point, are moved to count from the corner; all others stay as they are.

    Raises
    ------
    DatasetError
        If no supported camera model holds the intrinsics, a sensor of a rig has several rows of intrinsics
        or shares one, `folder` has rigs of several sensors and the problem none, or a file cannot be written.
    """
    _write(problem, folder, _BINARY)


def write_colmap_of_both_kinds(problem: Problem, folder: Path) -> None:
    """Write all files of :func:`write_colmap_text` and :func:`write_colmap_binary` together."""
    _write(problem, folder, *_KINDS)


@dataclass(frozen=True)
class _Files:
    """Names and contents of the files of a kind, and of those of rigs."""

    names: tuple[str, ...]
    contents: Callable[[Tables], Iterable[Iterable[bytes]]]
    rig_names: tuple[str, str]
    read_rigs: _ReadRigs
    rig_contents: Callable[[RigModel], Iterable[Iterable[bytes]]]

    def trivial_rigs(self, folder: Path) -> RigModel | None:
        """Rigs of the model that is there, if any; refused if they are of several sensors."""
        has_model = _has_any_file(folder, self.names)
        return trivial_rigs_in(folder, self.rig_names, self.read_rigs, has_model=has_model)

    def named_contents(self, folder: Path, problem: Problem, tables: Tables) -> _Named:
        """Names of files and their contents, in pieces."""
        yield from zip(self.names, self.contents(tables), strict=True)
        if problem.rigs is not None:
            paths = [folder / name for name in self.rig_names]
            model: RigModel | None = rig_model_of(problem, problem.rigs, tables, paths)
        elif (model := self.trivial_rigs(folder)) is not None:
            model = with_poses_of(tables, model)
        if model is not None:
            yield from zip(self.rig_names, self.rig_contents(model), strict=True)


_Named = Iterator[tuple[str, Iterable[bytes]]]
_TEXT = _Files(text.FILES, text.text_files, TEXT_FILES, read_text_rigs, text_rig_files)
_BINARY = _Files(binary.FILES, binary.binary_files, BINARY_FILES, read_binary_rigs, binary_rig_files)
_KINDS = (_TEXT, _BINARY)


def _write(problem: Problem, folder: Path, *wanted: _Files) -> None:
    """Write these kinds, and any other that is there: a folder has one model, however often."""
    _require_target(folder, problem)
    tables = tables_from_problem(problem, folder)
    kinds = [k for k in _KINDS if k in wanted or _has_any_file(folder, (*k.names, *k.rig_names))]
    contents = list(chain.from_iterable(kind.named_contents(folder, problem, tables) for kind in kinds))
    origin = origin_files(problem)
    contents += origin.items()
    with atomic_folder(folder, [name for name, _ in contents]) as streams:
        for stream, (_, content) in zip(streams, contents, strict=True):
            stream.writelines(content)
    if not origin and is_present(folder / ORIGIN):
        (folder / ORIGIN).unlink()


def _require_target(folder: Path, problem: Problem | None) -> None:
    """Refuse a file and, for a problem without rigs, those of several sensors, which would contradict it."""
    require_folder(folder, " for a COLMAP model")
    if problem is not None and problem.rigs is None:
        for kind in _KINDS:
            kind.trivial_rigs(folder)


def _require_model(folder: Path, names: tuple[str, ...]) -> None:
    if not is_folder(folder):
        raise DatasetError(folder, "is not a folder, a COLMAP model is one")
    missing = [name for name in names if not is_present(folder / name)]
    if missing:
        lacks = f"it lacks {', '.join(missing)}{_others_there(folder, names)}"
        raise DatasetError(folder, f"is a directory without a COLMAP model: {lacks}{_models_inside(folder)}")


def _others_there(folder: Path, names: tuple[str, ...]) -> str:
    """Files of the other kind, which do not make up for those that are missing."""
    others = [name for kind in _KINDS if kind.names != names for name in kind.names]
    there = [name for name in others if is_present(folder / name)]
    return f" (and has {', '.join(there)}, which go with files of their own kind alone)" if there else ""


# Where COLMAP's automatic reconstruction, and nerfstudio, put models within the folder of a project.
_WAYS_TO_MODELS = ("sparse", "colmap/sparse")


def _models_inside(folder: Path) -> str:
    """A hint at the models in folders of this one: `model` of a reconstruction, `0` and so on of COLMAP's."""
    places = [folder, *(place for way in _WAYS_TO_MODELS if is_folder(place := folder / way))]
    found = [
        str(inner)
        for place in places
        for inner in sorted(place.iterdir())
        if any(all(is_present(inner / name) for name in kind.names) for kind in _KINDS)
    ]
    return "; " + (f"{found[0]} is one" if len(found) == 1 else f"{', '.join(found)} are") if found else ""


def _has_any_file(folder: Path, names: tuple[str, ...]) -> bool:
    return any(is_present(folder / name) for name in names)


def _claims_text(path: Path) -> bool:
    return is_folder(path) and _has_any_file(path, text.FILES) and not _has_any_file(path, binary.FILES)


def _claims_binary(path: Path) -> bool:
    return is_folder(path) or (not is_present(path) and not path.suffix)


_LACKS = ("masks", "uncertainties of observations")
TEXT = Format(
    "colmap-text",
    "COLMAP model as text: a folder with cameras.txt, images.txt, points3D.txt",
    (),
    read_colmap_text,
    write_colmap_text,
    _claims_text,
    target_check=_require_target,
    lacks=_LACKS,
)
BINARY = Format(
    "colmap-binary",
    "COLMAP model, binary: a folder with cameras.bin, images.bin, points3D.bin",
    (),
    read_colmap_binary,
    write_colmap_binary,
    _claims_binary,
    target_check=_require_target,
    lacks=_LACKS,
)


# Names of all files that a model may consist of.
FILE_NAMES = frozenset((*text.FILES, *TEXT_FILES, *binary.FILES, *BINARY_FILES))
ORIGIN = "sfmcpp_origin.json"


def origin_files(problem: Problem) -> dict[str, list[bytes]]:
    """Name and content, in pieces, of the file of the origin, if the metadata have one."""
    origin = WorldOrigin.of(problem.metadata)
    return {} if origin is None else {ORIGIN: [json.dumps(origin.to_dict(), indent=1).encode(), b"\n"]}


def with_origin(problem: Problem, folder: Path) -> Problem:
    """Add the origin in a folder, if there is one, to the metadata.

    Raises
    ------
    DatasetError
        If the file is none of an origin.
    """
    path = folder / ORIGIN
    if not is_present(path):
        return problem
    try:
        entries = json.loads(read_bytes(path))
        WorldOrigin.from_dict(entries if isinstance(entries, dict) else {}).put_into(problem.metadata)
    except (ValueError, InvalidArgument, RecursionError) as error:
        raise DatasetError(path, str(error)) from error
    return problem
