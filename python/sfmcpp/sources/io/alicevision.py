"""AliceVision's and Meshroom's models as JSON: ``.sfm`` files (https://github.com/alicevision/AliceVision).

Their layout is that of AliceVision's sfmDataIO. ``rotation`` is camera_from_world by columns, hence
world_from_camera by rows, with z forward and y down, and ``center`` is in the world. A principal point counts
from the middle of the image since version 1.2.1. Focal lengths are in pixels, one before version 1.2 and two
before 1.2.2, and then in millimetres of a sensor whose width the image fills; ``pixelRatio`` is fx / fy
before 1.2.5 and fy / fx since. They are fx, and fy since 1.2.11. Numbers may be texts. Distortion is that of
OpenCV.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from sfmcpp.errors import DatasetError
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import require_valid
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.json_text import Part, begins_with, document_chunks, read_json
from sfmcpp.sources.io.views import (
    LARGEST_ID,
    Lens,
    Tracks,
    View,
    WrittenLens,
    WrittenPoint,
    WrittenViews,
    add_once,
    identifier,
    image_size,
    pose_of,
    problem_of_views,
)

_SUFFIX = ".sfm"
Version = tuple[int, ...]

# Distortion of a camera's type or, as newer versions have it, its distortion type.
_DISTORTIONS: dict[str, tuple[str, ...]] = {
    "pinhole": (),
    "none": (),
    "radial1": ("k1",),
    "radialk1": ("k1",),
    "radial3": ("k1", "k2", "k3"),
    "radialk3": ("k1", "k2", "k3"),
    "brown": ("k1", "k2", "k3", "p1", "p2"),
}
# What is written: the types that all versions since know.
_VERSION = (1, 2, 6)
_WRITTEN_TYPES = ("pinhole", "radial1", "radial3", "brown")
_HELD = {name: ("f", "aspect", "cx", "cy", *_DISTORTIONS[name]) for name in _WRITTEN_TYPES}
_SENSOR_MM = 36.0


def read_alicevision(path: Path) -> Problem:
    """Read views, intrinsics, poses and structure; camera model ``"perspective"``.

    Focal lengths and the distortion that a camera has are free, the ratio of the focal lengths where there
    are two, and none of a locked camera. Views without a pose are no cameras of the problem;
    ``metadata.extra["unregistered_images"]`` names them. Files that Meshroom keeps as ``cameras.sfm`` have no
    structure: they are cameras without points, as a truth to evaluate against.

    Raises
    ------
    DatasetError
        Naming the part of the file at fault; if there are rigs, or observations without their pixels.
    """
    root = read_json(path)
    version = tuple(int(number) for number in root.part("version").numbers(3))
    rigs = root.optional("rigs")
    if rigs is not None and any(True for _ in rigs.items()):
        raise rigs.error("rigs are not supported yet")
    return problem_of_views(_views(root), _poses(root), _lenses(root, version), _tracks(root), "alicevision")


def _optional_list(root: Part, name: str) -> list[Part]:
    """Entries of a list that is not written where it is empty."""
    found = root.optional(name)
    return [] if found is None or found.value == "" else list(found.items())


def _views(root: Part) -> dict[int, View]:
    views: dict[int, View] = {}
    for item in _optional_list(root, "views"):
        key = identifier(item.part("viewId"))
        pose, lens = item.optional("poseId"), item.optional("intrinsicId")
        view = View(
            item,
            item.part("path").text(),
            image_size(item),
            key if pose is None else identifier(pose),
            LARGEST_ID if lens is None else identifier(lens),
        )
        add_once(views, key, view, item)
    return views


def _poses(root: Part) -> dict[int, FloatArray]:
    poses: dict[int, FloatArray] = {}
    for item in _optional_list(root, "poses"):
        transform = item.part("pose").part("transform")
        pose = pose_of(transform, transform.part("rotation").numbers(9), transform.part("center").numbers(3))
        add_once(poses, identifier(item.part("poseId")), pose, item)
    return poses


def _lenses(root: Part, version: Version) -> dict[int, Lens]:
    lenses: dict[int, Lens] = {}
    for item in _optional_list(root, "intrinsics"):
        add_once(lenses, identifier(item.part("intrinsicId")), _lens(item, version), item)
    return lenses


def _lens(item: Part, version: Version) -> Lens:
    kind = item.part("type").text()
    newer = item.optional("distortionType")
    distortion = newer.text() if newer is not None and kind == "pinhole" else kind
    if distortion not in _DISTORTIONS:
        raise item.error(f"camera of type {distortion!r}: must be one of {', '.join(_DISTORTIONS)}")
    values = dict(zip(("f", "aspect"), _focal(item, version), strict=True))
    values |= dict(zip(("cx", "cy"), _principal_point(item, version), strict=True))
    names = _DISTORTIONS[distortion]
    if names:
        values |= dict(zip(names, item.part("distortionParams").numbers(len(names)), strict=True))
    free = ("f", *(("aspect",) if values["aspect"] != 1 else ()), *names)
    return Lens(values, () if _is_locked(item) else free)


def _focal(item: Part, version: Version) -> tuple[float, float]:
    """Focal length fx [px], and fy / fx."""
    if version < (1, 2, 0):
        return item.part("pxFocalLength").number(), 1.0
    if version < (1, 2, 2):
        fx, fy = item.part("pxFocalLength").numbers(2)
        return fx, _ratio(item, fy, fx)
    width, sensor = item.part("width").number(), item.optional("sensorWidth")
    sensor_mm = _SENSOR_MM if sensor is None else sensor.number()
    focal = item.part("focalLength").number() * _ratio(item, width, sensor_mm)
    ratio = item.optional("pixelRatio")
    value = 1.0 if ratio is None else ratio.number()
    if version < (1, 2, 5):
        return focal, _ratio(item, 1.0, value)
    return focal if version < (1, 2, 11) else _ratio(item, focal, value), value


def _ratio(item: Part, above: float, below: float) -> float:
    if not (above > 0 and below > 0):
        raise item.error("focal lengths, their ratio and the sensor's width must be positive")
    return above / below


def _principal_point(item: Part, version: Version) -> tuple[float, float]:
    x, y = item.part("principalPoint").numbers(2)
    if version < (1, 2, 1):
        return x, y
    width, height = image_size(item)
    return x + width / 2, y + height / 2


def _is_locked(item: Part) -> bool:
    locked = item.optional("locked")
    return locked is not None and locked.value in (True, "true", "1", 1)


def _tracks(root: Part) -> Tracks:
    tracks = Tracks()
    for item in _optional_list(root, "structure"):
        tracks.points.append(item.part("X").numbers(3))
        tracks.colors.append(_color(item.part("color")))
        for seen in _optional_list(item, "observations"):
            pixel = seen.optional("x")
            if pixel is None:
                raise seen.error("lacks 'x': the file must be exported with its features")
            tracks.add(identifier(seen.part("observationId")), pixel.numbers(2), seen)
    return tracks


def _color(part: Part) -> list[int]:
    part.numbers(3)
    return [number.integer(0, 255) for number in part.items()]


def write_alicevision(problem: Problem, path: Path, image_folder: str = "") -> None:
    """Write version 1.2.6, with views, intrinsics, poses and structure, pixels among the observations.

    Identifiers are rows of the problem. Focal lengths are told for a sensor of 36 mm; cameras without free
    intrinsics are locked. Without known image sizes they are what just covers the observations.

    Parameters
    ----------
    problem : Problem
        Metric; it is not changed.
    path : Path
        Where to.
    image_folder : str
        Where the images are, put in front of their names.

    Raises
    ------
    DatasetError
        If intrinsics have no place in a camera of AliceVision (skew, k4, k5, focal lengths that are not
        positive), metadata do not fit the problem, or the file cannot be written.
    """
    require_valid(problem, path)
    views = WrittenViews(problem, _HELD, path)
    content = {
        "version": _texts(_VERSION),
        "featuresFolders": [],
        "matchesFolders": [],
        "views": _view_entries(views, image_folder),
        "intrinsics": (_lens_entry(row, lens, path) for row, lens in enumerate(views.lenses)),
        "poses": _pose_entries(problem),
        "structure": (_landmark(row, point) for row, point in enumerate(views.points())),
    }
    with atomic_files(path) as (stream,):
        stream.writelines(document_chunks(content))


def _texts(numbers: Iterable[float]) -> list[str]:
    """Numbers as texts, as Boost writes them for these programs."""
    return [str(number) for number in numbers]


def _view_entries(views: WrittenViews, image_folder: str) -> Iterator[dict[str, Any]]:
    prefix = image_folder.rstrip("/") + "/" if image_folder else ""
    for row, (name, lens) in enumerate(zip(views.names, views.lens_rows, strict=True)):
        numbers = {"viewId": row, "poseId": row, "frameId": row, "intrinsicId": lens}
        yield {**_quoted(numbers), "path": prefix + name, **_quoted(views.lenses[lens].named_size)}


def _quoted(numbers: Mapping[str, float]) -> dict[str, str]:
    return dict(zip(numbers, _texts(numbers.values()), strict=True))


def _lens_entry(row: int, lens: WrittenLens, path: Path) -> dict[str, Any]:
    f, aspect, cx, cy = (lens.values[name] for name in ("f", "aspect", "cx", "cy"))
    if not (f > 0 and aspect > 0):
        raise DatasetError(path, f"intrinsics[{row}]: f = {f}, aspect = {aspect}: must be positive")
    width, height = lens.size
    focal_mm = f * _SENSOR_MM / width
    sensor = {"sensorWidth": _SENSOR_MM, "sensorHeight": _SENSOR_MM * height / width}
    focal = {"initialFocalLength": focal_mm, "focalLength": focal_mm, "pixelRatio": aspect}
    return {
        **_quoted({"intrinsicId": row, **lens.named_size, **sensor}),
        "serialNumber": str(row),
        "type": lens.model,
        "initializationMode": "estimated",
        **_quoted(focal),
        "pixelRatioLocked": str(int(aspect == 1)),
        "principalPoint": _texts((cx - width / 2, cy - height / 2)),
        "distortionInitializationMode": "estimated",
        "distortionParams": _texts(lens.values[name] for name in _DISTORTIONS[lens.model]),
        "undistortionOffset": _texts((0, 0)),
        "undistortionParams": [],
        "locked": str(int(lens.is_fixed)),
    }


def _pose_entries(problem: Problem) -> Iterator[dict[str, Any]]:
    for row, pose in enumerate(problem.cameras):
        rotation, center = _texts(pose[:, :3].ravel().tolist()), _texts(pose[:, 3].tolist())
        transform = {"rotation": rotation, "center": center}
        yield {"poseId": str(row), "pose": {"transform": transform, "locked": "0"}}


def _landmark(row: int, point: WrittenPoint) -> dict[str, Any]:
    return {
        "landmarkId": str(row),
        "descType": "sift",
        "color": _texts(point.color),
        "X": _texts(point.position),
        "observations": [
            {"observationId": str(image), "featureId": str(number), "x": _texts(pixel), "scale": "0"}
            for image, number, pixel in point.observations
        ],
    }


def _is_alicevision(path: Path) -> bool:
    name = path.name.lower()
    return name.endswith(_SUFFIX) or (name.endswith(".json") and begins_with(path, b'"featuresFolders"'))


FORMAT = Format(
    "alicevision",
    "AliceVision and Meshroom, .sfm as JSON",
    (_SUFFIX,),
    read_alicevision,
    write_alicevision,
    _is_alicevision,
    lacks=(
        "origin of the world",
        "keypoints without a point",
        "masks",
        "rigid frames",
        "uncertainties of observations",
    ),
)
