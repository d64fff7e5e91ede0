"""Incremental reconstruction of one or more models, merged where they overlap (thesis algorithm 5)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import Similarity, agreeing_pairs, fit_similarity, reprojection_errors_px
from sfmcpp.map import Map
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sfm.growth import Growth
from sfmcpp.sfm.scene import Scene
from sfmcpp.sfm.settings import IncrementalSettings

# Models that are started at most: photos of nothing fall into as many parts as there are, and each model has
# room for all keypoints.
_MODELS = 50
# Points of both models agree if most are nearer than this part of the spread of the common ones.
_MAX_DISTANCE = 0.02


@dataclass(eq=False)
class GrownModels:
    """Models that have grown.

    Attributes
    ----------
    models : list of Map
        The largest first.
    reasons : dict of int to str
        Why images that are in no model have no pose, as far as they were tried.
    interrupted : bool
        Whether it was ended before its time.
    warnings : list of str
        What a user should know, in sentences.
    """

    models: list[Map] = field(default_factory=list)
    reasons: dict[int, str] = field(default_factory=dict)
    interrupted: bool = False
    warnings: list[str] = field(default_factory=list)


def grow_models(scene: Scene, settings: IncrementalSettings, progress: Callable[[int], bool]) -> GrownModels:
    """Grow models until no images are left that fit together.

    Parameters
    ----------
    scene : Scene
        Images, cameras and tracks.
    settings : IncrementalSettings
        Thresholds and seed.
    progress : callable
        Called with the number of images that have a pose; returning True asks to stop with what there is.

    Returns
    -------
    GrownModels
        Models that overlap are joined. No model is thrown away but small ones beside a larger one. Where more
        could be started than there may be, the images left are told of.
    """
    grown, num_images = GrownModels(), len(scene.graph.photos)
    elsewhere = np.zeros(num_images, dtype=np.bool_)
    while not grown.interrupted:
        growth = Growth(scene, settings, elsewhere.copy())
        try:
            if not growth.start():
                break
            if len(grown.models) == _MODELS:
                _tell_untried(grown, scene, elsewhere)
                break
            growth.grow(stop_listener(progress, elsewhere))
        except KeyboardInterrupt:
            grown.interrupted = True
        if not growth.world.registered.any():
            break
        grown.reasons.update(growth.reasons)
        _add_model(grown, growth, scene, settings)
        elsewhere |= growth.world.registered
    grown.models.sort(key=lambda world: -int(np.count_nonzero(world.registered)))
    grown.models[1:] = [world for world in grown.models[1:] if _is_large_enough(world, settings)]
    return grown


def _tell_untried(grown: GrownModels, scene: Scene, elsewhere: BoolArray) -> None:
    """Say of images outside all models, (I,) `elsewhere`, that fit others of them why they are left out."""
    fitting = [(p.first, p.second) for p in scene.graph.pairs if p.geometry.kind in ("general", "planar")]
    left = sorted({image for pair in fitting if not elsewhere[[*pair]].any() for image in pair})
    why = f"{_MODELS} models were started, which is the most; reconstruct these images by themselves"
    grown.reasons.update(dict.fromkeys(left, why))
    first = scene.graph.photos[left[0]].name
    grown.warnings.append(f"{len(left)} images that fit others are in no model, first {first}: {why}")


def stop_listener(progress: Callable[[int], bool], elsewhere: BoolArray) -> Callable[[Map], None]:
    """Turn the answer of a listener into an interruption."""

    def tell(world: Map) -> None:
        if progress(int(np.count_nonzero(world.registered | elsewhere))):
            raise KeyboardInterrupt

    return tell


def _add_model(grown: GrownModels, growth: Growth, scene: Scene, settings: IncrementalSettings) -> None:
    """Add a model; those that it overlaps are merged with it, and with each other."""
    world, joined = growth.world, False
    while (both := _merged_with_overlapping(grown.models, world, settings)) is not None:
        world, joined = both, True
    grown.models.append(world)
    if joined:
        try:
            Growth(scene, settings, np.zeros(world.num_images, dtype=np.bool_), world).finish()
        except KeyboardInterrupt:
            grown.interrupted = True


def _merged_with_overlapping(models: list[Map], world: Map, settings: IncrementalSettings) -> Map | None:
    """Take the first of `models` that overlaps `world` out of them; the model of both."""
    for number, other in enumerate(models):
        large, small = sorted((other, world), key=lambda w: -int(np.count_nonzero(w.registered)))
        if merge_models(large, small, settings):
            del models[number]
            return large
    return None


def _is_large_enough(world: Map, settings: IncrementalSettings) -> bool:
    return bool(np.count_nonzero(world.registered) >= settings.min_model_images)


def merge_models(kept: Map, other: Map, settings: IncrementalSettings) -> bool:
    """Add the images of `other` to `kept` if common points determine their place; whether they do.

    Both are of the same scene: images, cameras, keypoints and points have the same numbers. Poses, points and
    intrinsics that `kept` has stay.
    """
    common = np.flatnonzero(kept.known & other.known)
    if len(common) < settings.min_inliers:
        return False
    place = _similarity_between(other.points[common], kept.points[common], settings)
    if place is None or not _observations_fit(kept, other, place, settings):
        return False
    images = other.registered & ~kept.registered
    cameras = np.setdiff1d(kept.image_cameras[images], kept.image_cameras[kept.registered])
    kept.intrinsics[cameras] = other.intrinsics[cameras]
    kept.fixed_intrinsics[cameras] = other.fixed_intrinsics[cameras]
    kept.poses[images] = place.apply_to_poses(other.poses[images])
    points = other.known & ~kept.known
    kept.points[points] = place.apply(other.points[points])
    return True


def _similarity_between(
    source: FloatArray, target: FloatArray, settings: IncrementalSettings
) -> Similarity | None:
    """Similarity that brings most points (n, 3) near to where they should be; None if there is none."""
    good = agreeing_pairs(source, target, seed=settings.seed)
    try:
        place = fit_similarity(source[good], target[good])
    except InvalidArgument:
        return None
    spread = np.linalg.norm(target - np.median(target, axis=0), axis=1)
    apart = np.linalg.norm(place.apply(source) - target, axis=1)
    return place if np.median(apart) < _MAX_DISTANCE * np.median(spread) else None


def _observations_fit(kept: Map, other: Map, place: Similarity, settings: IncrementalSettings) -> bool:
    """Whether the images of `other`, put in place, see the points of `kept` where these should be."""
    common = np.flatnonzero(kept.known & other.known)
    local = other.seen_from(other.registered, common)
    local.problem.cameras[:] = place.apply_to_poses(local.problem.cameras)
    errors = reprojection_errors_px(local.problem, kept.points[local.points])
    return bool(len(errors) and np.median(errors) <= 2 * settings.outlier_px)
