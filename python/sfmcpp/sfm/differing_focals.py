"""Photos that share a camera but not a focal length: a zoom, or a crop, of which the files tell nothing.

One focal length for all bends the model and tears it into pieces, while the residuals stay small. Files may
tell one, too: those of a digital zoom, and of photos cropped later, still tell that of the lens.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry.significance import mad_sigma
from sfmcpp.map import Map
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.sfm.adjustment import ROUGH
from sfmcpp.sfm.cameras import Cameras
from sfmcpp.sfm.intrinsics_sigmas import sigmas_of_intrinsics
from sfmcpp.sfm.match_graph import Pair
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.weighting import solve
from sfmcpp.wording import counted, first_few

_F = PERSPECTIVE.index("f")
# Of fewer images, noise moves the focal lengths about.
_FEWEST_IMAGES = 4
# Focal lengths of photos that share one spread by their σ and hardly beyond; those of a zoom by far more.
_LEAST_SPREAD, _SIGMAS = 0.05, 4.0
# A single one is farther off more often: a lens breathes with its focus, and σ is too small by a few times.
_LEAST_CHANGE, _SIGMAS_OF_ONE = 0.1, 10.0
_MOST_NAMED = 3


def differing_focals(
    models: Sequence[Map],
    contradicting: Sequence[list[Pair]],
    cameras: Cameras,
    settings: IncrementalSettings,
    sharing: str,
) -> list[str]:
    """Warn of images that share a camera by default, but whose own focal lengths differ.

    Parameters
    ----------
    models : sequence of Map
        Finished models; they stay as they are.
    contradicting : sequence of list of Pair
        Pairs that contradict each model.
    cameras : Cameras
        What was known of the cameras at the start: guessed focal lengths are examined, and where pairs
        contradict the model, those that files tell.
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
    for world, pairs in zip(models, contradicting, strict=True):
        torn = np.unique([(pair.first, pair.second) for pair in pairs]).astype(np.intp)
        free = ~cameras.fixed[:, _F] & (cameras.guessed | bool(len(torn)))
        if (found := _own_focals(world, free, settings)) is not None and (
            text := _warning(world, found, torn)
        ):
            return [text]
    return []


@dataclass(frozen=True)
class _OwnFocals:
    """Focal lengths of images over the median of their camera's, and the σ of their logarithms."""

    images: NDArray[np.intp]
    shares: FloatArray
    sigmas: FloatArray


def _own_focals(world: Map, free: BoolArray, settings: IncrementalSettings) -> _OwnFocals | None:
    """What adjusting the focal length of each image of `free` cameras (G,) gives, if it tells something."""
    local = world.whole_problem(2)
    problem, chosen = _with_own_focals(local.problem, free[local.cameras])
    if not chosen.any() or (before := sigmas_of_intrinsics(problem)) is None:
        return None
    summary = solve(problem, loss="cauchy", loss_scale_px=settings.loss_sigmas, **ROUGH)
    if summary.termination == "interrupted":
        return None
    index, focals = local.problem.intrinsics_index[chosen], problem.intrinsics[chosen, _F]
    shares = focals / [np.median(focals[index == camera]) for camera in index]
    return _OwnFocals(local.images[chosen], shares, before[chosen, _F] / focals)


def _warning(world: Map, found: _OwnFocals, torn: NDArray[np.intp]) -> str:
    """What is to be said of them; empty if they are alike. Pairs with `torn` images contradict the model.

    Where focal lengths are hardly determined, as in flights, errors of the lens move them beyond their σ, but
    the model fits all pairs, and there is no gap between them.
    """
    logs = np.log(np.maximum(found.shares, 1e-6))
    remedy = "one for all bends the model; if a zoom or several cameras were used, give --shared-camera each"
    if mad_sigma(logs) > max(_LEAST_SPREAD, _SIGMAS * float(np.median(found.sigmas))):
        return (
            "photos that share a camera seem to differ in focal length: adjusted one by one, theirs are "
            f"{found.shares.min():.2f} to {found.shares.max():.2f} of the median, and {remedy} (or folder)"
        )
    is_far = np.abs(logs) > np.maximum(np.log1p(_LEAST_CHANGE), _SIGMAS_OF_ONE * found.sigmas)
    far = np.flatnonzero(is_far & (np.isin(found.images, torn) | _set_apart(logs, found.sigmas)))
    if not len(far):
        return ""
    far = far[np.argsort(-np.abs(logs[far]), kind="stable")]
    named = (f"{world.image_names[found.images[k]]} ({found.shares[k]:.2f} of the median)" for k in far)
    photos, few = counted(len(far), "photo seems", "photos seem"), first_few(named, _MOST_NAMED)
    return (
        f"{photos} to differ in focal length from others that share the camera, as after a digital zoom or a "
        f"crop: {few}; {remedy}"
    )


def _set_apart(logs: FloatArray, sigmas: FloatArray) -> BoolArray:
    """Those of the smaller part on one side of the widest gap, if that is wide and they are several."""
    order = np.argsort(logs, kind="stable")
    gaps = np.diff(logs[order])
    apart = np.zeros(len(logs), dtype=np.bool_)
    if not len(gaps):
        return apart
    before = int(np.argmax(gaps)) + 1
    smaller = order[before:] if 2 * before >= len(logs) else order[:before]
    if gaps[before - 1] > max(np.log1p(_LEAST_CHANGE), _SIGMAS_OF_ONE * float(np.median(sigmas))):
        apart[smaller] = len(smaller) > 1
    return apart


def _with_own_focals(problem: Problem, free: BoolArray) -> tuple[Problem, BoolArray]:
    """A copy in which each image has its own row, and which of them (C,) have a free focal length."""
    index = problem.intrinsics_index
    seen = np.isin(np.arange(problem.num_cameras), problem.camera_index)
    images = np.bincount(index[seen], minlength=len(problem.intrinsics))
    chosen = seen & (free & (images >= _FEWEST_IMAGES))[index]
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
