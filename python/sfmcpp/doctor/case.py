"""The problem under examination, with lazily computed quantities that the examinations share."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba import Summary
from sfmcpp.doctor.finding import named
from sfmcpp.doctor.freed_intrinsics import FreedIntrinsics, freed_intrinsics, held_columns
from sfmcpp.doctor.trial import GROSS, Trial, adjusted, median_sigma_px, robust_trial
from sfmcpp.geometry.pinhole import pinhole_rows
from sfmcpp.geometry.point_tests import reprojection_errors_px
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.residual_group import Group

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix

# What is computed per observation in Python looks at so many, evenly spread: medians hardly feel it.
SAMPLE = 200_000
# Trial adjustments and variances, which are cubic in the cameras, take so much of a problem: a second or two.
TRIAL_OBSERVATIONS, TRIAL_CAMERAS = 100_000, 200
# No image is as small as this, and a usual one has so many pixels across.
_SMALLEST_IMAGE_PX, _PIXELS_OF_AN_IMAGE = 16.0, 1000.0
# One hundredth of the image: less is a matter of calibration and noise.
_VISIBLE = 0.01


class Case:
    """A problem whose arrays keep the rules, without its second observations of a point by a camera.

    `rows` are the numbers of its observations in the problem that was given; None: they are the same.
    """

    def __init__(
        self,
        problem: Problem,
        constraints: Sequence[Group],
        summary: Summary | None,
        rows: NDArray[np.intp] | None = None,
    ) -> None:
        self.problem = problem
        self._rows = rows
        self.constraints = list(constraints)
        self.summary = summary
        self.skipped: list[str] = []
        # Whether the start is void or misread: what residuals say is then about that alone.
        self.is_misread = False
        # Whether a distortion held at zero explains what wrong focal lengths might.
        self.lacks_distortion = False
        # Whether intrinsics have been found to be wrong by a large part.
        self.blames_calibration = False
        # Whether a rolling shutter is behind what is left of residuals.
        self.has_rolling_shutter = False

    def given_rows(self, some: Problem, chosen: NDArray[np.bool_]) -> NDArray[np.intp]:
        """Numbers, in the problem that was given, of the `chosen` observations of a part of this one."""
        rows = np.flatnonzero(np.isin(observation_keys(self.problem), observation_keys(some)[chosen]))
        return rows if self._rows is None else self._rows[rows]

    def name_of_camera(self, camera: int) -> str:
        """Its number, and the name of its image if there is one."""
        names = self.problem.metadata.image_names
        return f"{camera} ({names[camera]})" if camera < len(names) else str(camera)

    def named_cameras(self, cameras: Sequence[int]) -> str:
        """Some cameras by name."""
        return named("camera", cameras, self.name_of_camera)

    @cached_property
    def stated_sigma_px(self) -> float:
        """Median stated standard deviation of the pixels; one where none is stated [px]."""
        return median_sigma_px(self.problem)

    @cached_property
    def sigma_px(self) -> float:
        """σ to judge errors by: as stated, or a thousandth of images too small to be in pixels [px]."""
        uncertainty = self.problem.uncertainty
        is_stated = uncertainty.sigma_px is not None or uncertainty.covariance_px2 is not None
        return (
            self.stated_sigma_px if is_stated or self.is_of_pixels else self.extent_px / _PIXELS_OF_AN_IMAGE
        )

    @property
    def is_of_pixels(self) -> bool:
        """Whether observations are in pixels, as far as their extent tells."""
        return not self.problem.num_observations or not 0 < self.extent_px < _SMALLEST_IMAGE_PX

    @cached_property
    def views_of_points(self) -> NDArray[np.int64]:
        """(N,) observations of each point."""
        return np.bincount(self.problem.point_index, minlength=self.problem.num_points)

    @cached_property
    def views_of_cameras(self) -> NDArray[np.int64]:
        """(C,) observations of each camera."""
        return np.bincount(self.problem.camera_index, minlength=self.problem.num_cameras)

    @cached_property
    def incidence(self) -> csr_matrix:
        """(C, N) one where a camera observes a point that others observe too."""
        from scipy.sparse import csr_matrix

        problem = self.problem
        joining = self.views_of_points[problem.point_index] > 1
        places = problem.camera_index[joining], problem.point_index[joining]
        shape = (problem.num_cameras, problem.num_points)
        return csr_matrix((np.ones(len(places[0]), dtype=np.int32), places), shape=shape)

    @cached_property
    def common_points(self) -> csr_matrix:
        """(C, C) how many points two cameras have in common; nothing on the diagonal."""
        common: csr_matrix = (self.incidence @ self.incidence.T).tocsr()
        common.setdiag(0)
        common.eliminate_zeros()
        return common

    @cached_property
    def sample(self) -> Problem:
        """The problem with observations evenly spread over all of them."""
        count = self.problem.num_observations
        if count <= SAMPLE:
            return self.problem
        self.skipped.append(
            f"conventions and points behind cameras: checked on {SAMPLE:,} of {count:,} observations"
        )
        return self.problem.with_observations(np.linspace(0, count - 1, SAMPLE).astype(np.int64))

    @cached_property
    def errors_px(self) -> FloatArray:
        """Reprojection errors of the sample at the state given; infinite behind the camera."""
        return reprojection_errors_px(self.sample, self.sample.points)

    @cached_property
    def focal_px(self) -> float:
        """Median focal length [px]."""
        return float(np.median(pinhole_rows(self.problem.intrinsics)[:, 0]))

    @cached_property
    def extent_px(self) -> float:
        """Extent of the images [px]."""
        return extent_px(self.sample)

    @cached_property
    def part(self) -> Problem:
        """The problem or, of a large one, the cameras around the one that sees most, for trials."""
        problem = self.problem
        if problem.num_observations > TRIAL_OBSERVATIONS or problem.num_cameras > TRIAL_CAMERAS:
            cameras = self._cameras_nearby()
            problem = problem.with_observations(cameras[problem.camera_index])
            self.skipped.append(
                f"residuals and variances: checked on {np.count_nonzero(cameras):,} neighbouring cameras "
                f"of {len(cameras):,}"
            )
        return without_single_views(problem)

    def _cameras_nearby(self) -> NDArray[np.bool_]:
        from scipy.sparse.csgraph import breadth_first_order

        start = int(np.argmax(self.views_of_cameras))
        order = breadth_first_order(self.common_points, start, directed=False, return_predecessors=False)
        order = order[:TRIAL_CAMERAS]
        enough = np.cumsum(self.views_of_cameras[order]) <= TRIAL_OBSERVATIONS
        enough[:2] = True
        chosen = np.zeros(self.problem.num_cameras, dtype=np.bool_)
        chosen[order[enough]] = True
        return chosen

    @cached_property
    def trial(self) -> Trial | None:
        """The part adjusted by a robust loss; None, with the reason noted, where that cannot be."""
        trial = robust_trial(self.part, self.constraints, self.sigma_px)
        if isinstance(trial, str):
            self.skipped.append(f"trial adjustment and the checks based on it: {trial}")
            return None
        return trial

    @property
    def sound_trial(self) -> Trial | None:
        """The trial where it tells more than that the start is misread or that nothing near it fits."""
        trial = self.trial
        return None if self.is_misread or trial is None or self.fits_poorly(trial) else trial

    def fits_poorly(self, trial: Trial) -> bool:
        """Whether the median error is gross: by the standard deviation stated, and to the eye."""
        return trial.median_px > max(GROSS * self.sigma_px, _VISIBLE * self.extent_px)

    def squared_error(self, trial: Trial) -> float:
        """Its sum of squares by the extent of the images [px²]."""
        return trial.squared_error(self.extent_px)

    @cached_property
    def good_part(self) -> Problem:
        """The trial's problem for a sum of squares, or the one it began with if it came to nothing.

        Where a robust loss would make all but a few residuals of short tracks vanish, a square does not.
        """
        trial = self.trial
        if trial is None or self.fits_poorly(trial):
            return self.part
        return without_single_views(trial.problem.with_observations(~trial.gross(self.sigma_px)))

    @cached_property
    def least_squares(self) -> Trial | None:
        """The good part adjusted by least squares; None where that cannot be."""
        found = adjusted(self.good_part, self.constraints, "squared")
        return None if isinstance(found, str) else found

    @cached_property
    def freed_intrinsics(self) -> FreedIntrinsics | None:
        """The least-squares trial with all intrinsics free; None where that cannot be or tells nothing."""
        trial = self.sound_trial
        if trial is None:
            return None
        columns = held_columns(trial.problem)
        if not len(columns) or self.least_squares is None:
            return None
        found = freed_intrinsics(
            self.least_squares, columns, self.constraints, self.extent_px, self.stated_sigma_px
        )
        if isinstance(found, str):
            self.skipped.append(f"held intrinsics: {found}")
            return None
        return found

    @property
    def best_fit(self) -> Trial | None:
        """Adjusted by least squares, with all intrinsics free where that can be."""
        return self.least_squares if self.freed_intrinsics is None else self.freed_intrinsics.freed


def extent_px(problem: Problem) -> float:
    """Larger side of the box around most pixels, wrong ones left out [px]."""
    return float(np.ptp(np.quantile(problem.pixels, (0.01, 0.99), axis=0), axis=0).max())


def image_sizes_px(problem: Problem) -> FloatArray:
    """(M, 2) width and height of the image of each observation [px]; none where one of them is not known."""
    sizes = problem.metadata.image_sizes
    if sizes is None or len(sizes) != problem.num_cameras:
        return np.zeros((0, 2))
    found = np.asarray(sizes, dtype=np.float64)[problem.camera_index]
    return found if (found > 0).all() else np.zeros((0, 2))


def observation_keys(problem: Problem) -> NDArray[np.int64]:
    """(M,) a number for each camera and point: the same ones have the same."""
    return problem.camera_index.astype(np.int64) * max(problem.num_points, 1) + problem.point_index


def without_single_views(problem: Problem) -> Problem:
    """The problem without observations of points that nothing else observes, but for fixed ones."""
    views = np.bincount(problem.point_index, minlength=problem.num_points)
    return problem.with_observations(((views > 1) | problem.fixed_points)[problem.point_index])
