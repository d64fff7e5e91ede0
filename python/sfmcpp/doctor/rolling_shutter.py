"""Rolling shutters: the rows of an image are exposed one after the other while the camera moves on.

A score (Lagrange multiplier) test at the minimum (Rao, Large sample tests of statistical hypotheses, 1948):
residuals are compared with what a shutter would leave of them after poses, points and intrinsics have taken
up their part. The motion is that from each camera to the next in their order.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from sfmcpp.ba import residuals_px
from sfmcpp.doctor.case import Case, image_sizes_px
from sfmcpp.doctor.finding import Finding
from sfmcpp.doctor.trial import redundancy, ridged_model
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray

# So many standard deviations do not come about by chance.
_SIGMAS = 5.0
# Rows of an image are read within the time to the next one: a share from zero to one, and what σ adds.
_LONGEST = 1.2
# Less than this from the first row to the last is of no consequence [px].
_LEAST_PX = 0.5
# Cameras are in the order of a path if each is so much nearer to the next than to others.
_STEP = 0.5
# Part of the motion to the next camera for numeric derivatives.
_PART = 1e-3


@dataclass(frozen=True)
class _Readout:
    """The time from the first row to the last over that between two cameras, and its σ."""

    share: float
    sigma: float
    shift_px: float


def rolling_shutter(case: Case) -> Iterator[Finding]:
    """Find residuals along the motion of the camera that grow from row to row."""
    if case.sound_trial is None or case.constraints:
        return
    fitted = case.best_fit
    if fitted is None or fitted.problem.rigs is not None or not is_path(fitted.problem):
        return
    try:
        readout = _readout(fitted.problem)
    except InvalidArgument as error:
        case.skipped.append(f"rolling shutter: {error}")
        return
    plausible = _SIGMAS * readout.sigma < readout.share < _LONGEST
    if plausible and readout.shift_px > _LEAST_PX:
        case.has_rolling_shutter = True
        yield _finding(readout)


def is_path(problem: Problem) -> bool:
    """Whether the cameras that observe are in the order of a path, as those of a video are."""
    seen = np.unique(problem.camera_index)
    centres = problem.centres[seen]
    if len(seen) < 3:
        return False
    others = np.linalg.norm(centres[:, None] - centres[None], axis=2)[np.triu_indices(len(seen), 2)]
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    return bool(np.median(steps) < _STEP * np.median(others))


def _readout(problem: Problem) -> _Readout:
    """Estimate the readout at the minimum: bᵀMr / bᵀMb, where M takes out what other parameters take up.

    The residuals r are taken out, too: where an adjustment ends they are nearly orthogonal to all parameters,
    and of the images b of a readout so little may be left that nearly is not enough.
    """
    motion, residuals = motion_px(problem), residuals_px(problem)
    column = _row_times(problem)[:, None] * motion
    column_left, residuals_left = _left_px2(problem, column), _left_px2(problem, residuals)
    product = (_left_px2(problem, column + residuals) - column_left - residuals_left) / 2
    variance = residuals_left / redundancy(problem)
    share = product / column_left
    shift = abs(share) * float(np.median(np.linalg.norm(motion, axis=1)))
    return _Readout(share, float(np.sqrt(variance / column_left)), shift)


def _left_px2(problem: Problem, residuals: FloatArray) -> float:
    """Sum of squares that the linear model leaves of residuals (M, 2) [px²]."""
    pixels = problem.pixels - residuals_px(problem) + residuals
    problem = replace(problem, pixels=pixels, sigma_px=None, covariance_px2=None)
    model = ridged_model(problem, ())
    return max(float((residuals**2).sum() - 2 * model.step().decrease), 0.0)


def motion_px(problem: Problem) -> FloatArray:
    """(M, 2) how far each observation moves while its camera moves on to the next one [px]."""
    seen = np.unique(problem.camera_index)
    before, after = seen[np.maximum(np.arange(len(seen)) - 1, 0)], np.append(seen[1:], seen[-1])
    steps = np.full((len(seen), 1), 2.0)
    steps[[0, -1]] = 1.0
    turn, way = np.zeros((2, problem.num_cameras, 3))
    relative = np.swapaxes(problem.rotations[before], 1, 2) @ problem.rotations[after]
    turn[seen], way[seen] = (
        so3.log(relative) / steps,
        (problem.centres[after] - problem.centres[before]) / steps,
    )
    images = [problem.pixels - residuals_px(_moved(problem, turn, way, part)) for part in (_PART, -_PART)]
    return np.asarray((images[0] - images[1]) / (2 * _PART))


def _moved(problem: Problem, turn: FloatArray, way: FloatArray, part: float) -> Problem:
    rotations = problem.rotations @ so3.exp(part * turn)
    return replace(
        problem, cameras=np.concatenate([rotations, (problem.centres + part * way)[:, :, None]], axis=2)
    )


def _row_times(problem: Problem) -> FloatArray:
    """(M,) when the row of each observation is exposed, from −½ at the first to ½ at the last."""
    rows, sizes = problem.pixels[:, 1], image_sizes_px(problem)
    if len(sizes):
        return np.asarray(rows / sizes[:, 1] - 0.5)
    low, high = np.quantile(rows, (0.01, 0.99))
    return np.asarray((rows - (low + high) / 2) / max(high - low, 1.0))


def _finding(readout: _Readout) -> Finding:
    return Finding(
        "rolling-shutter",
        "warning",
        "residuals along the motion of the camera grow from row to row, as those of a rolling shutter do: "
        f"reading an image takes {readout.share:.2g} ± {readout.sigma:.1g} of the time to the next one, and "
        f"half of the points move by more than {readout.shift_px:.2g} px meanwhile",
        "poses and points are bent by about as much, and no camera model here has it: use a global shutter, "
        "slower motion, or images corrected for it",
        measures={"share": readout.share, "sigma": readout.sigma, "shift_px": readout.shift_px},
    )
