"""A page of points, cameras and a path that opens in any browser, without a network."""

from __future__ import annotations

import html
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp.model.arrays import ANY, FloatArray, finite_array
from sfmcpp.sources.io.files import atomic_files
from sfmcpp.study.pages.parts import packed, script, template

_TEMPLATE = "scene_page.html"
# Directions that differ by less are the same: a camera that looks straight up or down.
_PARALLEL = 1e-6


@dataclass(frozen=True, eq=False)
class Scene:
    """What a page shows; all in one world.

    Attributes
    ----------
    title : str
        Heading of the page.
    points : (N, 3) float64
        Points of the map.
    path : (n, 3) float64
        Centres of the camera, in order.
    cameras : (K, 3, 4) float64
        Keyframes ``[R | c]``, world_from_camera, y down in the camera; some of them are drawn.
    truth : (m, 3) float64
        True centres; none if unknown.
    truth_name : str
        What the legend says of them.
    unit : str
        Of lengths; empty for a map of unknown scale.
    facts : mapping of str to str
        Names and values for the panel.

    Raises
    ------
    InvalidArgument
        If a shape is wrong or a number is not finite.
    """

    title: str
    points: FloatArray
    path: FloatArray
    cameras: FloatArray
    truth: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    truth_name: str = "truth"
    unit: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("points", "path", "truth", "cameras"):
            shape = (ANY, 3, 4) if name == "cameras" else (ANY, 3)
            object.__setattr__(self, name, finite_array(name, getattr(self, name), shape))


def scene_page(scene: Scene) -> str:
    """Make the page: one HTML text with everything in it.

    The same scene gives the same text. Up is where the cameras' tops point in the mean, ahead is where the
    first one looks; colours go with the height above the first centre.

    Parameters
    ----------
    scene : Scene
        What to show.

    Returns
    -------
    str
        HTML with its style, script and data.
    """
    data = script(_data(scene))
    page = files("sfmcpp.study.plotting").joinpath(_TEMPLATE).read_text(encoding="utf-8")
    page = page.replace("{{orbit}}", template("orbit.js")).replace("{{title}}", html.escape(scene.title))
    return page.replace("{{scene}}", data)


def save_scene_page(scene: Scene, path: str | PathLike[str]) -> None:
    """Write the page; the file appears complete or not at all.

    Parameters
    ----------
    scene : Scene
        What to show.
    path : path-like
        Where to.

    Raises
    ------
    DatasetError
        If the file cannot be written.
    """
    with atomic_files(Path(path)) as (stream,):
        stream.write(scene_page(scene).encode("utf-8"))


def _data(scene: Scene) -> dict[str, Any]:
    turn = view_from_world(scene.cameras)
    anchors = (scene.path, scene.cameras[:, :, 3], scene.points, np.zeros((1, 3)))
    turned = next(points for points in anchors if len(points)) @ turn.T
    origin = (turned.min(axis=0) + turned.max(axis=0)) / 2
    moved = np.column_stack([turn, -origin])
    return {
        "points": packed(_moved(scene.points, moved)),
        "path": packed(_moved(scene.path, moved)),
        "truth": packed(_moved(scene.truth, moved)),
        "cameras": packed(_moved_cameras(scene.cameras, moved)),
        "truthName": scene.truth_name,
        "unit": scene.unit,
        "facts": list(scene.facts.items()),
        # From a height in the page to one above the first centre.
        "originHeight": float(origin[2] - turned[0, 2]),
    }


def view_from_world(cameras: FloatArray) -> FloatArray:
    """Rotation to x right, y ahead, z up: up as tops of `cameras` (K, 3, 4) in the mean, ahead as the first.

    Without cameras it is that of one with the axes of the world.
    """
    axes = cameras[:, :, :3] if len(cameras) else np.eye(3)[None]
    up = _unit(-axes[:, :, 1].mean(axis=0), fallback=-axes[0, :, 1])
    level = axes[0, :, 2] - (axes[0, :, 2] @ up) * up
    top = -axes[0, :, 1]
    ahead = _unit(level, fallback=_unit(top - (top @ up) * up, fallback=axes[0, :, 0]))
    return np.stack([np.cross(ahead, up), ahead, up])


def _unit(vector: FloatArray, fallback: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(vector))
    return vector / length if length > _PARALLEL else fallback


def _moved(points: FloatArray, move: FloatArray) -> FloatArray:
    return np.asarray(points @ move[:, :3].T + move[:, 3])


def _moved_cameras(cameras: FloatArray, move: FloatArray) -> FloatArray:
    centres = _moved(cameras[:, :, 3], move)
    return np.concatenate([move[:, :3] @ cameras[:, :, :3], centres[:, :, None]], axis=2)
