"""Poses of images by name, of a model or of its truth, and their association."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path, PurePosixPath
from unicodedata import normalize

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.map import Map
from sfmcpp.model import Problem, Trajectory
from sfmcpp.model.arguments import check_fields, checked
from sfmcpp.model.arrays import FloatArray, shaped_array
from sfmcpp.model.checks import is_rotation
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.model.photos import natural_order
from sfmcpp.sources.io.api import format_of, read
from sfmcpp.sources.io.files import failures_named, is_folder, is_present, is_regular_file
from sfmcpp.sources.io.number_text import number_of
from sfmcpp.study.evaluation.associate import NEAREST_WITHIN_S, nearest_rows
from sfmcpp.study.report_files import MODEL, REPORT

# Formats without names of images; their .txt is a trajectory's too.
_NAMELESS = ("bal", "sba")
# What numbers in names of images count: seconds, or the ns, µs and ms of data sets. Whole ones that all stay
# below a million are frame numbers.
_UNITS_S = (1.0, 1e-9, 1e-6, 1e-3)
_FRAMES = 1e6
_SHOWN = 3
Rows = NDArray[np.int64]
_KEYS: dict[str, Callable[[str], str]] = {
    "name": str,
    "file name": lambda name: normalize("NFC", PurePosixPath(name).name),
    "stem": lambda name: normalize("NFC", PurePosixPath(name).stem.lower()),
}


@dataclass(frozen=True, eq=False)
class ImagePoses:
    """Poses of images, world_from_camera.

    Parameters
    ----------
    names : tuple of str
        Name of each image, all different.
    poses : (n, 3, 4) float64
        ``[R | c]``: rotation world_from_camera and centre in the world.
    origin : WorldOrigin, optional
        Of the world, where that is known.

    Raises
    ------
    InvalidArgument
        If there are not as many names as poses, a name occurs twice, a number is not finite, or the first
        three columns of a pose are no rotation.
    """

    names: tuple[str, ...]
    poses: FloatArray
    origin: WorldOrigin | None = None

    def __post_init__(self) -> None:
        check_fields(self, "names", "origin")
        object.__setattr__(self, "poses", shaped_array("poses", self.poses, (len(self.names), 3, 4)))
        if len(set(self.names)) != len(self.names):
            twice = next(name for name in self.names if self.names.count(name) > 1)
            raise InvalidArgument(f"names: {twice!r} occurs twice, must be different")
        good = np.isfinite(self.poses).all(axis=(1, 2)) & is_rotation(self.poses[:, :, :3])
        if not good.all():
            raise InvalidArgument(f"poses[{int(np.argmin(good))}]: no finite pose [R | c] with a rotation R")

    def __len__(self) -> int:
        return len(self.names)

    @classmethod
    def of(cls, model: ImagePoses | Problem | Map) -> ImagePoses:
        """Poses of the images that a model has registered.

        Parameters
        ----------
        model : ImagePoses, Problem or Map
            A metric problem whose metadata names its images; a map, of which images with a pose count.

        Returns
        -------
        ImagePoses

        Raises
        ------
        InvalidArgument
            If it is projective, or has no names.
        """
        if isinstance(model, ImagePoses):
            return model
        if isinstance(model, Map):
            rows = np.flatnonzero(model.registered)
            return cls(tuple(model.image_names[row] for row in rows), model.poses[rows], model.origin)
        if not model.is_metric:
            raise InvalidArgument("model: has projection matrices in place of poses, must be metric")
        names = model.metadata.image_names
        if len(names) != model.num_cameras or not names:
            raise InvalidArgument(
                f"model: names {len(names)} of {model.num_cameras} images, must name all and have one: by "
                "names it is matched with the truth"
            )
        return cls(tuple(names), model.cameras, WorldOrigin.of(model.metadata))


def is_problem_file(path: Path) -> bool:
    """Whether the name is that of a format whose images can have names, rather than a trajectory's."""
    try:
        return format_of(path).name not in _NAMELESS
    except DatasetError:
        return False


def model_path(path: Path) -> Path:
    """Path of the model: `path` itself, or the folder ``model`` in the results of ``sfmcpp reconstruct``."""
    inside = path / MODEL
    return inside if not _has_model(path) and _has_model(inside) else path


@checked()
def read_image_poses(path: str | PathLike[str]) -> ImagePoses:
    """Read the poses of named images.

    Parameters
    ----------
    path : path-like
        A COLMAP model, a folder that ``sfmcpp reconstruct`` wrote, one of Strecha's ``IMAGE.camera``, or any
        problem file whose images have names.

    Returns
    -------
    ImagePoses

    Raises
    ------
    DatasetError
        If it cannot be read, is no such thing, or its images have no names.
    """
    source = Path(path)
    with failures_named(source):
        found = model_path(source)
        if is_folder(found) and not _has_model(found):
            raise DatasetError(source, _no_model(source))
    try:
        return ImagePoses.of(read(found))
    except InvalidArgument as error:
        raise DatasetError(found, str(error)) from error


def images_of_model_path(path: Path) -> list[str] | None:
    """Names of all images given to ``sfmcpp reconstruct``, from its report in `path`; else None."""
    report = path / REPORT
    if not is_regular_file(report):
        return None
    with failures_named(report):
        try:
            images = json.loads(report.read_bytes()).get("images")
        except (ValueError, AttributeError, RecursionError):
            return None
    return list(images) if isinstance(images, dict) and images else None


def _has_model(path: Path) -> bool:
    wanted = (f"{stem}.{kind}" for stem in ("cameras", "images") for kind in ("bin", "txt"))
    return any(is_present(path / name) for name in wanted) or any(path.glob("*.camera"))


def _no_model(path: Path) -> str:
    trajectory = path / "trajectory.txt"
    hint = f"; evaluate {trajectory} instead" if is_regular_file(trajectory) else ""
    return (
        "is a folder without a model: must hold cameras, images and points3D (.bin or .txt), a folder "
        f"{MODEL!r} with them, or Strecha's IMAGE.camera{hint}"
    )


@dataclass(frozen=True, eq=False)
class MatchedImages:
    """Images of the truth, and those of them that the model has.

    Attributes
    ----------
    truth : ImagePoses
        All images of the truth.
    model_rows, truth_rows : (n,) int64
        Image i of both is row ``model_rows[i]`` of the model and row ``truth_rows[i]`` of the truth.
    matched_by : str
        ``"name"``, ``"file name"``, ``"stem"``, ``"time"``, ``"frame number"`` or ``"order"``.
    note : str
        What limits the comparison; empty if nothing does.
    """

    truth: ImagePoses
    model_rows: Rows
    truth_rows: Rows
    matched_by: str
    note: str = ""


def match_by_name(model: ImagePoses, truth: ImagePoses) -> MatchedImages:
    """Pair images of the same name: the whole one, else that of the file, else that without its suffix.

    Of the three the one that pairs most images is taken, the stricter one where they pair as many. A rule
    counts only if it leaves all names of either side different.

    Raises
    ------
    InvalidArgument
        If no image is in both; the message shows some of either side.
    """
    best = MatchedImages(truth, np.empty(0, np.int64), np.empty(0, np.int64), "name")
    for rule, key in _KEYS.items():
        ours, true = ([key(name) for name in side.names] for side in (model, truth))
        if len(set(ours)) < len(ours) or len(set(true)) < len(true):
            continue
        rows = {name: row for row, name in enumerate(ours)}
        pairs = [(rows[name], row) for row, name in enumerate(true) if name in rows]
        if len(pairs) > len(best.model_rows):
            first, second = np.array(pairs, dtype=np.int64).T
            best = MatchedImages(truth, first, second, rule)
    if not len(best.model_rows):
        raise InvalidArgument(
            f"truth: no image of the model is in it: the model has {_some(model.names)}, the truth "
            f"{_some(truth.names)}"
        )
    return best


def match_with_trajectory(
    model: ImagePoses,
    truth: Trajectory,
    images: Sequence[str] | None = None,
    max_difference_s: float = NEAREST_WITHIN_S,
) -> MatchedImages:
    """Pair images with the poses of a trajectory.

    With times: the stem of an image's name is its time, in s, ms, µs or ns, whichever fits most images, and
    the pose nearest in time is its own; whole numbers that stay below a million are no times. Else, and
    without times: by the order of the names if there are as many images as poses; by the number that is the
    whole stem of the name, counted from 0.

    Parameters
    ----------
    model : ImagePoses
        Registered images.
    truth : Trajectory
        True poses.
    images : sequence of str, optional
        Names of all images that could have been registered. Poses of no such image are no part of the truth.
        Default: those of the model; of a truth without times all poses count.
    max_difference_s : float
        How far in time the pose of an image may be [s].

    Returns
    -------
    MatchedImages

    Raises
    ------
    InvalidArgument
        If nothing matches.
    """
    # Sorted: names that only `images` has may not change the rows of the others.
    names = sorted({*model.names, *(images or ())}, key=natural_order)
    stems = [PurePosixPath(name).stem for name in names]
    rows, matched_by = _rows_by_time(stems, truth, max_difference_s) if truth.stamped else None, "time"
    if rows is None:
        rows, matched_by = _rows_by_number(stems, truth)
    labelled = {int(row): name for row, name in zip(rows, names, strict=True) if row >= 0}
    note = ""
    if images is None and matched_by == "time" and len(labelled) < len(truth):
        note = "poses of the truth that no image of the model belongs to are left out: they may be no images"
    if images is None and matched_by == "frame number":
        labelled = {row: labelled.get(row, f"pose {row}") for row in range(len(truth))}
    kept = sorted(labelled)
    true = ImagePoses(tuple(labelled[row] for row in kept), truth.poses[kept])
    found = match_by_name(model, true)
    return MatchedImages(true, found.model_rows, found.truth_rows, matched_by, note)


def _rows_by_time(stems: list[str], truth: Trajectory, limit_s: float) -> Rows | None:
    """Row of the truth of each image, -1 for none; None if no name is the time of a pose."""
    numbers = np.array([number_of(stem) for stem in stems])
    if not np.isfinite(numbers).all():
        return None
    if all(stem.isdigit() for stem in stems) and numbers.max() < _FRAMES:
        return None
    best: Rows = np.full(len(stems), -1)
    for unit in _UNITS_S:
        rows = _rows_near(numbers * unit, truth.t_s, limit_s)
        if np.count_nonzero(rows >= 0) > np.count_nonzero(best >= 0):
            best = rows
    return best if (best >= 0).any() else None


def _rows_near(times_s: FloatArray, t_s: FloatArray, limit_s: float) -> Rows:
    """Row of the nearest stamp within the limit, each for the nearest of its images, else -1."""
    rows = nearest_rows(t_s, times_s)
    apart = np.abs(t_s[rows] - times_s)
    order = np.lexsort((apart, rows))
    repeated = np.concatenate([[False], np.diff(rows[order]) == 0])
    rows[order[repeated]] = -1
    rows[apart > limit_s] = -1
    return rows


def _rows_by_number(stems: list[str], truth: Trajectory) -> tuple[Rows, str]:
    if len(stems) == len(truth):
        return np.arange(len(truth)), "order"
    if all(re.fullmatch(r"[0-9]{1,18}", stem) for stem in stems):
        rows = np.array([int(stem) for stem in stems])
        if rows.max() < len(truth) and len(set(rows.tolist())) == len(rows):
            return rows, "frame number"
    raise InvalidArgument(
        f"truth: its {len(truth)} poses cannot be told to belong to {len(stems)} images such as "
        f"{_some(stems)}: names must be times or frame numbers, or images and poses as many"
    )


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(map(repr, sorted(names)[:_SHOWN])) + more
