"""A live view of the growing map in the browser."""

from __future__ import annotations

import contextlib
import io
import math
import time
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry.so3 import quaternion_from_rotation
from sfmcpp.model.arrays import FloatArray
from sfmcpp.slam import SlamResult
from sfmcpp.study.pages.viewpoint import view_from_world

UPDATES_PER_SECOND = 10.0
# Of the run's time that showing it may take.
_LARGEST_SHARE = 0.05
# For this computer alone: the page has no password.
_HOST = "127.0.0.1"
# Or, if it is taken, the next free one.
_FIRST_PORT = 8080
MOST_POINTS = 100_000
MOST_KEYFRAMES = 40

# How large the scene is drawn: distance of its points, or length of the path, in units of the page.
_EXTENT = 10.0
_EYE, _LOOKED_AT = np.array([0.0, -_EXTENT, 0.7 * _EXTENT]), np.array([0.0, 0.2 * _EXTENT, 0.0])
_POINT, _FRUSTUM = 0.06, 0.25
_PATH, _KEYFRAME, _CAMERA = (255, 50, 25), (90, 100, 110), (255, 255, 255)
_GRID = (52, 64, 74)
# A cell of the grid, at least, in units of the page.
_CELL = 1.0
# Share of the points below the grid.
_BELOW = 0.03
# Steps of a ramp from dark blue to pale yellow, even in lightness.
_RAMP = np.array(
    [[58, 76, 150], [42, 120, 168], [32, 158, 158], [74, 190, 124], [160, 214, 76], [246, 230, 80]],
    np.float64,
)
# Ends of the lines of a camera: its tip and four corners.
_CORNERS = np.array([[0, 0, 0], [-0.6, -0.4, 0.8], [0.6, -0.4, 0.8], [0.6, 0.4, 0.8], [-0.6, 0.4, 0.8]])
_EDGES = np.array([[0, 1], [0, 2], [0, 3], [0, 4], [1, 2], [2, 3], [3, 4], [4, 1]])
_AROUND, _WHOLE = "around the camera", "whole map"

Colors = NDArray[np.uint8]


def load_viser() -> ModuleType:
    """Viser, which serves the page; a ModuleNotFoundError says how to install it."""
    try:
        import viser
    except ModuleNotFoundError as error:
        message = f"needs {error.name}: pip install 'sfmcpp[view]'"
        raise ModuleNotFoundError(message, name=error.name) from None
    module: ModuleType = viser
    return module


class LiveView:
    """A page with points, path, keyframes and the camera of a SLAM run, served during the run.

    Parameters
    ----------
    title : str
        Title of the page.

    Raises
    ------
    ModuleNotFoundError
        If viser is not installed.
    """

    def __init__(self, title: str) -> None:
        viser = load_viser()
        with _without_viser_output():
            self._server = viser.ViserServer(host=_HOST, port=_FIRST_PORT, label=title, verbose=False)
        self._next_s = 0.0
        self._whole = (np.zeros(3), 1.0)
        self._around = (np.zeros(3), 1.0)
        self._turn: FloatArray = np.eye(3)
        self._floor = 0.0
        self._scale: float | None = None
        self._metric = False
        self._add_controls(title)
        self._add_scene()
        self._server.on_client_connect(_stand_back)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://localhost:{self._server.get_port()}"

    @property
    def num_points(self) -> int:
        """Points that the page shows."""
        return len(self._points.points)

    @property
    def due(self) -> bool:
        """Whether it is time for another picture: ten a second, fewer where they would slow the run down."""
        return time.perf_counter() >= self._next_s

    def show(self, result: SlamResult, status: str) -> None:
        """Show the map as it is.

        Parameters
        ----------
        result : SlamResult
            What the run has found so far; nothing of it is kept or changed.
        status : str
            Line of text beside it.
        """
        started = time.perf_counter()
        with self._server.atomic():
            self._status.content = status
            if result.world is not None and result.poses:
                self._show_map(result)
        self._server.flush()
        ended = time.perf_counter()
        self._next_s = started + max(1 / UPDATES_PER_SECOND, (ended - started) / _LARGEST_SHARE)

    def close(self) -> None:
        """Stop serving."""
        with _without_viser_output():
            self._server.stop()

    def _add_controls(self, title: str) -> None:
        gui = self._server.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        gui.set_panel_label(title)
        self._status = gui.add_markdown("waiting for the first frame")
        self._choice = gui.add_dropdown("show", (_AROUND, _WHOLE), initial_value=_AROUND)
        self._choice.on_update(lambda _: self._place())
        self._legend = gui.add_html(_legend())

    def _add_scene(self) -> None:
        scene, camera = self._server.scene, self._server.initial_camera
        scene.set_up_direction("+z")
        camera.position, camera.look_at = _EYE, _LOOKED_AT
        self._grid = scene.add_grid("/grid", infinite_grid=True, cell_color=_GRID, section_color=_GRID)
        self._frame = scene.add_frame("/map", show_axes=False)
        nothing = np.zeros((0, 3), np.float32)
        self._points = scene.add_point_cloud(
            "/map/points", nothing, np.zeros((0, 3), np.uint8), point_shape="circle", precision="float32"
        )
        lines = {"path": (_PATH, 3.0), "keyframes": (_KEYFRAME, 1.0), "camera": (_CAMERA, 2.0)}
        self._lines = {
            name: scene.add_line_segments(
                f"/map/{name}", nothing.reshape(0, 2, 3), color, thickness=width, thickness_units="screen"
            )
            for name, (color, width) in lines.items()
        }
        self._colors = {name: color for name, (color, _) in lines.items()}

    def _show_map(self, result: SlamResult) -> None:
        world = result.world
        assert world is not None
        path = result.trajectory().poses
        keyframes, points = world.poses, world.points[world.known]
        if self._scale is None or result.metric != self._metric:
            self._scale, self._metric = _EXTENT / _distance(points, keyframes), result.metric
        self._turn = view_from_world(keyframes[:1])
        shown = points[:: -(-len(points) // MOST_POINTS) or 1]
        heights = shown @ self._turn[2]
        self._floor = float(np.quantile(heights, _BELOW)) if len(heights) else 0.0
        self._points.colors = _colors_by_height(heights)
        self._points.points = shown
        centres = path[:, :, 3]
        size = _FRUSTUM / self._scale
        some = keyframes[:: -(-len(keyframes) // MOST_KEYFRAMES)]
        self._draw("path", np.stack([centres[:-1], centres[1:]], axis=1))
        self._draw("keyframes", _cameras(some, size))
        self._draw("camera", _cameras(path[-1:], 2 * size))
        low, high = centres.min(axis=0), centres.max(axis=0)
        reach = max(float(np.linalg.norm(high - low)), _EXTENT / self._scale)
        self._around = (centres[-1], self._scale)
        self._whole = ((low + high) / 2, 1.4 * _EXTENT / reach)
        self._place()

    def _draw(self, name: str, segments: FloatArray) -> None:
        handle = self._lines[name]
        handle.colors = np.broadcast_to(np.array(self._colors[name], np.uint8), segments.shape)
        handle.points = segments

    def _place(self) -> None:
        """Bring what is to be looked at to the middle, at its size."""
        centre, scale = self._whole if self._choice.value == _WHOLE else self._around
        cell = _round_length(_CELL / scale)
        with self._server.atomic():
            self._grid.cell_size = self._grid.section_size = cell * scale
            self._grid.position = (0.0, 0.0, scale * (self._floor - float(self._turn[2] @ centre)))
            self._legend.content = _legend(f"grid: {cell:g} {'m' if self._metric else ''}".rstrip())
            self._frame.wxyz = quaternion_from_rotation(self._turn[None])[0]
            self._frame.position = -scale * self._turn @ centre
            # The scale of a frame is that of its axes alone.
            for node in (self._points, *self._lines.values()):
                node.scale = scale
            self._points.point_size = _POINT / scale


def _round_length(least: float) -> float:
    """The first of 1, 2, 5 times a power of ten that is no less."""
    decade = 10.0 ** math.floor(math.log10(least))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= least)


def _stand_back(client: Any) -> None:
    """In a window that is higher than wide, see as much from side to side as a square one does."""
    aspect = float(client.camera.aspect)
    if 0 < aspect < 1:
        with client.atomic():
            client.camera.position = _LOOKED_AT + (_EYE - _LOOKED_AT) / aspect
            client.camera.look_at = _LOOKED_AT


def _legend(grid: str = "") -> str:
    """Legend: meaning of the colours, and what is said of the grid once there is a map."""
    ramp = ", ".join(f"rgb({r:.0f},{g:.0f},{b:.0f})" for r, g, b in _RAMP)
    bars = {"path": _PATH, "keyframes": _KEYFRAME, "camera": _CAMERA}
    looks = {name: f"rgb{color}" for name, color in bars.items()}
    looks["points, low to high"] = f"linear-gradient(90deg, {ramp})"
    bar = (
        '<span style="display:inline-block;width:22px;height:4px;margin:0 8px 3px 0;background:{}"></span>{}'
    )
    rows = [bar.format(look, name) for name, look in looks.items()]
    return f'<div style="padding:0 12px">{"<br>".join([*rows, grid])}</div>'


def _without_viser_output() -> contextlib.AbstractContextManager[object]:
    """Viser prints its address and its good-bye; standard output is for results."""
    return contextlib.redirect_stdout(io.StringIO())


def _distance(points: FloatArray, keyframes: FloatArray) -> float:
    """How far the points are from the last keyframe in the median."""
    if not len(points):
        return 1.0
    return float(np.median(np.linalg.norm(points - keyframes[-1, :, 3], axis=1))) or 1.0


def _cameras(poses: FloatArray, size: float) -> FloatArray:
    """Lines (8 n, 2, 3) of n cameras."""
    corners = poses[:, None, :, 3] + size * _CORNERS @ poses[:, :, :3].transpose(0, 2, 1)
    return np.asarray(corners[:, _EDGES].reshape(-1, 2, 3))


def _colors_by_height(heights: FloatArray) -> Colors:
    if not len(heights):
        return np.zeros((0, 3), np.uint8)
    low, high = np.quantile(heights, [0.03, 0.97])
    share = np.clip((heights - low) / (high - low if high > low else 1.0), 0, 1) * (len(_RAMP) - 1)
    steps = np.arange(len(_RAMP))
    return np.stack([np.interp(share, steps, channel) for channel in _RAMP.T], axis=1).astype(np.uint8)
