"""Final stage of a reconstruction: subpixel refinement and a last adjustment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.geometry import reprojection_errors_px
from sfmcpp.map import Map
from sfmcpp.model.photos import Photo
from sfmcpp.model.threads import Progress, no_progress
from sfmcpp.sfm.adjustment import FINE, adjust_all
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.sfm.structure import are_in_cameras
from sfmcpp.sfm.subpixel import SubpixelOutcome, refine_tracks


@dataclass
class Refinement:
    """Result of the subpixel refinement of models.

    Attributes
    ----------
    outcomes : list of SubpixelOutcome
        Of each model that was refined, in their order.
    warnings : list of str
        Why one was not.
    interrupted : bool
        Whether it was ended before its time; models that it had not come to are as they were.
    """

    outcomes: list[SubpixelOutcome] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    interrupted: bool = False


def refine_models(
    models: Sequence[Map],
    photos: Sequence[Photo],
    settings: IncrementalSettings,
    *,
    threads: int | None = None,
    progress: Progress = no_progress,
) -> Refinement:
    """Move the observations of models to where the photos agree, and adjust the models.

    Parameters
    ----------
    models : sequence of Map
        Finished models of the same images, changed in place.
    photos : sequence of Photo
        Of each image; models without files of photos stay as they are.
    settings : IncrementalSettings
        Scale of the loss, and what is an outlier.
    threads : int, optional
        Threads at most; the result does not depend on it.
    progress : callable
        As of :func:`refine_tracks`.

    Returns
    -------
    Refinement
        What was done.
    """
    done = Refinement()
    for world in models:
        if not any(p.path is not None for p, r in zip(photos, world.registered, strict=True) if r):
            continue
        try:
            done.outcomes.append(refine_tracks(world, photos, threads=threads, progress=progress))
            _adjust(world, settings)
        except DatasetError as error:
            done.warnings.append(f"observations were not refined: {error}")
        except KeyboardInterrupt:
            done.interrupted = True
            break
    return done


def _adjust(world: Map, settings: IncrementalSettings) -> None:
    local = adjust_all(world, settings, **FINE)
    far = reprojection_errors_px(local.problem, local.problem.points) > settings.outlier_px
    world.points[local.points[are_in_cameras(local.problem)]] = np.nan
    world.drop(local, far, max(2, settings.min_views))
