"""OpenMVG's ``sfm_data.json``, versions 0.2 and 0.3 (https://openmvg.readthedocs.io, "SfM_Data format").

A pose is a rotation camera_from_world by rows and a centre: ``x_cam = R (X − C)``, z forward, y down. Pixels
are ``principal_point + focal_length · distorted``; radial distortion is ``1 + k1 r² + k2 r⁴ + k3 r⁶``, and
``disto_t2`` are k1, k2, k3, t1, t2, where t1 and t2 are OpenCV's p1 and p2. Objects are packed by cereal:
the name of a class stands with its first object, later ones refer to it by ``polymorphic_id``, and fields of
a base class may lie in ``value0``.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import require_valid
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.json_text import Part, begins_with, document_chunks, read_json
from sfmcpp.sources.io.poses import pose_from_cameras
from sfmcpp.sources.io.views import (
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

VERSION = "sfm_data_version"
# Models of cameras: the field that holds their distortion, and what its numbers are.
_DISTORTIONS: dict[str, tuple[str, tuple[str, ...]]] = {
    "pinhole": ("", ()),
    "pinhole_radial_k1": ("disto_k1", ("k1",)),
    "pinhole_radial_k3": ("disto_k3", ("k1", "k2", "k3")),
    "pinhole_brown_t2": ("disto_t2", ("k1", "k2", "k3", "p1", "p2")),
}
_HELD = {model: ("f", "cx", "cy", *names) for model, (_, names) in _DISTORTIONS.items()}
# The highest bit of a number of cereal's marks what is there for the first time, the next one an object of
# the very class that its list is of.
_FIRST, _SAME_CLASS = 1 << 31, 1 << 30
_SUFFIX = "sfm_data.json"


def read_openmvg(path: Path) -> Problem:
    """Read views, intrinsics, poses and structure; camera model ``"perspective"``.

    Focal lengths and the distortion that the camera has are free. Views without a pose or intrinsics are no
    cameras of the problem; ``metadata.extra["unregistered_images"]`` names them. Control points are left out.

    Raises
    ------
    DatasetError
        Naming the part of the file at fault.
    """
    root = read_json(path)
    version = root.part(VERSION)
    if version.text() not in ("0.2", "0.3"):
        raise version.error(f"{version.text()!r}: must be 0.2 or 0.3")
    return problem_of_views(
        _views(root.part("views")),
        _poses(root.part("extrinsics")),
        _lenses(root.part("intrinsics")),
        _tracks(root.part("structure")),
        "openmvg",
    )


def _views(listed: Part) -> dict[int, View]:
    views: dict[int, View] = {}
    for item in listed.items():
        data = _fields_behind_pointer(item)
        folder, name = (data.part(part).text() for part in ("local_path", "filename"))
        pose, lens = (identifier(data.part(part)) for part in ("id_pose", "id_intrinsic"))
        full = f"{folder.rstrip('/')}/{name}" if folder else name
        view = View(item, full, image_size(data), pose, lens)
        add_once(views, identifier(item.part("key")), view, item)
    return views


def _poses(listed: Part) -> dict[int, FloatArray]:
    poses: dict[int, FloatArray] = {}
    for item in listed.items():
        value = item.part("value")
        camera_from_world = np.array(value.part("rotation").numbers(9)).reshape(3, 3)
        pose = pose_of(value, camera_from_world.T.ravel().tolist(), value.part("center").numbers(3))
        add_once(poses, identifier(item.part("key")), pose, item)
    return poses


def _lenses(listed: Part) -> dict[int, Lens]:
    lenses: dict[int, Lens] = {}
    names: dict[int, str] = {}
    for item in listed.items():
        value = item.part("value")
        number = identifier(value.part("polymorphic_id"))
        named = value.optional("polymorphic_name")
        if named is not None:
            names[number % _FIRST] = named.text()
        if number % _FIRST not in names:
            raise value.error(f"polymorphic_id {number} is of no class that was named before")
        lens = _lens(_fields_behind_pointer(item), names[number % _FIRST])
        add_once(lenses, identifier(item.part("key")), lens, item)
    return lenses


def _lens(data: Part, model: str) -> Lens:
    if model not in _DISTORTIONS:
        raise data.error(f"camera model {model!r}: must be one of {', '.join(_DISTORTIONS)}")
    where, names = _DISTORTIONS[model]
    cx, cy = data.part("principal_point").numbers(2)
    values = {"f": data.part("focal_length").number(), "cx": cx, "cy": cy}
    if names:
        values |= dict(zip(names, data.part(where).numbers(len(names)), strict=True))
    return Lens(values, ("f", *names))


def _tracks(listed: Part) -> Tracks:
    tracks = Tracks()
    for item in listed.items():
        value = item.part("value")
        tracks.points.append(value.part("X").numbers(3))
        for seen in value.part("observations").items():
            tracks.add(identifier(seen.part("key")), seen.part("value").part("x").numbers(2), seen)
    return tracks


def _fields_behind_pointer(item: Part) -> Part:
    """Fields of an object behind a pointer, those of its base class among them."""
    data = item.part("value").part("ptr_wrapper").part("data")
    base = data.optional("value0")
    return data if base is None else data.with_fields_of(base)


def write_openmvg(problem: Problem, path: Path, image_folder: str = "") -> None:
    """Write version 0.3, with views, intrinsics, poses and structure.

    Identifiers are rows of the problem; without known image sizes they are what just covers the observations.

    Parameters
    ----------
    problem : Problem
        Metric; it is not changed.
    path : Path
        Where to.
    image_folder : str
        Where the images are: ``root_path``, before their names.

    Raises
    ------
    DatasetError
        If intrinsics have no place in a camera model of OpenMVG (aspect ratio, skew, k4, k5), metadata do not
        fit the problem, or the file cannot be written.
    """
    require_valid(problem, path)
    views = WrittenViews(problem, _HELD, path)
    content = {
        VERSION: "0.3",
        "root_path": image_folder,
        "views": _view_entries(views),
        "intrinsics": _lens_entries(views.lenses, len(views.names)),
        "extrinsics": _pose_entries(problem),
        "structure": (_entry(row, _landmark(point)) for row, point in enumerate(views.points())),
        "control_points": [],
    }
    with atomic_files(path) as (stream,):
        stream.writelines(document_chunks(content))


def _entry(key: int, value: dict[str, Any]) -> dict[str, Any]:
    return {"key": key, "value": value}


def _pointer_object(number: int, data: dict[str, Any]) -> dict[str, Any]:
    """An object behind a pointer; all are numbered from 1."""
    return {"ptr_wrapper": {"id": _FIRST + number, "data": data}}


def _view_entries(views: WrittenViews) -> Iterator[dict[str, Any]]:
    for row, (name, lens) in enumerate(zip(views.names, views.lens_rows, strict=True)):
        data = {"local_path": "", "filename": name, **views.lenses[lens].named_size}
        data |= {"id_view": row, "id_intrinsic": lens, "id_pose": row}
        yield _entry(row, {"polymorphic_id": _SAME_CLASS, **_pointer_object(1 + row, data)})


def _lens_entries(lenses: list[WrittenLens], objects_before: int) -> Iterator[dict[str, Any]]:
    classes: dict[str, int] = {}
    for row, lens in enumerate(lenses):
        where, names = _DISTORTIONS[lens.model]
        data: dict[str, Any] = {**lens.named_size, "focal_length": lens.values["f"]}
        data["principal_point"] = [lens.values["cx"], lens.values["cy"]]
        if names:
            data[where] = [lens.values[name] for name in names]
        known = lens.model in classes
        number = classes.setdefault(lens.model, len(classes) + 1)
        named = {} if known else {"polymorphic_name": lens.model}
        class_id = {"polymorphic_id": number if known else _FIRST + number}
        yield _entry(row, {**class_id, **named, **_pointer_object(1 + objects_before + row, data)})


def _pose_entries(problem: Problem) -> Iterator[dict[str, Any]]:
    rotations, _ = pose_from_cameras(problem.cameras)
    for row, (rotation, centre) in enumerate(zip(rotations, problem.centres, strict=True)):
        yield _entry(row, {"rotation": rotation.tolist(), "center": centre.tolist()})


def _landmark(point: WrittenPoint) -> dict[str, Any]:
    seen = [_entry(image, {"id_feat": number, "x": pixel}) for image, number, pixel in point.observations]
    return {"X": point.position, "observations": seen}


def _is_openmvg(path: Path) -> bool:
    name = path.name.lower()
    return name.endswith(_SUFFIX) or (name.endswith(".json") and begins_with(path, VERSION.encode()))


FORMAT = Format(
    "openmvg",
    "OpenMVG's sfm_data.json",
    (_SUFFIX,),
    read_openmvg,
    write_openmvg,
    _is_openmvg,
    lacks=(
        "origin of the world",
        "keypoints without a point",
        "colours",
        "masks",
        "rigid frames",
        "uncertainties of observations",
    ),
)
