"""Structure from motion in one call: from photos, tracks or matches to models."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import focal_from_pairs
from sfmcpp.geometry.focal_from_pairs import MOST_PAIRS
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import looked_up, require_seed
from sfmcpp.model.image_tracks import ImageTracks
from sfmcpp.model.photos import Photo
from sfmcpp.model.threads import Progress, at_most_threads, no_progress, timed
from sfmcpp.sfm.adjustment import fix_what_few_images_held
from sfmcpp.sfm.batch_models import batch_models
from sfmcpp.sfm.cache import Cache
from sfmcpp.sfm.camera_choice import camera_warnings
from sfmcpp.sfm.cameras import (
    FREE_INTRINSICS,
    CameraArgument,
    CameraInput,
    Cameras,
    as_in_database,
    parse_camera_argument,
)
from sfmcpp.sfm.contradictions import contradicting_pairs
from sfmcpp.sfm.differing_focals import differing_focals
from sfmcpp.sfm.focal_lengths import settle_focals_by_images, settle_focals_by_positions
from sfmcpp.sfm.front_end import FrontEndSettings, build_match_graph
from sfmcpp.sfm.georeference import georeference_map
from sfmcpp.sfm.imported_matches import match_graph_of_database
from sfmcpp.sfm.imported_tracks import from_corner, graph_of_tracks, joined_tracks, photos_of
from sfmcpp.sfm.incremental import GrownModels, grow_models
from sfmcpp.sfm.map_backup import undone_by_an_error
from sfmcpp.sfm.match_graph import MatchGraph
from sfmcpp.sfm.outcome import (
    guessed_focal_lengths,
    image_outcomes,
    warnings_of,
    warnings_of_copies,
    warnings_of_folder,
)
from sfmcpp.sfm.positions import Positions, choose_positions, read_gps_argument, unused_positions
from sfmcpp.sfm.refinement import Refinement, refine_models
from sfmcpp.sfm.resized_copies import without_resized_copies
from sfmcpp.sfm.result import GpsOutcome, SfmRun
from sfmcpp.sfm.scene import Scene
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.sfm.still_features import without_still_features
from sfmcpp.sfm.stops import RepeatedProgress, never, stopped_by
from sfmcpp.sfm.turned_cameras import with_turned_cameras
from sfmcpp.sources.io.colmap.database import is_database
from sfmcpp.sources.vision.images import holds_photos, require_no_single_picture

Method = Callable[[Scene, IncrementalSettings, Callable[[int], bool]], GrownModels]
METHODS: dict[str, Method] = {"incremental": grow_models, "batch": batch_models}
Source = str | PathLike[str] | MatchGraph | ImageTracks
_NO_MASKS = "masks: the source has no images"


@dataclass
class _Run:
    """State that is passed from stage to stage."""

    cameras: CameraInput
    sharing: str
    model: str
    settings: IncrementalSettings
    progress: Progress
    positions: Callable[[Sequence[Photo]], Positions | None]
    seconds: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    def cameras_of(self, photos: list[Photo]) -> Cameras:
        return self.cameras.cameras(photos, sharing=self.sharing, model=self.model)

    def cameras_of_graph(self, graph: MatchGraph) -> Cameras:
        cameras = self.cameras_of(graph.photos)
        if graph.cameras is None:
            return cameras
        focal_only = self.cameras.calibration is None
        return as_in_database(cameras, graph.cameras, keep_models=focal_only and self.model == "auto")


def reconstruct(
    source: Source,
    *,
    method: str = "incremental",
    camera: CameraArgument = "auto",
    camera_model: str = "auto",
    shared_camera: str = "auto",
    matcher: str = "auto",
    masks: str | PathLike[str] | None = None,
    gps: str | PathLike[str] = "auto",
    subpixel: bool = True,
    seed: int = 0,
    cache: str | PathLike[str] | None = None,
    threads: int | None = None,
    settings: IncrementalSettings | None = None,
    front_end: FrontEndSettings | None = None,
    progress: Progress = no_progress,
) -> SfmRun:
    """Reconstruct cameras and points.

    Parameters
    ----------
    source : path-like, MatchGraph or ImageTracks
        A folder of images; a COLMAP database, see :func:`sfmcpp.sfm.match_graph_of_database`; a file of
        tracks, or of a model, of which only the observations are used; or the result of
        :func:`sfmcpp.sfm.match_graph_of_arrays` or :func:`sfmcpp.model.image_tracks.image_tracks`.
    method : str
        ``"incremental"`` (thesis algorithm 5) or ``"batch"`` (algorithm 4).
    camera : str, float, path-like or array
        ``"auto"``: focal lengths from the files, else estimated from the matches. ``"exif"``: from the files,
        required. A number: initial focal length [px], held fixed with `camera_model` "fixed". A file
        (``K.txt``, ``calib.txt``, YAML or XML of OpenCV, Kalibr or EuRoC), or intrinsics (5,), (12,) or
        (3, 3): known and held fixed; pixels count from the corner of the image, except in files of programs.
    camera_model : str
        Which intrinsics are estimated: ``"simple-pinhole"``, ``"pinhole"``, ``"simple-radial"``, ``"radial"``
        or ``"opencv"``. ``"auto"``: those of the models in a COLMAP database; else ``"simple-radial"``, then
        more parameters if they lower the cost enough. ``"fixed"``: none.
    shared_camera : str
        Which images share intrinsics: ``"auto"``, ``"one"``, ``"folder"`` or ``"each"``; see
        :func:`sfmcpp.sfm.cameras.shared_by`.
    matcher : str
        Which pairs of images are matched: ``"auto"``, ``"exhaustive"``, ``"sequential"``, ``"spatial"``
        or ``"retrieval"``; see :func:`sfmcpp.sources.vision.choose_pairs`.
    masks : path-like, optional
        Folder of masks: nothing is detected where they are black. Only for a folder of images. Of photos
        without one, nothing is detected where they are transparent.
    gps : str or path-like
        Positions of images, to georeference the largest model: ``"none"``; ``"exif"``, from the files;
        ``"auto"``, the same if there are enough; or a CSV file of ``name, lat, lon, height`` (WGS84) or
        ``name, x, y, z`` (metres).
    subpixel : bool
        Whether observations are refined to subpixel accuracy, and the models adjusted once more; see
        :func:`sfmcpp.sfm.subpixel.refine_tracks`. Tracks without photos are unchanged.
    seed : int
        Random seed; the same seed gives the same result.
    cache : path-like, optional
        Folder in which features and matches are kept for later runs.
    threads : int, optional
        Maximum number of threads; does not change the result. Default: all of the machine.
    settings : IncrementalSettings, optional
        Thresholds of the reconstruction; its seed is replaced.
    front_end : FrontEndSettings, optional
        Settings of features and matches; its matcher, seed and threads are replaced.
    progress : callable
        Called as ``progress(stage, done, total)``, and again with the same numbers while a model is adjusted;
        returning True stops and returns the result so far.

    Returns
    -------
    SfmRun
        Models, the largest first; none if no two images fit together, and `images` then says why.

    Raises
    ------
    DatasetError
        If the source cannot be read.
    InvalidArgument
        If an argument is invalid.
    ModuleNotFoundError
        If OpenCV, Pillow or PoseLib is missing (extra ``vision``).
    """
    looked_up("method", method, METHODS)
    require_seed(seed)
    looked_up("camera_model", camera_model, {"auto": None, **dict.fromkeys(FREE_INTRINSICS)})
    limits = replace(settings or IncrementalSettings(), seed=seed)
    wanted = partial(choose_positions, gps, read_gps_argument(gps))
    run = _Run(parse_camera_argument(camera), shared_camera, camera_model, limits, progress, wanted)
    options: dict[str, Any] = {
        "method": method,
        "camera": camera if isinstance(camera, (str, float, int)) else str(camera),
        "camera_model": camera_model,
        "shared_camera": shared_camera,
        "matcher": matcher,
        "gps": str(gps),
        "subpixel": subpixel,
        "seed": seed,
    }
    front = replace(front_end or FrontEndSettings(), matcher=matcher, seed=seed, threads=threads)
    with at_most_threads(threads):
        scene = _scene_of(source, run, masks, front, None if cache is None else Cache(Path(cache)))
        photos = scene.graph.photos
        scene = replace(scene, positions=wanted(photos))
        run.warnings += unused_positions(gps, photos)
        told = RepeatedProgress(progress, "mapping", len(photos))
        with stopped_by(told.again):
            with timed("mapping", run.seconds):
                grown = METHODS[method](scene, limits, lambda done: told("mapping", done, len(photos)))
            refined = Refinement()
            if subpixel:
                with timed("refining", run.seconds):
                    refined = refine_models(grown.models, photos, limits, threads=threads, progress=told)
        found = _finished_run(source, options, scene, grown, run)
        found.warnings += refined.warnings
        found.interrupted |= refined.interrupted
        # What was asked to stop before this is placed all the same: it takes little of the time.
        with stopped_by(never if found.interrupted else told.again):
            _place_and_settle(found, scene, run, needed=gps != "auto")
        for world in found.models:
            fix_what_few_images_held(world, limits)
    return found


def _scene_of(
    source: Source,
    run: _Run,
    masks: str | PathLike[str] | None,
    front: FrontEndSettings,
    cache: Cache | None,
) -> Scene:
    if masks is not None and isinstance(source, (MatchGraph, ImageTracks)):
        raise InvalidArgument(_NO_MASKS)
    if isinstance(source, MatchGraph):
        run.warnings += source.warnings
        graph = with_turned_cameras(source, cameras := run.cameras_of_graph(source))
        return Scene.of(graph, _with_guessed_focals(graph, cameras, run))
    if isinstance(source, ImageTracks):
        return _scene_of_tracks(from_corner(source), run, front.threads)
    path = Path(source)
    if holds_photos(path):
        return _scene_of_photos(path, run, masks, front, cache)
    if masks is not None:
        raise InvalidArgument(_NO_MASKS)
    require_no_single_picture(path)
    if is_database(path):
        with timed("matching", run.seconds):
            seed, threads = run.settings.seed, front.threads
            graph = match_graph_of_database(path, seed=seed, threads=threads, progress=run.progress)
        return _scene_of(graph, run, masks, front, cache)
    from sfmcpp.sources.io.image_tracks import read_image_tracks

    with timed("reading", run.seconds):
        source = read_image_tracks(path)
    return _scene_of_tracks(from_corner(source), run, front.threads)


def _scene_of_photos(
    folder: Path, run: _Run, masks: str | PathLike[str] | None, front: FrontEndSettings, cache: Cache | None
) -> Scene:
    from sfmcpp.sources.vision import open_photos, without_copies

    found = without_copies(open_photos(folder, masks=masks))
    run.positions(found.photos)  # what cannot be is refused before the work
    run.warnings += warnings_of_folder(found)
    cameras = run.cameras_of(found.photos)
    graph = build_match_graph(
        found,
        front,
        _known_rows(cameras),
        cache=cache,
        progress=run.progress,
        seconds=run.seconds,
    )
    graph, copies = without_resized_copies(graph)
    run.warnings += warnings_of_copies(copies, "of another size")
    if len(graph.photos) < len(found.photos):
        cameras = run.cameras_of(graph.photos)
    with timed("mapping", run.seconds):
        graph, told = without_still_features(graph, _known_rows(cameras), front, run.progress)
        run.warnings += told
        graph = with_turned_cameras(graph, cameras)
        return Scene.of(graph, _with_guessed_focals(graph, cameras, run))


def _scene_of_tracks(tracks: ImageTracks, run: _Run, threads: int | None) -> Scene:
    cameras = run.cameras_of(photos_of(tracks))
    if run.cameras.calibration is None:
        known = np.isfinite(tracks.centres).all(axis=1)
        cameras.intrinsics[cameras.of_image[known], 2:4] = tracks.centres[known]
    with timed("matching", run.seconds):
        graph = graph_of_tracks(
            tracks, _known_rows(cameras), seed=run.settings.seed, threads=threads, progress=run.progress
        )
    return Scene(graph, _with_guessed_focals(graph, cameras, run), joined_tracks(tracks))


def _known_rows(cameras: Cameras) -> list[FloatArray | None]:
    """Intrinsics of each image; None where they are a guess."""
    return [None if cameras.guessed[g] else cameras.intrinsics[g] for g in cameras.of_image]


def _with_guessed_focals(graph: MatchGraph, cameras: Cameras, run: _Run) -> Cameras:
    """Estimate unknown focal lengths from the fundamental matrices of their images."""
    intrinsics, by_camera = cameras.intrinsics.copy(), graph.pairs_by_camera(cameras.of_image)
    for camera in np.flatnonzero(cameras.guessed).tolist():
        size = cameras.sizes[camera]
        # The focal length is sought for a principal point at the centre; a database may tell another.
        to_centre = size / 2 - intrinsics[camera, 2:4]
        pairs = [
            (
                graph.features[p.first].pixels[p.verified[:, 0]] + to_centre,
                graph.features[p.second].pixels[p.verified[:, 1]] + to_centre,
            )
            for p in graph.largest_general(by_camera[camera], MOST_PAIRS)
        ]
        (width, height), seed = size.tolist(), run.settings.seed
        found = focal_from_pairs(pairs, (width, height), seed=seed) if pairs else None
        if found is not None:
            intrinsics[camera, 0] = found
    return replace(cameras, intrinsics=intrinsics)


def _place_and_settle(found: SfmRun, scene: Scene, run: _Run, *, needed: bool) -> None:
    """Georeference the largest model and decide on focal lengths; Ctrl-C undoes the stage it ends."""
    undone = "the model was georeferenced: it is as it was before, without positions"
    try:
        if scene.positions is not None and found.model is not None:
            with timed("positions", run.seconds):
                _georeference(found, scene.positions, scene.cameras, run, needed=needed)
        undone = "focal lengths were judged: they are as they were before"
        _settle_focals(found, scene.cameras, run)
    except KeyboardInterrupt:
        found.interrupted = True
        found.warnings.append(f"interrupted while {undone}")


def _georeference(found: SfmRun, positions: Positions, cameras: Cameras, run: _Run, *, needed: bool) -> None:
    """Georeference the largest model; positions may prove useless, which costs nothing else of the run.

    They count in what determines focal lengths.
    """
    world = found.models[0]
    outcome: GpsOutcome | None = None

    def adjust() -> FloatArray | None:
        nonlocal outcome
        outcome = georeference_map(world, positions, run.settings)
        return outcome.intrinsics_sigmas

    try:
        with undone_by_an_error([world]):
            warnings = settle_focals_by_positions(world, cameras, run.settings, adjust)
            world.update_errors()
    except InvalidArgument as error:
        found.gps_failure = str(error) if needed else ""
        told = "were given" if needed else "the files tell"
        found.warnings.append(f"positions that {told} are not used: {error}")
        return
    found.gps = outcome
    found.warnings += [*warnings, *(outcome.warnings if outcome else [])]


def _settle_focals(found: SfmRun, cameras: Cameras, run: _Run) -> None:
    """Decide on focal lengths of the models that no position tells anything of."""
    models, warnings = found.models[0 if found.gps is None else 1 :], []
    with undone_by_an_error(models):
        for world in models:
            warnings += settle_focals_by_images(world, cameras, run.settings)
            world.update_errors()
    found.warnings += warnings


def _finished_run(
    source: Source, options: dict[str, Any], scene: Scene, grown: GrownModels, run: _Run
) -> SfmRun:
    for world in grown.models:
        world.update_errors()
        world.update_colors()
    # Found once: each looks at all pairs.
    contradicting = [contradicting_pairs(scene.graph, world, run.settings) for world in grown.models]
    name = str(source) if isinstance(source, (str, PathLike)) else "arrays"
    return SfmRun(
        name,
        options,
        scene.graph,
        grown.models,
        image_outcomes(scene.graph, grown),
        seconds=run.seconds,
        warnings=[
            *run.warnings,
            *warnings_of(scene.graph, grown, contradicting, run.settings),
            *guessed_focal_lengths(scene.cameras, grown, run.settings),
            *camera_warnings(grown.models, scene.cameras),
            *differing_focals(grown.models, contradicting, scene.cameras, run.settings, run.sharing),
        ],
        interrupted=grown.interrupted,
    )
