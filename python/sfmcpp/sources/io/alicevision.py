"""AliceVision's and Meshroom's models as JSON: ``.sfm`` files (https://github.com/alicevision/AliceVision).

Their layout is that of AliceVision's sfmDataIO. ``rotation`` is camera_from_world by columns, hence
world_from_camera by rows, with z forward and y down, and ``center`` is in the world. A principal point counts
from the middle of the image since version 1.2.1. Focal lengths are in pixels, one before version 1.2 and two
before 1.2.2, and then in millimetres of a sensor whose width the image fills; ``pixelRatio`` is fx / fy
before 1.2.5 and fy / fx since. Numbers may be texts. Distortion is OpenCV's.
"""

from __future__ import annotations

from pathlib import Path

from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.json_text import Part, begins_with, read_json
from sfmcpp.sources.io.views import (
    LARGEST_ID,
    Lens,
    Tracks,
    View,
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


def _listed(root: Part, name: str) -> list[Part]:
    """Entries of a list that is not written where it is empty."""
    found = root.optional(name)
    return [] if found is None or found.value == "" else list(found.items())


def _views(root: Part) -> dict[int, View]:
    views: dict[int, View] = {}
    for item in _listed(root, "views"):
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
    for item in _listed(root, "poses"):
        transform = item.part("pose").part("transform")
        pose = pose_of(transform, transform.part("rotation").numbers(9), transform.part("center").numbers(3))
        add_once(poses, identifier(item.part("poseId")), pose, item)
    return poses


def _lenses(root: Part, version: Version) -> dict[int, Lens]:
    lenses: dict[int, Lens] = {}
    for item in _listed(root, "intrinsics"):
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
    fx = item.part("focalLength").number() * _ratio(item, width, sensor_mm)
    ratio = item.optional("pixelRatio")
    value = 1.0 if ratio is None else ratio.number()
    return fx, _ratio(item, 1.0, value) if version < (1, 2, 5) else value


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
    for item in _listed(root, "structure"):
        tracks.points.append(item.part("X").numbers(3))
        tracks.colors.append(_color(item.part("color")))
        for seen in _listed(item, "observations"):
            pixel = seen.optional("x")
            if pixel is None:
                raise seen.error("lacks 'x': the file must be exported with its features")
            tracks.add(identifier(seen.part("observationId")), pixel.numbers(2), seen)
    return tracks


def _color(part: Part) -> list[int]:
    part.numbers(3)
    return [number.integer(0, 255) for number in part.items()]


def _claims(path: Path) -> bool:
    name = path.name.lower()
    return name.endswith(_SUFFIX) or (name.endswith(".json") and begins_with(path, b'"featuresFolders"'))


FORMAT = Format(
    "alicevision", "AliceVision and Meshroom, .sfm as JSON", (_SUFFIX,), read_alicevision, claim=_claims
)
