"""Faults put into sound problems, and what they are called."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sfmcpp import ConstraintGroup, Problem, add_outliers
from sfmcpp.geometry.so3 import quaternion_from_rotation, rotation_from_quaternion
from sfmcpp.sources.synthetic.circle_and_sphere import UP, looking_at
from sfmcpp.sources.synthetic.image_geometry import ImageGeometry
from sfmcpp.sources.synthetic.observation import observe

Random = np.random.Generator
Broken = tuple[Problem, Sequence[ConstraintGroup]]


@dataclass(frozen=True)
class Fault:
    """How to break a problem, and the findings that name it right."""

    name: str
    codes: tuple[str, ...]
    inject: Callable[[Problem, Random], Problem | Broken]
    # Models whose problems can have it.
    models: tuple[str, ...] = ("calibrated", "perspective", "bal")

    def broken(self, problem: Problem, seed: int) -> Broken:
        result = self.inject(problem.copy(), np.random.default_rng(seed))
        return (result, []) if isinstance(result, Problem) else result


def append(problem: Problem, cameras: NDArray, points: NDArray, pixels: NDArray) -> Problem:
    return replace(
        problem,
        camera_index=np.concatenate([problem.camera_index, cameras]),
        point_index=np.concatenate([problem.point_index, points]),
        pixels=np.concatenate([problem.pixels, pixels]),
        sigma_px=None,
        covariance_px2=None,
    )


def repeated_observations(p: Problem, rng: Random) -> Problem:
    rows = rng.choice(p.num_observations, 20, replace=False)
    return append(p, p.camera_index[rows], p.point_index[rows], p.pixels[rows])


def joined_tracks(p: Problem, rng: Random) -> Problem:
    """Two points of one image become one."""
    camera = int(p.camera_index[0])
    a, b = rng.choice(p.point_index[p.camera_index == camera], 2, replace=False)
    return replace(p, point_index=np.where(p.point_index == b, a, p.point_index))


def image_given_twice(p: Problem, rng: Random) -> Problem:
    camera = int(rng.choice(np.unique(p.camera_index)))
    rows = np.flatnonzero(p.camera_index == camera)
    row = p.intrinsics_index[camera]
    twice = replace(
        p,
        cameras=np.concatenate([p.cameras, p.cameras[[camera]]]),
        intrinsics=np.concatenate([p.intrinsics, p.intrinsics[[row]]]),
        intrinsics_index=np.concatenate([p.intrinsics_index, [len(p.intrinsics)]]),
        fixed_cameras=None,
        fixed_intrinsics=np.concatenate([p.fixed_intrinsics, p.fixed_intrinsics[[row]]]),
    )
    return append(twice, np.full(len(rows), p.num_cameras), p.point_index[rows], p.pixels[rows])


def points_given_twice(p: Problem, rng: Random) -> Problem:
    copied = np.flatnonzero(rng.uniform(size=p.num_points) < 0.3)
    new = np.full(p.num_points, -1)
    new[copied] = p.num_points + np.arange(len(copied))
    rows = np.flatnonzero(new[p.point_index] >= 0)
    twice = replace(p, points=np.concatenate([p.points, p.points[copied]]), fixed_points=None)
    return append(twice, p.camera_index[rows], new[p.point_index[rows]], p.pixels[rows])


def halves(p: Problem, kept: int) -> Problem:
    """Cut between two sets of cameras: each point is seen from one side only, but for `kept` of them."""
    second = p.camera_index >= p.num_cameras // 2
    views = np.stack([np.bincount(p.point_index, s, p.num_points) for s in (~second, second)])
    side = np.where(views.min(axis=0) > 0, np.arange(p.num_points) % 2, np.argmax(views, axis=0))
    joining = np.flatnonzero((views >= 2).all(axis=0))[:kept]
    rows = (side[p.point_index] == second) | np.isin(p.point_index, joining)
    return p.with_observations(rows)


def camera_of_few(p: Problem, rng: Random) -> Problem:
    camera = int(rng.choice(np.flatnonzero(np.bincount(p.camera_index) > 12)))
    rows = np.flatnonzero(p.camera_index == camera)
    keep = np.ones(p.num_observations, dtype=bool)
    keep[rng.permutation(rows)[4:]] = False
    return p.with_observations(keep)


def intrinsics_of_observations(p: Problem) -> NDArray:
    rows = p.intrinsics[p.intrinsics_index[p.camera_index]]
    if p.camera_model == "bal":
        return np.column_stack([rows[:, 0], np.ones(len(rows)), np.zeros((len(rows), 3))])
    return rows[:, :5]


def mirrored_y(p: Problem, rng: Random) -> Problem:
    return replace(
        p, pixels=np.column_stack([p.pixels[:, 0], 2 * intrinsics_of_observations(p)[:, 3] - p.pixels[:, 1]])
    )


def mirrored_x(p: Problem, rng: Random) -> Problem:
    return replace(
        p, pixels=np.column_stack([2 * intrinsics_of_observations(p)[:, 2] - p.pixels[:, 0], p.pixels[:, 1]])
    )


def normalised_pixels(p: Problem, rng: Random) -> Problem:
    k = intrinsics_of_observations(p)
    return replace(p, pixels=(p.pixels - k[:, 2:4]) / k[:, :1])


def with_poses(p: Problem, rotations: NDArray, centres: NDArray) -> Problem:
    return replace(p, cameras=np.concatenate([rotations, centres[:, :, None]], axis=2))


def inverse_poses(p: Problem, rng: Random) -> Problem:
    turned = np.swapaxes(p.rotations, 1, 2)
    return with_poses(p, turned, -np.einsum("cij,cj->ci", turned, p.centres))


def translations(p: Problem, rng: Random) -> Problem:
    return with_poses(p, p.rotations, -np.einsum("cji,cj->ci", p.rotations, p.centres))


def centres_for_translations(p: Problem, rng: Random) -> Problem:
    return with_poses(p, p.rotations, -np.einsum("cij,cj->ci", p.rotations, p.centres))


def quaternions_xyzw(p: Problem, rng: Random) -> Problem:
    turned = np.swapaxes(p.rotations, 1, 2)
    vectors = np.einsum("cij,cj->ci", turned, p.centres)
    wrong = rotation_from_quaternion(quaternion_from_rotation(turned)[:, [1, 2, 3, 0]])
    return with_poses(p, np.swapaxes(wrong, 1, 2), np.einsum("cji,cj->ci", wrong, vectors))


def fy_for_aspect(p: Problem, rng: Random) -> Problem:
    p.intrinsics[:, 1] *= p.intrinsics[:, 0]
    return p


def scaled_intrinsics(p: Problem, focal: float, centre: float) -> Problem:
    p.intrinsics[:, 0] *= focal
    p.intrinsics[:, 2:4] *= centre
    p.fixed_intrinsics[:] = True
    return p


def gross_noise(p: Problem, rng: Random) -> Problem:
    return add_outliers(p, 0.1, sigma_px=200.0, seed=int(rng.integers(1000)))[0]


def wrong_anywhere(share: float) -> Callable[[Problem, Random], Problem]:
    def change(p: Problem, rng: Random) -> Problem:
        low, high = p.pixels.min(axis=0), p.pixels.max(axis=0)
        rows = np.flatnonzero(rng.uniform(size=p.num_observations) < share)
        p.pixels[rows] = rng.uniform(low, high, (len(rows), 2))
        return p

    return change


def mixed_up_image(p: Problem, rng: Random) -> Problem:
    camera = int(rng.choice(np.flatnonzero(np.bincount(p.camera_index) > 12)))
    rows = np.flatnonzero(p.camera_index == camera)
    p.pixels[rows] = p.pixels[np.roll(rows, len(rows) // 2)]
    return p


def mixed_up_points(p: Problem, rng: Random) -> Problem:
    """The points of every image in an order of their own."""
    order = np.lexsort((rng.uniform(size=p.num_observations), p.camera_index))
    by_camera = np.argsort(p.camera_index, kind="stable")
    p.pixels[by_camera] = p.pixels[order]
    return p


def turned_around(p: Problem, rng: Random) -> Problem:
    cameras = rng.choice(np.unique(p.camera_index), max(1, p.num_cameras // 10), replace=False)
    p.rotations[cameras] = p.rotations[cameras] @ np.diag([-1.0, 1.0, -1.0])
    return p


def points_beyond(p: Problem, rng: Random) -> Problem:
    """Some points at the other side of a camera that sees them."""
    rows = rng.choice(p.num_observations, max(3, p.num_points // 10), replace=False)
    centres = p.centres[p.camera_index[rows]]
    p.points[p.point_index[rows]] = 3 * centres - 2 * p.points[p.point_index[rows]]
    return p


def in_units(factor: float) -> Callable[[Problem, Random], Problem]:
    def scale(p: Problem, rng: Random) -> Problem:
        p.centres[:] *= factor
        p.points *= factor
        return p

    return scale


def far_away(p: Problem, rng: Random) -> Problem:
    offset = np.array([4.5e7, 5.1e8, 3e2])
    p.centres[:] += offset
    p.points += offset
    return p


def one_place(p: Problem, rng: Random) -> Problem:
    p.centres[:] = p.centres[0]
    return p


def positions_on_a_line(p: Problem, rng: Random) -> Broken:
    return p, [ConstraintGroup("position", [0, 1], p.centres[:2].copy())]


def not_a_number(p: Problem, rng: Random) -> Problem:
    p.points[int(rng.integers(p.num_points)), 1] = np.nan
    return p


def left_handed(p: Problem, rng: Random) -> Problem:
    p.rotations[:] = p.rotations * np.array([1.0, 1.0, -1.0])
    return p


def out_of_range(p: Problem, rng: Random) -> Problem:
    p.point_index[-1] = p.num_points
    return p


def too_few(p: Problem, rng: Random) -> Problem:
    return p.with_observations(np.arange(8))


def wrong_sigmas(p: Problem, rng: Random) -> Problem:
    return replace(p, sigma_px=np.full(p.num_observations, 0.01), covariance_px2=None)


def photographed(
    p: Problem, cameras: NDArray, points: NDArray, rng: Random, sigma_px: float = 0.5
) -> Problem:
    """The same kind of cameras at other poses, in front of other points."""
    focal = float(np.median(p.intrinsics[:, 0]))
    size = (2000, 1500) if focal > 900 else (1400, 1000)
    return observe(ImageGeometry(p.camera_model, focal, size, (0.0, 0.0)), cameras, points, sigma_px, rng)


def only_turning(p: Problem, rng: Random) -> Problem:
    angles = np.radians(np.linspace(-15, 15, 12))
    targets = 10 * np.stack([np.cos(angles), np.sin(angles), np.zeros(12)], axis=1)
    cameras = np.stack([looking_at(np.zeros((1, 3)), target, UP)[0] for target in targets])
    found = photographed(p, cameras, rng.uniform([8, -4, -3], [20, 4, 3], (300, 3)), rng)
    found.centres[:] += rng.normal(0, 0.3, (12, 3))
    return found


def flat_wall(p: Problem, rng: Random) -> Problem:
    """Cameras that face a wall from several distances, all of them squarely; each has its focal length."""
    points = np.column_stack([np.full(300, 10.0), rng.uniform(-3, 3, 300), rng.uniform(-3, 3, 300)])
    centres = rng.uniform([-2, -1, -1], [2, 1, 1], (8, 3))
    cameras = np.stack([looking_at(c[None], c + np.array([10.0, 0.0, 0.0]), UP)[0] for c in centres])
    return photographed(p, cameras, points, rng).set_free_intrinsics("f")


def all_one_way(p: Problem, rng: Random) -> Problem:
    """Cameras that move without turning."""
    points = rng.uniform([9, -3, -3], [11, 3, 3], (100, 3))
    centres = rng.uniform([-0.5, -1, -1], [0.5, 1, 1], (6, 3))
    cameras = np.stack([looking_at(c[None], c + np.array([10.0, 0.0, 0.0]), UP)[0] for c in centres])
    return photographed(p, cameras, points, rng, 1.0).set_free_intrinsics("f")


def far_points(p: Problem, rng: Random) -> Problem:
    points = rng.uniform([4e4, -2e4, -2e4], [8e4, 2e4, 2e4], (400, 3))
    near = rng.uniform([20, -8, -8], [40, 8, 8], (80, 3))
    centres = rng.uniform([-1, -5, -2], [1, 5, 2], (10, 3))
    cameras = np.stack([looking_at(c[None], c + np.array([10.0, 0.3 * c[1], 0.0]), UP)[0] for c in centres])
    return photographed(p, cameras, np.concatenate([points, near]), rng)


def telephoto(p: Problem, rng: Random) -> Problem:
    """A principal point through a lens so long that turning the camera does the same."""
    centres = 60 * np.stack([np.cos(a := np.linspace(0, 6, 12)), np.sin(a), np.zeros(12)], axis=1)
    geometry = ImageGeometry(p.camera_model, 2e4, (640, 480), (0.0, 0.0))
    points = rng.uniform(-0.6, 0.6, (200, 3))
    seen = observe(geometry, looking_at(centres, np.zeros(3), UP), points, 0.5, rng)
    return seen.set_free_intrinsics("f", "cx", "cy")


def point_in_a_camera(p: Problem, rng: Random) -> Problem:
    row = int(rng.integers(p.num_observations))
    p.points[p.point_index[row]] = p.centres[p.camera_index[row]]
    return p


PIXEL_ORIGIN = ("calibrated", "perspective")
FAULTS = (
    Fault("repeated observations", ("duplicate-observations",), repeated_observations),
    Fault("two tracks joined", ("duplicate-observations",), joined_tracks),
    Fault("a point in a camera", ("no-image",), point_in_a_camera),
    Fault("an image given twice", ("duplicate-cameras",), image_given_twice),
    Fault("points given twice", ("duplicate-points",), points_given_twice),
    Fault("two parts", ("disconnected-parts",), lambda p, rng: halves(p, 0)),
    Fault("two parts joined by two points", ("weak-link",), lambda p, rng: halves(p, 2)),
    Fault("two parts joined by four points", ("weak-link",), lambda p, rng: halves(p, 4)),
    Fault("a camera of four points", ("weak-cameras",), camera_of_few),
    Fault("y up", ("mirrored-y",), mirrored_y),
    Fault("x mirrored", ("mirrored-x",), mirrored_x),
    Fault("rows and columns", ("swapped-pixels",),
          lambda p, rng: replace(p, pixels=p.pixels[:, ::-1].copy())),
    Fault("pixels from the centre", ("centred-pixels",),
          lambda p, rng: replace(p, pixels=p.pixels - intrinsics_of_observations(p)[:, 2:4]), PIXEL_ORIGIN),
    Fault("pixels from a corner", ("corner-pixels",),
          lambda p, rng: replace(p, pixels=p.pixels - p.pixels.min(axis=0)), ("bal",)),
    Fault("pixels at depth one", ("normalised-pixels",), normalised_pixels),
    Fault("fy for the aspect", ("fy-for-aspect",), fy_for_aspect, PIXEL_ORIGIN),
    Fault("axes of OpenGL", ("axes-of-opengl",),
          lambda p, rng: with_poses(p, p.rotations * np.array([1.0, -1.0, -1.0]), p.centres)),
    Fault("camera from world", ("inverse-poses",), inverse_poses),
    Fault("rotations transposed", ("transposed-rotations",),
          lambda p, rng: with_poses(p, np.swapaxes(p.rotations, 1, 2), p.centres)),
    Fault("translations for centres", ("translations-for-centres",), translations),
    Fault("centres for translations", ("centres-for-translations",), centres_for_translations),
    Fault("quaternions x y z w", ("quaternions-xyzw",), quaternions_xyzw),
    # On a circle seen from its plane, points turned over are images turned over.
    Fault("a left-handed world", ("mirrored-world", "mirrored-y"),
          lambda p, rng: replace(p, points=p.points * [1.0, 1.0, -1.0])),
    Fault("left-handed rotations", ("invalid-array",), left_handed),
    Fault("a focal length 1.3 times as long", ("wrong-focal",),
          lambda p, rng: scaled_intrinsics(p, 1.3, 1.0), PIXEL_ORIGIN),
    Fault("a focal length in mm", ("short-focal",), lambda p, rng: scaled_intrinsics(p, 0.02, 1.0)),
    Fault("K of an image twice as large", ("calibration-of-another-size", "principal-point-off-middle"),
          lambda p, rng: scaled_intrinsics(p, 2.0, 2.0), PIXEL_ORIGIN),
    Fault("K of an image half as large", ("calibration-of-another-size", "principal-point-off-middle"),
          lambda p, rng: scaled_intrinsics(p, 0.5, 0.5), PIXEL_ORIGIN),
    Fault("principal point of a larger image", ("wrong-principal-point", "principal-point-off-middle"),
          lambda p, rng: scaled_intrinsics(p, 1.0, 1.6), PIXEL_ORIGIN),
    Fault("outliers anywhere", ("outliers",), wrong_anywhere(0.05)),
    Fault("outliers of 200 px", ("outliers",), gross_noise),
    Fault("more outliers than a robust loss bears", ("outliers",), wrong_anywhere(0.4)),
    Fault("an image of other points", ("camera-contradicts",), mixed_up_image),
    Fault("points mixed up everywhere", ("poor-fit",), mixed_up_points),
    Fault("cameras turned around", ("cameras-look-away",), turned_around),
    Fault("points beyond their cameras", ("points-behind", "cameras-look-away"), points_beyond),
    Fault("units too small", ("units",), in_units(1e8)),
    Fault("units too large", ("units",), in_units(1e-8)),
    Fault("far from the origin", ("far-from-origin",), far_away),
    Fault("all cameras at one place", ("no-baseline",), one_place),
    Fault("a camera that only turns", ("pure-rotation",), only_turning),
    # Cameras that face a wall squarely do not turn either.
    Fault("a wall seen squarely", ("planar-focal", "parallel-views"), flat_wall, ("perspective",)),
    Fault("a camera that never turns", ("parallel-views",), all_one_way, ("perspective",)),
    Fault("nearly all points far away", ("small-angles",), far_points, ("calibrated",)),
    Fault("a principal point through a telephoto lens", ("undetermined-intrinsics",),
          telephoto, ("perspective",)),
    Fault("two positions for a world", ("gauge-freedoms",), positions_on_a_line),
    Fault("sigmas a hundredth", ("wrong-sigmas",), wrong_sigmas),
    Fault("not a number", ("invalid-array",), not_a_number),
    Fault("index out of range", ("invalid-array",), out_of_range),
    Fault("fewer residuals than unknowns", ("unsolvable",), too_few),
)  # fmt: skip
