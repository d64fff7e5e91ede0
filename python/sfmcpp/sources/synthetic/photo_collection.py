"""A photo collection of a town's landmarks: dense clusters of cameras, weakly linked."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_count, require_not_negative
from sfmcpp.sources.synthetic.image_geometry import NO_DISTORTION, UP, Distortion, ImageGeometry, looking_at
from sfmcpp.sources.synthetic.observation import Views, keep_points_seen_twice, problem_of_views
from sfmcpp.sources.synthetic.streets import track_lengths

_POINTS_PER_CAMERA = 100
# A landmark is the southern half of a round tower; photos show it from so far, and at least so far apart.
_TOWER_RADIUS_M, _TOWER_HEIGHT_M, _RELIEF_M = 8.0, 14.0, 1.5
_NEAREST_M, _USUAL_M, _FARTHEST_M = 14.0, 22.0, 45.0
_PITCH_M = np.array([60.0, 150.0])
_DISTANCE_SIGMA = 0.3
_WIDEST_DEG = 70.0
_AIM_SIGMA_M = 2.0
_EYE_HEIGHT_M = (1.2, 2.2)
# Few photos show two landmarks: two neighbours in a row from the front, two behind each other from a hill.
_LINKS_PER_CAMERA = 0.02
_FEWEST_LINKS = 4
_LINK_FRONT_M, _HILL_M, _HILL_HEIGHT_M = 65.0, 90.0, 45.0
# Most focal lengths are within a factor of 1.3 of the usual one, none beyond two.
_FOCAL_SIGMA = 0.3
_FOCAL_LIMIT = 2.0
# A photo that could show a point does so with this probability.
_MATCHED = 0.6


@checked()
def photo_collection_scene(
    num_cameras: int = 600,
    num_points: int | None = None,
    *,
    cameras_per_landmark: int = 200,
    focal_spread: float = _FOCAL_SIGMA,
    focal_px: float = 800.0,
    image_size: tuple[int, int] = (1024, 768),
    pixel_sigma_px: float = 1.0,
    camera_model: str = "bal",
    distortion: Distortion = NO_DISTORTION,
    seed: int = 0,
) -> Problem:
    """Photos of landmarks by their visitors, each with its own focal length.

    Landmarks stand in rows, so that their number grows with the photos. Each is seen by hundreds of cameras
    in front of it, which makes the Schur complement locally dense; a few cameras that see two landmarks
    connect the clusters. Track lengths are distributed as for :func:`city_blocks_scene`, up to all photos of
    a landmark. Photos that share a point are similar in viewing direction, in the size of the landmark, or in
    lighting. Time and memory grow linearly with the cameras.

    Parameters
    ----------
    num_cameras : int
        Number of photos; at least two.
    num_points : int, optional
        Points placed on the landmarks; those that fewer than two cameras see are dropped. Default: 100 per
        camera.
    cameras_per_landmark : int
        Photos of each landmark; at least two.
    focal_spread : float
        Standard deviation of the logarithm of the focal lengths; none differs from the usual one by more
        than a factor of two.
    focal_px : float
        The usual focal length [px].
    image_size, pixel_sigma_px, camera_model, distortion, seed
        As for :func:`circle_scene`; the distortion must be invertible within the images of half the focal
        length.

    Returns
    -------
    Problem
        Its cameras and points are the truth; see :func:`perturb` for a start away from it, of focal lengths
        too, and :func:`add_outliers` for the wrong matches such collections have. Every camera stays.

    Raises
    ------
    InvalidArgument
        If a count is too low or no point is seen twice, a number is not positive or negative, the camera
        model is unknown or the distortion does not fit it.
    """
    num_points = _POINTS_PER_CAMERA * num_cameras if num_points is None else num_points
    require_count("num_cameras", num_cameras, at_least=2)
    require_count("num_points", num_points)
    require_count("cameras_per_landmark", cameras_per_landmark, at_least=2)
    require_not_negative("focal_spread", focal_spread)
    ImageGeometry(camera_model, focal_px, image_size, distortion)
    widest = ImageGeometry(camera_model, focal_px / _FOCAL_LIMIT, image_size, distortion)
    rng = np.random.default_rng(seed)
    town = _Town(num_cameras, cameras_per_landmark)
    zoom = np.exp(focal_spread * rng.standard_normal(num_cameras)).clip(1 / _FOCAL_LIMIT, _FOCAL_LIMIT)
    zoom[town.is_link] = np.minimum(zoom[town.is_link], 1.0)
    photos = _take_photos(town, zoom, rng)
    counts = np.full(town.num_landmarks, num_points // town.num_landmarks)
    counts[: num_points % town.num_landmarks] += 1
    points, facing = _points_of_towers(np.repeat(town.places, counts, axis=0), rng)
    views = list(_views_of_landmarks(widest, town, photos, zoom, points, facing, counts, rng))
    problem = problem_of_views(widest, photos, points, Views.joined(views), pixel_sigma_px, rng)
    problem.intrinsics[:, problem.intrinsic_names.index("f")] = focal_px * zoom
    return keep_points_seen_twice(problem)


class _Town:
    """Landmarks in rows, and which cameras are where.

    Attributes
    ----------
    places : (L, 3) float64
        Foot of each landmark.
    home : (C,) intp
        The landmark each camera was taken for; that of a link, the nearer or the western one.
    other : (C,) intp
        The second landmark of a link, −1 for all others.
    """

    def __init__(self, num_cameras: int, cameras_per_landmark: int) -> None:
        self.num_landmarks = max(1, round(num_cameras / cameras_per_landmark))
        in_a_row = int(np.ceil(np.sqrt(self.num_landmarks)))
        number = np.arange(self.num_landmarks)
        grid = np.column_stack([number % in_a_row, number // in_a_row])
        self.places = np.column_stack([grid * _PITCH_M, np.zeros(self.num_landmarks)])
        self.home = np.arange(num_cameras) * self.num_landmarks // num_cameras
        self.other = np.full(num_cameras, -1, dtype=np.intp)
        links = max(_FEWEST_LINKS, round(_LINKS_PER_CAMERA * num_cameras / self.num_landmarks))
        for home in number:
            eastern = home + 1 if (home + 1) % in_a_row else self.num_landmarks
            neighbours = [other for other in (eastern, home + in_a_row) if other < self.num_landmarks]
            members = np.flatnonzero(self.home == home)
            for place, other in enumerate(neighbours):
                self.other[members[place * links : (place + 1) * links]] = other

    @property
    def is_link(self) -> BoolArray:
        """(C,) whether a camera sees two landmarks."""
        return np.asarray(self.other >= 0)

    def visitors(self, landmark: int) -> NDArray[np.intp]:
        """The cameras that see a landmark."""
        return np.flatnonzero((self.home == landmark) | (self.other == landmark))


def _take_photos(town: _Town, zoom: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(C, 3, 4) cameras: on the southern side of their landmarks, or where two of them are in sight.

    Who zooms in stands farther away: a landmark takes up about the same part of all images.
    """
    count = len(town.home)
    feet = town.places[town.home]
    angle = np.deg2rad(rng.uniform(-_WIDEST_DEG, _WIDEST_DEG, count))
    far_m = _USUAL_M * zoom * np.exp(_DISTANCE_SIGMA * rng.standard_normal(count))
    far_m = far_m.clip(_NEAREST_M * np.maximum(zoom, 1), _FARTHEST_M)
    aside = np.column_stack([np.sin(angle), -np.cos(angle)])
    height_m = rng.uniform(*_EYE_HEIGHT_M, count)
    centres = feet + np.column_stack([far_m[:, None] * aside, height_m])
    targets = feet + [0.0, 0.0, _TOWER_HEIGHT_M / 2] + _AIM_SIGMA_M * rng.standard_normal((count, 3))
    for camera in np.flatnonzero(town.is_link):
        middle = 0.5 * (town.places[town.home[camera]] + town.places[town.other[camera]])
        in_a_row = middle[1] == feet[camera, 1]
        stand = middle - [0, _LINK_FRONT_M, 0] if in_a_row else feet[camera] + [0, -_HILL_M, _HILL_HEIGHT_M]
        centres[camera] = stand + rng.uniform(-6, 6, 3) * [1, 1, 0] + [0, 0, height_m[camera]]
        targets[camera] = middle + _TOWER_HEIGHT_M / 2 * UP
    return looking_at(centres, targets, UP)


def _points_of_towers(feet: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """(N, 3) a point on the southern half of the tower at each of `feet`, and the direction it faces."""
    count = len(feet)
    angle = rng.uniform(-np.pi / 2, np.pi / 2, count)
    facing = np.column_stack([np.sin(angle), -np.cos(angle), np.zeros(count)])
    out_m = _TOWER_RADIUS_M + rng.uniform(0, _RELIEF_M, count)
    height_m = rng.uniform(0, _TOWER_HEIGHT_M, count)
    return feet + out_m[:, None] * facing + height_m[:, None] * UP, facing


def _views_of_landmarks(
    geometry: ImageGeometry,
    town: _Town,
    photos: FloatArray,
    zoom: FloatArray,
    points: FloatArray,
    facing: FloatArray,
    counts: NDArray[np.intp],
    rng: np.random.Generator,
) -> Iterator[Views]:
    """One landmark after the other: memory is bounded by what one of them has."""
    first = np.cumsum(counts) - counts
    for landmark, count in enumerate(counts):
        visitors = town.visitors(landmark)
        tried = _recognised_points(photos, zoom, visitors, town.places[landmark], int(count), rng)
        point = first[landmark] + tried.point
        yield _visible_pairs(geometry, photos, zoom, points, facing, tried.camera, point)


@dataclass(frozen=True, eq=False)
class _Recognitions:
    """Pairs of a camera and a point of a landmark that are seen if the image shows them."""

    camera: NDArray[np.intp]
    point: NDArray[np.intp]


def _recognised_points(
    photos: FloatArray,
    zoom: FloatArray,
    visitors: NDArray[np.intp],
    foot: FloatArray,
    count: int,
    rng: np.random.Generator,
) -> _Recognitions:
    """Each point is recognised in a run of the visitors, ordered by direction, by size or by light."""
    offset = photos[visitors, :, 3] - foot
    size = zoom[visitors] / np.linalg.norm(offset, axis=1)
    light = rng.uniform(size=len(visitors))
    orders = visitors[np.argsort([np.arctan2(offset[:, 0], -offset[:, 1]), size, light], axis=1)]
    wanted = track_lengths(count, max(len(visitors), 2.0), rng) / _MATCHED
    length = np.minimum(np.ceil(wanted), len(visitors)).astype(np.intp)
    start = (rng.integers(0, len(visitors), count) - length // 2).clip(0, len(visitors) - length)
    order = rng.integers(0, len(orders), count)
    point = np.repeat(np.arange(count), length)
    step = np.arange(len(point)) - np.repeat(np.cumsum(length) - length, length)
    matched = rng.uniform(size=len(point)) < _MATCHED
    camera = orders[order[point], start[point] + step]
    return _Recognitions(camera[matched], point[matched])


def _visible_pairs(
    geometry: ImageGeometry,
    photos: FloatArray,
    zoom: FloatArray,
    points: FloatArray,
    facing: FloatArray,
    camera: NDArray[np.intp],
    point: NDArray[np.intp],
) -> Views:
    """Pairs of a camera and a point that faces it and falls into its image."""
    way = points[point] - photos[camera, :, 3]
    x, y, depth = np.einsum("mi,mij->jm", way, photos[camera, :, :3])
    ahead = np.flatnonzero((depth > 0) & (np.einsum("mi,mi->m", way, facing[point]) < 0))
    camera, point = camera[ahead], point[ahead]
    tangents = np.stack([x[ahead], y[ahead]], axis=1) / depth[ahead, None]
    offset_px, unfolded = geometry.image(tangents)
    # The geometry is that of the shortest focal length; a longer one magnifies the same image.
    offset_px *= (_FOCAL_LIMIT * zoom[camera])[:, None]
    kept = geometry.contains(offset_px) & unfolded
    by_camera = np.flatnonzero(kept)
    return Views(
        camera[by_camera].astype(np.int32),
        point[by_camera].astype(np.int32),
        offset_px[by_camera] + geometry.principal_point_px,
    )
