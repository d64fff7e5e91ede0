"""``transforms.json``, as nerfstudio, instant-ngp and tools for Gaussian splatting read it.

A frame's ``transform_matrix`` is the 4×4 pose world_from_camera of a camera with OpenGL's axes: +x right, +y
up, looking along −z, hence ``[R | c] diag(1, −1, −1, 1)`` of the pose used here. The world keeps its axes
(there is no ``applied_transform``). Distortion is OpenCV's, which is the perspective model's. Those tools put
the centre of the top left pixel at (0.5, 0.5), as photos have it here, so that ``cx`` and ``cy`` stay as they
are. Without ``fl_x`` the field of view ``camera_angle_x`` tells the focal length.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.sources.io.atomic import atomic_files
from sfmcpp.sources.io.checks import image_names, require_valid
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.intrinsics import (
    lenses_from_corner,
    require_defaults_except,
    require_positive_lengths,
)
from sfmcpp.sources.io.json_text import Part, read_json
from sfmcpp.sources.io.views import Lens, Tracks, View, image_size, pose_of, problem_of_views

_READABLE = ("OPENCV", "PINHOLE", "SIMPLE_PINHOLE")
_DISTORTION = ("k1", "k2", "k3", "k4", "p1", "p2")
_FIELDS = ("fl_x", "fl_y", "cx", "cy", *_DISTORTION)
_KEPT = ("f", "aspect", "cx", "cy", "k1", "k2", "k3", "p1", "p2")
_ALWAYS = ("k1", "k2", "p1", "p2")
_OPENGL_AXES = np.array([1.0, -1.0, -1.0, 1.0])


def read_transforms(path: Path) -> Problem:
    """Read the cameras; camera model ``"perspective"``, all intrinsics fixed, no points and no observations.

    There is nothing to adjust in the file: it is a truth to evaluate against, or poses for other programs.
    Its world is kept: neither ``applied_transform`` nor ``applied_scale`` is undone. Cameras of equal numbers
    and sizes share intrinsics.

    Raises
    ------
    DatasetError
        Naming the part of the file at fault; if a camera is none of OpenCV's or of a pinhole.
    """
    root = read_json(path)
    _require_frames(root)
    views, poses, lenses = {}, {}, {}
    known: dict[tuple[object, ...], int] = {}
    for key, frame in enumerate(root.part("frames").items()):
        camera = frame.with_fields_of(root)
        values, size = _read_lens(camera), image_size(camera, "w", "h")
        lens = known.setdefault((size, *values.values()), len(known))
        lenses[lens] = Lens(values, ())
        views[key] = View(frame, frame.part("file_path").text(), size, key, lens)
        poses[key] = _read_pose(frame.part("transform_matrix"))
    return problem_of_views(views, poses, lenses, Tracks(), "transforms")


def _require_frames(root: Part) -> None:
    """Refuse JSON of other programs, which by its name alone counts as this."""
    first = root.value[0] if isinstance(root.value, list) and root.value else None
    if isinstance(first, dict) and "shots" in first:
        raise root.error(
            "is a reconstruction of OpenSfM: must be made a Bundler file (opensfm export_bundler)"
        )
    if not isinstance(root.value, dict) or "frames" not in root.value:
        raise root.error("is no transforms.json, which has 'frames', nor a model of OpenMVG or AliceVision")


def _read_lens(camera: Part) -> dict[str, float]:
    model = camera.optional("camera_model")
    if model is not None and model.text() not in _READABLE:
        raise model.error(f"{model.text()!r}: must be one of {', '.join(_READABLE)}")
    fisheye = camera.optional("is_fisheye")
    if fisheye is not None and fisheye.value is not False:
        raise fisheye.error("fisheye lenses, as instant-ngp marks them, are not supported: must be false")
    given = {name: camera.optional(name) for name in _FIELDS}
    found = {name: part.number() for name, part in given.items() if part is not None}
    width, height = image_size(camera, "w", "h")
    fx = found["fl_x"] if "fl_x" in found else _focal_of_angle(camera.part("camera_angle_x"), width)
    fy = found.get("fl_y", fx)
    if not (fx > 0 and 0 < fy / fx < math.inf):
        raise camera.error(f"fl_x = {fx:g}, fl_y = {fy:g}: must be positive")
    centre = {"cx": found.get("cx", width / 2), "cy": found.get("cy", height / 2)}
    return {"f": fx, "aspect": fy / fx, **centre, **{name: found.get(name, 0.0) for name in _DISTORTION}}


def _focal_of_angle(angle: Part, width: int) -> float:
    """Focal length [px] of the angle [rad] that the width of an image takes."""
    if not 0 < angle.number() < math.pi:
        raise angle.error(f"{angle.number():g}: must be between 0 and π")
    return width / 2 / math.tan(angle.number() / 2)


def _read_pose(matrix: Part) -> FloatArray:
    rows = np.reshape(matrix.numbers(16), (4, 4)) * _OPENGL_AXES
    if not np.array_equal(rows[3], [0, 0, 0, 1]):
        raise matrix.error("its last row must be 0 0 0 1")
    return pose_of(matrix, rows[:3, :3].ravel().tolist(), rows[:3, 3].tolist())


def folder_from(path: Path, images: Path) -> str:
    """A folder of images as seen from the folder of `path`, for :func:`write_transforms`."""
    return Path(os.path.relpath(images, path.parent)).as_posix()


def write_transforms(problem: Problem, path: Path, image_folder: str = "", points: str = "") -> None:
    """Write the cameras of a problem; its points and observations have no place in the file.

    Intrinsics stand once where all cameras have the same, else with every frame. Without known image sizes
    they are what just covers the observations.

    Parameters
    ----------
    problem : Problem
        Metric; it is not changed. Without names in its metadata, images are ``image_000001`` and so on.
    path : Path
        Where to.
    image_folder : str
        Where the images are, as seen from the folder of `path`, put in front of their names.
    points : str
        The PLY file of the points, as seen from there: ``ply_file_path``, where Gaussian splatting starts.

    Raises
    ------
    DatasetError
        If there is skew, k4 or k5, a focal length or an aspect ratio is not positive, metadata do not fit
        the problem, or the file cannot be written.
    """
    require_valid(problem, path)
    lenses = lenses_from_corner(problem, path)
    require_defaults_except(lenses.values, _KEPT, "transforms.json", path)
    require_positive_lengths(lenses.values, path)
    cameras = [_camera(row, size) for row, size in zip(lenses.values, lenses.sizes.tolist(), strict=True)]
    used = [cameras[row] for row in problem.intrinsics_index]
    frames = _frames(problem, path, image_folder)
    shared = used[0] if used and all(camera == used[0] for camera in used) else {}
    if not shared:
        frames = [{**frame, **camera} for frame, camera in zip(frames, used, strict=True)]
    cloud = {"ply_file_path": points} if points else {}
    content = {"camera_model": "OPENCV", **shared, **cloud, "frames": frames}
    with atomic_files(path) as (stream,):
        stream.write((json.dumps(content, indent=1, allow_nan=False) + "\n").encode("utf-8"))


def _camera(values: FloatArray, size: list[int]) -> dict[str, Any]:
    named = dict(zip(PERSPECTIVE, values.tolist(), strict=True))
    camera = {"fl_x": named["f"], "fl_y": named["f"] * named["aspect"], "cx": named["cx"], "cy": named["cy"]}
    distortion = {name: named[name] for name in (*_ALWAYS, "k3") if name in _ALWAYS or named[name]}
    return {**camera, "w": size[0], "h": size[1], **distortion}


def _frames(problem: Problem, path: Path, image_folder: str) -> list[dict[str, Any]]:
    names = image_names(problem, path)
    matrices = np.tile(np.eye(4), (problem.num_cameras, 1, 1))
    matrices[:, :3] = problem.cameras
    # Adding zero makes zeros of negative zeros.
    matrices = matrices * _OPENGL_AXES + 0.0
    prefix = image_folder.rstrip("/") + "/" if image_folder else ""
    return [
        {"file_path": prefix + name, "transform_matrix": matrix.tolist()}
        for name, matrix in zip(names, matrices, strict=True)
    ]


FORMAT = Format(
    "transforms",
    "transforms.json of nerfstudio and Gaussian splatting: cameras without points",
    (".json",),
    read_transforms,
    write_transforms,
    lacks=(
        "origin of the world",
        "points",
        "observations",
        "keypoints without a point",
        "colours",
        "masks",
        "rigid frames",
        "uncertainties of observations",
    ),
)
