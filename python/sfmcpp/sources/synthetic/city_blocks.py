"""A vehicle that drives through a city, for as many cameras as wanted."""

from __future__ import annotations

from itertools import count

from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.sources.synthetic.image_geometry import NO_DISTORTION, Distortion
from sfmcpp.sources.synthetic.street_drive import street_drive


@checked()
def city_blocks_scene(
    num_cameras: int = 1000,
    num_points: int | None = None,
    *,
    spacing_m: float = 3.0,
    block_m: float = 100.0,
    street_m: float = 14.0,
    max_depth_m: float = 100.0,
    focal_px: float = 500.0,
    image_size: tuple[int, int] = (1024, 768),
    pixel_sigma_px: float = 1.0,
    camera_model: str = "bal",
    distortion: Distortion = NO_DISTORTION,
    seed: int = 0,
) -> Problem:
    """A vehicle that drives all streets of a square city: problems of any size with track lengths like BAL's.

    It drives row by row, then column by column, looking ahead, until it has taken its images; the city grows
    with the number of images. The path crosses itself at every crossing. Points are on the house fronts along
    the path. Each is visible up to its own depth, drawn from a truncated Pareto distribution such that the
    track lengths are distributed as in BAL's Ladybug: most are two or three, a few are dozens. Houses occlude
    what is behind them. Time and memory grow linearly with the cameras.

    Parameters
    ----------
    num_cameras : int
        Images taken; at least two.
    num_points : int, optional
        Points placed on the fronts; those that fewer than two cameras see are dropped. Default: 100 per
        camera.
    spacing_m : float
        From one image to the next [m].
    block_m : float
        From one street's axis to the next [m].
    street_m : float
        Width of the streets [m]; less than `block_m`.
    max_depth_m : float
        Depth beyond which no point is recognised [m]; it bounds the longest tracks.
    focal_px, image_size, pixel_sigma_px, camera_model, distortion, seed
        As for :func:`circle_scene`.

    Returns
    -------
    Problem
        Its cameras and points are the truth; see :func:`perturb` for a start away from it. Every camera
        stays; one of narrow view may see nothing while it turns at a corner.

    Raises
    ------
    InvalidArgument
        If a count is too low or no point is seen twice, a length is not positive, a street wider than a
        block, `max_depth_m` too small for any front to come into view, the camera model unknown, or if the
        distortion does not fit it.
    """
    return street_drive(
        _crossings,
        num_cameras,
        num_points,
        spacing_m=spacing_m,
        block_m=block_m,
        street_m=street_m,
        max_depth_m=max_depth_m,
        focal_px=focal_px,
        image_size=image_size,
        pixel_sigma_px=pixel_sigma_px,
        camera_model=camera_model,
        distortion=distortion,
        seed=seed,
    )


def _crossings(blocks: float) -> list[tuple[int, int]]:
    """The way through the smallest square city in which it is at least so many blocks long."""
    size = next(size for size in count(1) if 2 * size * (size + 2) >= blocks)
    rows = [(x if y % 2 == 0 else size - x, y) for y in range(size + 1) for x in range(size + 1)]
    end, _ = rows[-1]
    columns = [(slow if end == 0 else size - slow, size - fast) for fast, slow in rows]
    return rows + columns[1:]
