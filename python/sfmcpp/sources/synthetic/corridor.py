"""A camera that walks down a corridor."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import Problem, Rigs
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_count, require_positive
from sfmcpp.sources.synthetic.image_geometry import NO_DISTORTION, UP, Distortion, ImageGeometry, looking_at
from sfmcpp.sources.synthetic.observation import keep_points_seen_twice, observe
from sfmcpp.sources.synthetic.sight import Sight

FORWARD = np.array([1.0, 0.0, 0.0])
"""World direction in which the corridor runs."""
_EYE_HEIGHT_SHARE = 0.6
_SENSORS = 3
_SWAY_RAD = 0.1
_DOWN = np.array([0.0, 1.0, 0.0])
_CORRIDOR_M = (3.0, 2.5)


@checked()
def corridor_scene(
    num_cameras: int = 60,
    num_points: int = 4000,
    *,
    length_m: float = 60.0,
    width_m: float = 3.0,
    height_m: float = 2.5,
    max_depth_m: float = 8.0,
    focal_px: float = 500.0,
    image_size: tuple[int, int] = (640, 480),
    pixel_sigma_px: float = 1.0,
    camera_model: str = "calibrated",
    distortion: Distortion = NO_DISTORTION,
    seed: int = 0,
) -> Problem:
    """A camera carried along a corridor, looking forward: a long chain of short tracks without a loop.

    The walk goes along x from the origin of the floor, y is left and z up. Points lie on both walls, the
    floor and the ceiling, which reach `max_depth_m` beyond the end of the walk.

    Parameters
    ----------
    num_cameras : int
        Images taken, evenly spaced; at least two.
    num_points : int
        Points placed; those that fewer than two cameras see are dropped.
    length_m : float
        Way from the first camera to the last [m].
    width_m, height_m : float
        Cross-section of the corridor [m]; the camera walks in the middle, at 0.6 of the height.
    max_depth_m : float
        Depth beyond which a camera sees nothing [m]; it bounds the length of the tracks.
    focal_px, image_size, pixel_sigma_px, camera_model, distortion, seed
        As for :func:`circle_scene`.

    Returns
    -------
    Problem
        Its cameras and points are the truth; see :func:`perturb` for a start away from it.

    Raises
    ------
    InvalidArgument
        If a count is too low or no point is seen twice, a length is not positive, the camera model is
        unknown or the distortion does not fit it.
    """
    require_count("num_cameras", num_cameras, at_least=2)
    require_count("num_points", num_points)
    lengths = {"length_m": length_m, "width_m": width_m, "height_m": height_m, "max_depth_m": max_depth_m}
    for name, value in lengths.items():
        require_positive(name, value)
    geometry = ImageGeometry(camera_model, focal_px, image_size, distortion)
    rng = np.random.default_rng(seed)
    centres = walk(num_cameras, length_m, height_m)
    cameras = looking_at(centres, centres + FORWARD, UP)
    points = corridor_points(num_points, length_m + max_depth_m, width_m, height_m, rng)
    return keep_points_seen_twice(observe(geometry, cameras, points, pixel_sigma_px, rng, Sight(max_depth_m)))


def walk(count: int, length_m: float, height_m: float) -> FloatArray:
    """(count, 3) places along the middle of a corridor of that height, evenly spaced."""
    along_m = np.linspace(0, length_m, count)
    return np.stack([along_m, np.zeros(count), np.full(count, _EYE_HEIGHT_SHARE * height_m)], axis=1)


def corridor_points(
    count: int, length_m: float, width_m: float, height_m: float, rng: np.random.Generator
) -> FloatArray:
    """(count, 3) points, uniform on walls, floor and ceiling."""
    along_m = rng.uniform(0, length_m, count)
    return np.column_stack([along_m, _on_section(count, width_m, height_m, rng)])


def _on_section(count: int, width_m: float, height_m: float, rng: np.random.Generator) -> FloatArray:
    """(count, 2) left and up: uniform on the outline of the cross-section."""
    outline = np.array([[-1, 0], [1, 0], [1, 1], [-1, 1], [-1, 0]]) * [width_m / 2, height_m]
    corners_m = np.cumsum([0.0, width_m, height_m, width_m, height_m])
    around_m = rng.uniform(0, corners_m[-1], count)
    return np.stack([np.interp(around_m, corners_m, side) for side in outline.T], axis=1)


@checked()
def rig_walk_scene(
    num_cameras: int = 60,
    num_points: int = 4000,
    *,
    length_m: float = 20.0,
    baseline_m: float = 0.3,
    max_depth_m: float = 8.0,
    focal_px: float = 500.0,
    image_size: tuple[int, int] = (640, 480),
    pixel_sigma_px: float = 1.0,
    camera_model: str = "calibrated",
    distortion: Distortion = NO_DISTORTION,
    seed: int = 0,
) -> Problem:
    """A rig of three cameras carried along the corridor of :func:`corridor_scene`, turning slightly.

    Two cameras look forward, turned outwards by 15°; the third looks back, and the corridor begins
    `max_depth_m` before the walk. Cameras are ordered by frame, three per frame: left, right, back. Each
    sensor has its own row of intrinsics.

    Parameters
    ----------
    num_cameras : int
        Images taken; the last frame may lack some.
    num_points : int
        Points placed; those that fewer than two cameras see are dropped.
    length_m : float
        Way from the first frame to the last [m].
    baseline_m : float
        Distance between left and right camera, and from their middle to the one that looks back [m].
    max_depth_m, focal_px, image_size, pixel_sigma_px, camera_model, distortion, seed
        As for :func:`corridor_scene`.

    Returns
    -------
    Problem
        With its `rigs`. Its cameras and points are the truth; see :func:`perturb` for a start away from it.

    Raises
    ------
    InvalidArgument
        As of :func:`corridor_scene`.
    """
    require_count("num_cameras", num_cameras, at_least=2)
    require_count("num_points", num_points)
    for name, value in {"length_m": length_m, "baseline_m": baseline_m, "max_depth_m": max_depth_m}.items():
        require_positive(name, value)
    geometry = ImageGeometry(camera_model, focal_px, image_size, distortion)
    rng = np.random.default_rng(seed)
    frame_of_camera, sensor_of_camera = np.divmod(np.arange(num_cameras, dtype=np.int32), _SENSORS)
    rigs = Rigs(_sensors(baseline_m), frame_of_camera, sensor_of_camera)
    cameras = rigs.cameras(_frames(rigs.num_frames, length_m, rng))
    width_m, height_m = _CORRIDOR_M
    points = corridor_points(num_points, length_m + 2 * max_depth_m, width_m, height_m, rng)
    points -= max_depth_m * FORWARD
    seen = observe(geometry, cameras, points, pixel_sigma_px, rng, Sight(max_depth_m))
    return _with_rigs(keep_points_seen_twice(seen), geometry, rigs)


def _sensors(baseline_m: float) -> FloatArray:
    """The three sensors, in the axes of a frame: x right, y down, z forward."""
    turns = so3.exp(np.deg2rad([-15.0, 15.0, 180.0])[:, None] * _DOWN)
    places = baseline_m * np.array([[-0.5, 0, 0], [0.5, 0, 0], [0, 0, -1.0]])
    return np.concatenate([turns, places[:, :, None]], axis=2)


def _frames(count: int, length_m: float, rng: np.random.Generator) -> FloatArray:
    origins = walk(count, length_m, _CORRIDOR_M[1])
    frames = looking_at(origins, origins + FORWARD, UP)
    frames[:, :, :3] = frames[:, :, :3] @ so3.exp(_SWAY_RAD * rng.standard_normal((count, 1)) * _DOWN)
    return frames


def _with_rigs(seen: Problem, geometry: ImageGeometry, rigs: Rigs) -> Problem:
    return Problem(
        seen.camera_model,
        seen.cameras,
        geometry.intrinsics(rigs.num_sensors),
        seen.points,
        seen.camera_index,
        seen.point_index,
        seen.pixels,
        intrinsics_index=rigs.sensor_of_camera,
        rigs=rigs,
        metadata=seen.metadata,
    )
