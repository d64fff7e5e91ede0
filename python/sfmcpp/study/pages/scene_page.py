"""A page of points, cameras and a path, without a network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

import numpy as np

from sfmcpp.model.arrays import ANY, FloatArray, finite_array
from sfmcpp.study.pages.parts import filled_page, packed, save_page
from sfmcpp.study.pages.viewpoint import view_from_world

_TEMPLATE = "scene_page.html"


@dataclass(frozen=True, eq=False)
class Scene:
    """Contents of a page; all in one world.

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
    predicted : sequence of int
        Places in the path where images said too little.
    facts : mapping of str to str
        Names and values for the panel.
    east_north_up : bool
        Whether the axes of the world are these; the page then shows where north is.

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
    predicted: Sequence[int] = ()
    facts: Mapping[str, str] = field(default_factory=dict)
    east_north_up: bool = False

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
    return filled_page(_TEMPLATE, scene.title, _data(scene))


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
    save_page(scene_page(scene), path)


def _data(scene: Scene) -> dict[str, Any]:
    turn = view_from_world(scene.cameras)
    anchors = (scene.path, scene.cameras[:, :, 3], scene.points, np.zeros((1, 3)))
    turned = next(points for points in anchors if len(points)) @ turn.T
    origin = (turned.min(axis=0) + turned.max(axis=0)) / 2
    moved = np.column_stack([turn, -origin])
    return {
        "points": packed(_transformed_points(scene.points, moved)),
        "path": packed(_transformed_points(scene.path, moved)),
        "truth": packed(_transformed_points(scene.truth, moved)),
        "cameras": packed(_transformed_cameras(scene.cameras, moved)),
        "truthName": scene.truth_name,
        "unit": scene.unit,
        "predicted": [int(place) for place in scene.predicted],
        "north": turn[:, 1].tolist() if scene.east_north_up else None,
        "facts": list(scene.facts.items()),
        # From a height in the page to one above the first centre.
        "originHeight": float(origin[2] - turned[0, 2]),
    }


def _transformed_points(points: FloatArray, move: FloatArray) -> FloatArray:
    return np.asarray(points @ move[:, :3].T + move[:, 3])


def _transformed_cameras(cameras: FloatArray, move: FloatArray) -> FloatArray:
    centres = _transformed_points(cameras[:, :, 3], move)
    return np.concatenate([move[:, :3] @ cameras[:, :, :3], centres[:, :, None]], axis=2)
