"""Observations of a finished model, moved to where the photos of a point look most alike.

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

from sfmcpp.map import LocalProblem, Map
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_count, require_positive, require_share
from sfmcpp.model.photos import Photo
from sfmcpp.sfm.in_order import Progress, in_order, silent, thread_count
from sfmcpp.sfm.patch_places import Numbers, PatchPlaces, determinants, inverses
from sfmcpp.sources.vision import one_opencv_thread
from sfmcpp.sources.vision.patches import PatchAlignment, align_patches, grey_pyramid, sample_patches

Templates = NDArray[np.float32]

# Templates of so many points are kept at a time: 120 MB.
_POINTS_AT_ONCE = 100_000
# A photo in grey with its smaller copies takes 130 MB where it has 24 megapixels.
_MOST_READERS = 8


@dataclass(frozen=True)
class SubpixelSettings:
    """What decides about patches, and about which of their places are trusted.

    Attributes
    ----------
    radius : int
        Samples of a patch on each side of its centre.
    step_per_scale : float
        Distance of samples over the scale of the keypoint, where that gives more than a pixel.
    min_correlation : float
        Least correlation of a patch with the reference.
    max_shift : float
        Farthest from where the model predicts it, in samples.
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
    """What became of the observations of a model.

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
    progress: Progress = silent,
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
        for begin in range(0, local.problem.num_points, _POINTS_AT_ONCE):
            end = min(begin + _POINTS_AT_ONCE, local.problem.num_points)
            work.run(begin, end, thread_count(threads), progress)
    shifts = np.linalg.norm(work.found - local.problem.pixels, axis=1)[work.moved]
    points = np.unique(local.problem.point_index[work.moved])
    world.keypoints[local.rows] = work.found
    _set_covariances(world, local, work, points)
    median = float(np.median(shifts)) if len(shifts) else float("nan")
    return SubpixelOutcome(len(local.rows), len(shifts), len(points), median)


def _set_covariances(world: Map, local: LocalProblem, work: _Work, points: NDArray[np.integer]) -> None:
    """Of keypoints that have moved, and of those that these refer to."""
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
        count, pixels = len(local.rows), local.problem.pixels.copy()
        moved, covariances = np.zeros(count, dtype=np.bool_), np.full((count, 3), np.nan)
        return cls(local, [photos[i] for i in local.images], settings, places, pixels, covariances, moved)

    def run(self, begin: int, end: int, threads: int, progress: Progress) -> None:
        """Align the patches of the points from `begin` to `end`."""
        problem = self.local.problem
        side = 2 * self.settings.radius + 3
        templates = np.full((end - begin, side, side), np.nan, dtype=np.float32)
        reference = self.places.reference[begin:end]
        others = (problem.point_index >= begin) & (problem.point_index < end)
        others[reference] = False

        def sample(image: int) -> None:
            here = np.flatnonzero(problem.camera_index[reference] == image)
            templates[here] = self._sampled(image, reference[here])

        def align(image: int) -> None:
            rows = np.flatnonzero(others & (problem.camera_index == image))
            self._align(image, rows, templates, begin)

        images = [k for k, photo in enumerate(self.photos) if photo.path is not None]
        threads = min(threads, _MOST_READERS)
        for done, task in ((0, sample), (len(images), align)):

            def told(stage: str, part: int, total: int, before: int = done) -> bool:
                return progress(stage, before + part, 2 * total)

            in_order(task, images, threads, stage="refining", progress=told)

    def _sampled(self, image: int, rows: Numbers) -> Templates:
        places, pyramid = self.places, grey_pyramid(self.photos[image])
        return sample_patches(pyramid, places.pixels[rows], places.steps[rows], self.settings.radius + 1)

    def _align(self, image: int, rows: Numbers, templates: Templates, begin: int) -> None:
        """Move the observations `rows` of an image, as far as they are to be trusted."""
        start, steps = self.places.pixels[rows], self.places.steps[rows]
        which = self.local.problem.point_index[rows] - begin
        aligned = align_patches(grey_pyramid(self.photos[image]), templates, which, start, steps)
        good = self._are_good(aligned, start, steps)
        self.found[rows[good]] = aligned.pixels[good]
        self.covariances[rows[good]] = aligned.covariances[good]
        self.moved[rows[good]] = True

    def _are_good(self, aligned: PatchAlignment, start: FloatArray, steps: FloatArray) -> BoolArray:
        settings = self.settings
        shifts = np.einsum("nij,nj->ni", inverses(steps), aligned.pixels - start)
        uu, uv, vv = aligned.covariances.T
        largest_variance = (uu + vv) / 2 + np.hypot((uu - vv) / 2, uv)
        good = aligned.correlations >= settings.min_correlation
        good &= np.linalg.norm(shifts, axis=1) <= settings.max_shift
        good &= largest_variance <= settings.max_sigma**2 * np.abs(determinants(steps))
        return np.asarray(good)
