"""Photos that share a camera but not a focal length: a zoom of which the files tell nothing.

One focal length for all bends the model and tears it into pieces, while the residuals stay small.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sfmcpp.geometry.significance import mad_sigma
from sfmcpp.map import Map
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.sfm.adjustment import ROUGH
from sfmcpp.sfm.cameras import Cameras
from sfmcpp.sfm.intrinsics_sigmas import sigmas_of_intrinsics
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.weighting import solve

_F = PERSPECTIVE.index("f")
# Of fewer images, noise moves the focal lengths about.
_FEWEST_IMAGES = 4
# Focal lengths of photos that share one spread by their σ and hardly beyond; those of a zoom by far more.
_LEAST_SPREAD, _SIGMAS = 0.05, 4.0


def differing_focals(
    models: Sequence[Map], cameras: Cameras, settings: IncrementalSettings, sharing: str
) -> list[str]:
    """Warn of images that share a camera by default, but whose own focal lengths differ.

    Parameters
    ----------
    models : sequence of Map
        Finished models; they stay as they are.
    cameras : Cameras
        What was known of the cameras at the start: only guessed focal lengths are examined.
    settings : IncrementalSettings
        The loss.
    sharing : str
        Which photos share intrinsics: nothing is said unless that is ``"auto"``.

    Returns
    -------
    list of str
        A sentence at most.
    """
    if sharing != "auto":
        return []
    for world in models:
        shares = _own_focals(world, cameras, settings)
        if len(shares):
            return [
                "photos that share a camera seem to differ in focal length: adjusted one by one, theirs are "
                f"{shares.min():.2f} to {shares.max():.2f} of the median, and one for all bends the model; "
                "if a zoom or several cameras were used, give --shared-camera each (or folder)"
            ]
    return []


def _own_focals(world: Map, cameras: Cameras, settings: IncrementalSettings) -> FloatArray:
    """Focal lengths of the images over their median where they differ; else none."""
    local = world.whole_problem(2)
    guessed = cameras.guessed[local.cameras] & ~cameras.fixed[local.cameras, _F]
    problem, chosen = _with_own_focals(local.problem, guessed)
    if not chosen.any():
        return np.empty(0)
    sigmas = sigmas_of_intrinsics(problem)
    if sigmas is None:
        return np.empty(0)
    summary = solve(problem, loss="cauchy", loss_scale_px=settings.loss_sigmas, **ROUGH)
    focals = problem.intrinsics[chosen, _F]
    shares = focals / np.median(focals)
    spread = mad_sigma(np.log(np.maximum(shares, 1e-6)))
    usual = float(np.median(sigmas[chosen, _F] / focals))
    differ = summary.termination != "interrupted" and spread > max(_LEAST_SPREAD, _SIGMAS * usual)
    return np.asarray(shares) if differ else np.empty(0)


def _with_own_focals(problem: Problem, guessed: BoolArray) -> tuple[Problem, BoolArray]:
    """A copy in which each image has its own row, and which of them (C,) have a free focal length."""
    index = problem.intrinsics_index
    seen = np.isin(np.arange(problem.num_cameras), problem.camera_index)
    images = np.bincount(index[seen], minlength=len(problem.intrinsics))
    chosen = seen & (guessed & (images >= _FEWEST_IMAGES))[index]
    fixed = np.ones((problem.num_cameras, problem.intrinsics.shape[1]), dtype=np.bool_)
    fixed[chosen, _F] = False
    return (
        replace(
            problem.copy(),
            intrinsics=problem.intrinsics[index].copy(),
            intrinsics_index=np.arange(problem.num_cameras, dtype=np.int32),
            fixed_intrinsics=fixed,
        ),
        chosen,
    )
