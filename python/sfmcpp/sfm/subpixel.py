"""Subpixel refinement of observations by alignment of image patches.

A blob is found in every photo for itself, and its place differs by parts of a pixel from photo to photo. With
poses and points known, the model predicts how the surroundings of a point in one photo look in another: by
the plane through the points near it, as an affine map of the image. The patch round the keypoint in one
photo, the reference, is looked for in the others, which differ from the prediction by a shift alone. The
keypoint of the reference says which point is meant, and stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry.pinhole import unit
from sfmcpp.geometry.point_tests import projected_points
from sfmcpp.geometry.surface import surface_normals, surface_slopes
from sfmcpp.map import LocalProblem, Map
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.model.checks import require_count, require_positive, require_share
from sfmcpp.model.photos import Photo
from sfmcpp.model.threads import Progress, no_progress, results_in_order, thread_count
from sfmcpp.sources.vision import one_opencv_thread
from sfmcpp.sources.vision.patches import PatchAlignment, align_patches, grey_pyramid, sample_patches

Numbers = NDArray[np.intp]

# Of an image of a patch over its area in the reference: less is seen from the side, or from behind.
_LEAST_AREA = 0.05
Templates = NDArray[np.float32]
# Templates of so many points are kept at a time: 60 MB for each size of patches.
_POINTS_AT_ONCE = 50_000
# A photo in grey with its smaller copies takes 130 MB where it has 24 megapixels.
_MOST_READERS = 8


@dataclass(frozen=True, eq=False)
class PatchPlaces:
    """Patches of N points in M observations.

    Attributes
    ----------
    reference : (N,) int
        Observation of each point whose keypoint tells which point is meant: its ray is nearest to the mean.
    pixels : (M, 2) float64
        Centres [px]: in the reference the keypoint, elsewhere what the model predicts of it.
    maps : (M, 2, 2) float64
        Derivatives of the position with respect to that in the reference; not a number where the patch is not
        seen from its front.
    spacings : (N,) float64
        Distance of samples in the reference [px], where all of what was detected is in the patch.
    """

    reference: Numbers
    pixels: FloatArray
    maps: FloatArray
    spacings: FloatArray

    @classmethod
    def of(cls, world: Map, local: LocalProblem, step_per_scale: float) -> PatchPlaces:
        """Places in the images of the points of `local`; the distance of samples is a pixel at least."""
        problem = local.problem
        towards, reference = _reference_views(problem)
        slopes = surface_slopes(problem, surface_normals(problem.points, towards))
        maps = slopes @ inverses(slopes[reference])[problem.point_index]
        maps[~(determinants(maps) >= _LEAST_AREA)] = np.nan
        predicted = projected_points(problem, problem.points)
        meant = (problem.pixels - predicted)[reference]
        pixels = predicted + np.einsum("mij,mj->mi", maps, meant[problem.point_index])
        spacings = np.fmax(1.0, step_per_scale * world.keypoint_scales[local.rows[reference]])
        return cls(reference, pixels, maps, spacings)


def _reference_views(problem: Problem) -> tuple[FloatArray, Numbers]:
    """Mean direction (N, 3) from each point to its cameras, and the observation (N,) nearest to it."""
    index = problem.point_index
    rays = unit(problem.centres[problem.camera_index] - problem.points[index])
    towards = unit(np.stack([np.bincount(index, ray, problem.num_points) for ray in rays.T], axis=1))
    cosines = (rays * towards[index]).sum(axis=1)
    order = np.lexsort((-cosines, index))
    first = np.searchsorted(index[order], np.arange(problem.num_points))
    return towards, np.asarray(order[first], dtype=np.intp)


def determinants(matrices: FloatArray) -> FloatArray:
    """Determinants (n,) of matrices (n, 2, 2)."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, -1)
    return np.asarray(a * d - b * c)


def inverses(matrices: FloatArray) -> FloatArray:
    """Inverses of matrices (n, 2, 2); infinite or not a number where there is none."""
    (a, b), (c, d) = np.moveaxis(matrices, 0, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.moveaxis(np.array([[d, -b], [-c, a]]) / determinants(matrices), -1, 0))


@dataclass(frozen=True)
class SubpixelSettings:
    """Settings of patches and of the acceptance of their alignment.

    Attributes
    ----------
    radius : int
        Samples of a patch on each side of its centre.
    step_per_scale : float
        Distance of samples over the scale of the keypoint, at first; it is halved down to a pixel as long as
        the smaller patches are to be trusted.
    min_correlation : float
        Least correlation of a patch with the reference.
    max_shift : float
        Farthest from where the model predicts it, and then from where the larger patch was, in samples.
    max_sigma : float
        Largest standard deviation of the place, in samples: patches without texture have more.
    sigma_px : float
        Standard deviation of what was aligned [px]. What it is by the noise of grey levels is much less, but
        surfaces that are not flat move patches, all of them alike.
    covariances : bool
        Whether that noise counts too, as a covariance of each keypoint.
    """

    radius: int = 7
    step_per_scale: float = 0.5
    min_correlation: float = 0.8
    max_shift: float = 1.0
    max_sigma: float = 0.25
    sigma_px: float = 0.15
    covariances: bool = False

    def __post_init__(self) -> None:
        require_count("radius", self.radius, 2)
        for name in ("step_per_scale", "max_shift", "max_sigma", "sigma_px"):
            require_positive(name, getattr(self, name))
        require_share("min_correlation", self.min_correlation)


@dataclass(frozen=True)
class SubpixelOutcome:
    """Result of the subpixel refinement of the observations of a model.

    Attributes
    ----------
    observations : int
        Observations of the model.
    refined : int
        Those that were moved; of every point one more stays, to which they refer.
    points : int
        Points that have such.
    median_shift_px : float
        How far they were moved, in the median; not a number if there is none.
    """

    observations: int
    refined: int
    points: int
    median_shift_px: float


def refine_tracks(
    world: Map,
    photos: Sequence[Photo],
    settings: SubpixelSettings | None = None,
    *,
    threads: int | None = None,
    progress: Progress = no_progress,
) -> SubpixelOutcome:
    """Move the keypoints that see points to where patches of the photos agree; poses and points stay.

    Parameters
    ----------
    world : Map
        A model. Its :attr:`keypoints` and their :attr:`keypoint_covariances` are changed; an adjustment is
        to follow.
    photos : sequence of Photo
        Of each image of it. Observations in photos without a file stay.
    settings : SubpixelSettings, optional
        Sizes and limits.
    threads : int, optional
        Threads at most; the result does not depend on it. Default: as many as the machine has.
    progress : callable
        Called as ``progress("refining", done, total)``; returning True asks to stop.

    Returns
    -------
    SubpixelOutcome
        How many were moved, and how far.

    Raises
    ------
    DatasetError
        If a photo cannot be decoded; nothing is changed then.
    KeyboardInterrupt
        If `progress` asked to stop; nothing is changed then.
    """
    chosen, local = settings or SubpixelSettings(), world.whole_problem(2)
    work = _Work.of(world, local, photos, chosen)
    with one_opencv_thread():
        portions = range(0, local.problem.num_points, _POINTS_AT_ONCE)
        for k, begin in enumerate(portions):
            end = min(begin + _POINTS_AT_ONCE, local.problem.num_points)
            work.run(begin, end, thread_count(threads), _partial_progress(progress, k, len(portions)))
    shifts = np.linalg.norm(work.found - local.problem.pixels, axis=1)[work.moved]
    points = np.unique(local.problem.point_index[work.moved])
    world.keypoints[local.rows] = work.found
    _set_covariances(world, local, work, points)
    median = float(np.median(shifts)) if len(shifts) else float("nan")
    return SubpixelOutcome(len(local.rows), len(shifts), len(points), median)


def _partial_progress(progress: Progress, part: int, parts: int) -> Progress:
    """Progress of one of several equal parts, reported as that of the whole."""
    return lambda stage, done, total: progress(stage, part * total + done, parts * total)


def _set_covariances(world: Map, local: LocalProblem, work: _Work, points: NDArray[np.integer]) -> None:
    """Set the covariances of keypoints that have moved, and of those that these refer to."""
    same = work.settings.sigma_px**2 * np.array([1.0, 0.0, 1.0])
    own = work.covariances[work.moved] if work.settings.covariances else 0.0
    world.keypoint_covariances[local.rows[work.moved]] = same + own
    world.keypoint_covariances[local.rows[work.places.reference[points]]] = same


@dataclass(frozen=True, eq=False)
class _Work:
    """Patches of a model. Every photo is read twice: for its templates, and for what is aligned to others'.

    Attributes
    ----------
    found : (M, 2) float64
        Where each observation is now [px].
    covariances : (M, 3) float64
        Of those that have moved [px²].
    moved : (M,) bool
        Which have.
    """

    local: LocalProblem
    photos: list[Photo]
    settings: SubpixelSettings
    places: PatchPlaces
    found: FloatArray
    covariances: FloatArray
    moved: BoolArray

    @classmethod
    def of(
        cls, world: Map, local: LocalProblem, photos: Sequence[Photo], settings: SubpixelSettings
    ) -> _Work:
        places = PatchPlaces.of(world, local, settings.step_per_scale)
        count = len(local.rows)
        return cls(
            local,
            [photos[i] for i in local.images],
            settings,
            places,
            found=local.problem.pixels.copy(),
            covariances=np.full((count, 3), np.nan),
            moved=np.zeros(count, dtype=np.bool_),
        )

    def run(self, begin: int, end: int, threads: int, progress: Progress) -> None:
        """Align the patches of the points from `begin` to `end`."""
        problem = self.local.problem
        reference = self.places.reference[begin:end]
        others = (problem.point_index >= begin) & (problem.point_index < end)
        others[reference] = False
        rounds = _alignment_rounds(self.places.spacings[begin:end], 2 * self.settings.radius + 3)

        def sample(image: int) -> None:
            here = np.flatnonzero(problem.camera_index[reference] == image)
            if len(here):
                self._sample(image, reference[here], here, rounds)

        def align(image: int) -> None:
            rows = np.flatnonzero(others & (problem.camera_index == image))
            if len(rows):
                self._align(image, rows, problem.point_index[rows].astype(np.intp) - begin, rounds)

        images = [k for k, photo in enumerate(self.photos) if photo.path is not None]
        threads = min(threads, _MOST_READERS)
        for part, task in enumerate((sample, align)):
            results_in_order(
                task, images, threads, stage="refining", progress=_partial_progress(progress, part, 2)
            )

    def _sample(self, image: int, rows: Numbers, points: Numbers, rounds: list[_AlignmentRound]) -> None:
        """Templates of `points`, whose references are the observations `rows` of an image."""
        pyramid, radius = grey_pyramid(self.photos[image]), self.settings.radius + 1
        for one in rounds:
            some = one.takes_part(points)
            steps = self.places.maps[rows[some]] * one.spacings[points[some], None, None]
            pixels = self.places.pixels[rows[some]]
            one.templates[one.number[points[some]]] = sample_patches(pyramid, pixels, steps, radius)

    def _align(self, image: int, rows: Numbers, points: Numbers, rounds: list[_AlignmentRound]) -> None:
        """Move the observations `rows` of an image, which see `points`, as far as they are to be trusted."""
        pyramid, start = grey_pyramid(self.photos[image]), self.places.pixels[rows]
        for one in rounds:
            some = np.flatnonzero(one.takes_part(points))
            steps = self.places.maps[rows[some]] * one.spacings[points[some], None, None]
            numbers = one.number[points[some]]
            aligned = align_patches(pyramid, one.templates, numbers, start[some], steps)
            good = self._pass_quality_limits(aligned, start[some], steps)
            moved = some[good]
            start[moved] = aligned.pixels[good]
            self.found[rows[moved]] = aligned.pixels[good]
            self.covariances[rows[moved]] = aligned.covariances[good]
            self.moved[rows[moved]] = True

    def _pass_quality_limits(
        self, aligned: PatchAlignment, start: FloatArray, steps: FloatArray
    ) -> BoolArray:
        settings = self.settings
        shifts = np.einsum("nij,nj->ni", inverses(steps), aligned.pixels - start)
        uu, uv, vv = aligned.covariances.T
        largest_variance = (uu + vv) / 2 + np.hypot((uu - vv) / 2, uv)
        good = aligned.correlations >= settings.min_correlation
        good &= np.linalg.norm(shifts, axis=1) <= settings.max_shift
        good &= largest_variance <= settings.max_sigma**2 * np.abs(determinants(steps))
        return np.asarray(good)


@dataclass(frozen=True, eq=False)
class _AlignmentRound:
    """Patches of one size, of points that are large enough.

    Attributes
    ----------
    spacings : (n,) float64
        Distance of samples of each point [px].
    number : (n,) int32
        Template of each point; -1 for those that do not take part.
    templates : (T, S, S) float32
        Those of the points that do.
    """

    spacings: FloatArray
    number: IndexArray
    templates: Templates

    def takes_part(self, points: Numbers) -> BoolArray:
        return np.asarray(self.number[points] >= 0)


def _alignment_rounds(spacings: FloatArray, side: int) -> list[_AlignmentRound]:
    """From the whole of what was detected to the pixels of the photo, finer by a factor of two each."""
    rounds: list[_AlignmentRound] = []
    takes_part = np.ones(len(spacings), dtype=np.bool_)
    while takes_part.any():
        number = np.where(takes_part, np.cumsum(takes_part) - 1, -1).astype(np.int32)
        templates = np.full((np.count_nonzero(takes_part), side, side), np.nan, dtype=np.float32)
        rounds.append(_AlignmentRound(spacings, number, templates))
        takes_part = takes_part & (spacings > 1)
        spacings = np.maximum(spacings / 2, 1.0)
    return rounds
