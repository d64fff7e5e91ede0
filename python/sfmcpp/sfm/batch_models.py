"""Batch reconstruction of all images at once, then growth by those left out (thesis algorithm 4)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.image_tracks import ImageTracks
from sfmcpp.sfm.batch.projective import ProjectiveReconstruction, reconstruct_projective
from sfmcpp.sfm.batch.upgrade import MetricUpgrade, metric_upgrade
from sfmcpp.sfm.growth import Growth
from sfmcpp.sfm.incremental import GrownModels, stop_listener
from sfmcpp.sfm.scene import Scene
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.sfm.tracks import NO_TRACK


def batch_models(scene: Scene, settings: IncrementalSettings, progress: Callable[[int], bool]) -> GrownModels:
    """Reconstruct all images at once from their tracks; images that this leaves out follow one by one.

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
        One model, or none and the reason.
    """
    tracks = tracks_of(scene)
    projective = reconstruct_projective(tracks, max_error_px=settings.outlier_px, seed=settings.seed)
    reasons = dict(projective.left_out)
    if projective.problem is None:
        return GrownModels([], reasons, warnings=[f"no batch reconstruction: {projective.message}"])
    found = metric_upgrade(
        projective.problem,
        tracks.sizes[projective.images],
        principal_point=tracks.centres[projective.images],
        max_error_px=settings.outlier_px,
        **_what_is_known(scene, projective.images),
    )
    if found.problem is None:
        return GrownModels([], reasons, warnings=[f"no metric model: {found.reason}"])
    growth = _growth_from(scene, settings, projective, found)
    grown = GrownModels([growth.world], reasons, warnings=list(found.warnings))
    try:
        growth.grow(stop_listener(progress, np.zeros(len(scene.graph.photos), dtype=np.bool_)))
    except KeyboardInterrupt:
        grown.interrupted = True
    grown.reasons.update(growth.reasons)
    return grown


def tracks_of(scene: Scene) -> ImageTracks:
    """Tracks of a scene, with the same numbers of images and tracks."""
    tracks, cameras = scene.tracks, scene.cameras
    rows = np.flatnonzero(tracks.track != NO_TRACK)
    image = np.repeat(np.arange(len(scene.graph.photos), dtype=np.int32), np.diff(tracks.begin))
    pixels = np.concatenate([np.empty((0, 2)), *(some.pixels for some in scene.graph.features)])
    return ImageTracks(
        [photo.name for photo in scene.graph.photos],
        cameras.sizes[cameras.of_image],
        cameras.intrinsics[cameras.of_image, 2:4],
        image[rows],
        tracks.track[rows],
        pixels[rows],
    )


def _what_is_known(scene: Scene, images: NDArray[np.int64]) -> dict[str, Any]:
    """Known intrinsics, or whether one focal length is to be found or several."""
    cameras = scene.cameras
    if cameras.fixed.all():
        return {"focal": "known", "intrinsics": cameras.intrinsics[cameras.of_image[images], :5]}
    shared = len(np.unique(cameras.of_image[images])) == 1
    return {"focal": "shared" if shared else "varying"}


def _growth_from(
    scene: Scene,
    settings: IncrementalSettings,
    projective: ProjectiveReconstruction,
    found: MetricUpgrade,
) -> Growth:
    """Growth that begins with the metric problem, with its merged tracks, in a map of the scene."""
    problem, images, tracks = found.problem, projective.images, projective.tracks
    assert problem is not None
    assert projective.problem is not None
    world = scene.new_map()
    numbers = images[found.cameras]
    world.poses[numbers] = problem.cameras
    world.points[tracks[found.points]] = problem.points
    camera = scene.cameras.of_image[numbers]
    world.intrinsics[camera] = problem.intrinsics[problem.intrinsics_index]
    growth = Growth(scene, settings, np.zeros(len(scene.graph.photos), dtype=np.bool_), world)
    before = tracks[projective.problem.point_index[found.observations]]
    after = tracks[found.points[problem.point_index]]
    growth.structure.join_tracks(np.unique(np.column_stack([after, before])[after != before], axis=0))
    return growth
