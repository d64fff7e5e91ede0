"""Outcome of each image, and warnings for the user."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sfmcpp.model.photos import Photo
from sfmcpp.sfm.cameras import USUAL_FOCAL, Cameras
from sfmcpp.sfm.contradictions import (
    contradiction_warning,
    missing_matches_warning,
    pairs_with_missing_matches,
)
from sfmcpp.sfm.incremental import GrownModels
from sfmcpp.sfm.mask_checks import mask_warnings
from sfmcpp.sfm.match_graph import MatchGraph, Pair
from sfmcpp.sfm.result import ImageOutcome
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.sfm.still_features import stands_still
from sfmcpp.sfm.zoomed_images import zoom_warnings
from sfmcpp.sources.vision.images import jpeg_of_foreign, photos_of_video
from sfmcpp.sources.vision.photos import PhotoFolder
from sfmcpp.wording import counted, first_few

# How the warning begins that says why there is no model.
NO_MODEL = "no model: "
_FEW_FEATURES = 50
_MOST_NAMED = 3
_MOST_SIZES = 10


def image_outcomes(graph: MatchGraph, grown: GrownModels) -> dict[str, ImageOutcome]:
    """Outcome of each image: whether it has a pose, and why not.

    Parameters
    ----------
    graph : MatchGraph
        Images, features and pairs.
    grown : GrownModels
        Models.

    Returns
    -------
    dict
        By name, in the order of the images; those that could not be read follow.
    """
    best = _best_pairs(graph)
    result = {}
    for image, photo in enumerate(graph.photos):
        models = [number for number, world in enumerate(grown.models) if world.registered[image]]
        if models:
            result[photo.name] = ImageOutcome(True, models[0])
        else:
            result[photo.name] = ImageOutcome(
                False, None, _reason_without_pose(graph, grown, best.get(image), image)
            )
    for name, reason in graph.unreadable.items():
        result[name] = ImageOutcome(False, None, reason)
    return result


def _best_pairs(graph: MatchGraph) -> dict[int, Pair]:
    """Pair with most verified matches of each image."""
    best: dict[int, Pair] = {}
    for pair in graph.pairs:
        for image in (pair.first, pair.second):
            if image not in best or pair.num_verified > best[image].num_verified:
                best[image] = pair
    return best


def _reason_without_pose(graph: MatchGraph, grown: GrownModels, best: Pair | None, image: int) -> str:
    features = len(graph.features[image])
    if features < _FEW_FEATURES:
        where = "in it" if graph.photos[image].mask is None else "outside its mask"
        return f"almost no features were detected {where}: {features} features"
    if len(graph.photos) == 1:
        return "it is the only usable image; two are needed"
    if best is None:
        return "it was not matched with any other image"
    other = graph.photos[best.second if best.first == image else best.first].name
    if best.geometry.kind == "none":
        return f"it matches no other image: at most {len(best.matches)} matches, with {other}"
    if image in grown.reasons and grown.models:
        return grown.reasons[image]
    found = f"at most {best.num_verified} verified matches, with {other}"
    return f"it is in no suitable initial pair: {found}; {best.geometry.message or 'too few points'}"


def warnings_of_folder(folder: PhotoFolder) -> list[str]:
    """List what was left out of a folder before feature detection, and what is odd about its photos.

    Parameters
    ----------
    folder : PhotoFolder
        Photos, copies of them, videos, and photos of kinds that are not read.

    Returns
    -------
    list of str
    """
    warnings = warnings_of_copies(folder.copies, "byte for byte")
    if folder.videos:
        videos = counted(len(folder.videos), "video is", "videos are")
        names = first_few(folder.videos, _MOST_NAMED)
        warnings.append(f"{videos} not read: {names}; {photos_of_video(folder.videos[0])}")
    if folder.foreign:
        photos = counted(len(folder.foreign), "photo is of a kind", "photos are of kinds")
        few, advice = first_few(folder.foreign, _MOST_NAMED), jpeg_of_foreign(folder.foreign[0])
        warnings.append(f"{photos} not read here, and left out: {few}; {advice}")
    warnings += _warnings_of_mirrored([photo.name for photo in folder.photos if photo.is_mirrored])
    warnings += _warnings_of_panoramas([photo.name for photo in folder.photos if photo.is_panorama])
    return warnings + _warnings_of_further_images(folder.photos) + mask_warnings(folder)


def _warnings_of_mirrored(names: Sequence[str]) -> list[str]:
    if not names:
        return []
    photos = counted(len(names), "photo asks", "photos ask")
    return [
        f"{photos} by EXIF to be shown mirrored, first {names[0]}; pixels are used as they are stored: if "
        "these are mirrored, the model is a mirror image or lacks them; `mogrify -auto-orient` mends them"
    ]


def _warnings_of_panoramas(names: Sequence[str]) -> list[str]:
    if not names:
        return []
    photos = counted(len(names), "photo is a panorama", "photos are panoramas")
    return [
        f"{photos} by EXIF, XMP or their borders, first {names[0]}: no camera model fits, and the model may "
        "be wrong; leave them out, or cut views from those that show all around: `ffmpeg -i IN -vf "
        "v360=e:flat:yaw=90:h_fov=90:v_fov=90 OUT`"
    ]


def _warnings_of_further_images(photos: Sequence[Photo]) -> list[str]:
    several = [f"{photo.name} ({photo.further_images} more)" for photo in photos if photo.further_images]
    if not several:
        return []
    files, few = counted(len(several), "file holds", "files hold"), first_few(several, _MOST_NAMED)
    return [
        f"{files} more than one image, and only the first is used: {few}; save the others as files of their "
        "own"
    ]


def warnings_of_copies(copies: Mapping[str, str], how: str) -> list[str]:
    """Name what was left out as a copy of another photo; nothing if nothing was."""
    if not copies:
        return []
    few = first_few((f"{name} of {first}" for name, first in copies.items()), _MOST_NAMED)
    images = counted(len(copies), "image is a copy", "images are copies")
    return [f"{images}, {how}, and left out: {few}"]


def warnings_of(
    graph: MatchGraph,
    grown: GrownModels,
    contradicting: Sequence[list[Pair]],
    settings: IncrementalSettings,
) -> list[str]:
    """List warnings for the user.

    Parameters
    ----------
    graph : MatchGraph
        Images, features and pairs.
    grown : GrownModels
        Models.
    contradicting : sequence of list of Pair
        Pairs that contradict each model.
    settings : IncrementalSettings
        What an outlier is.

    Returns
    -------
    list of str
    """
    warnings = list(grown.warnings)
    closed = [name for name in graph.unreadable if name.endswith("/")]
    unreadable = len(graph.unreadable) - len(closed)
    images = len(graph.photos) + unreadable
    if unreadable:
        warnings.append(f"{unreadable} of {images} images cannot be read")
    if closed:
        warnings.append(f"folders cannot be read, nor what is in them: {', '.join(closed)}")
    if not grown.models:
        warnings.append(_why_no_model(graph))
    else:
        count = int(np.count_nonzero(grown.models[0].registered))
        if count < len(graph.photos):
            that = "usable " if graph.unreadable else ""
            warnings.append(f"the model is partial: it contains {count} of {len(graph.photos)} {that}images")
    for world, denying in zip(grown.models, contradicting, strict=True):
        if denying:
            warnings.append(contradiction_warning(graph, denying))
        elif missing := pairs_with_missing_matches(graph, world, settings):
            warnings.append(missing_matches_warning(graph, missing))
    warnings += zoom_warnings(graph, grown.models)
    if len(grown.models) > 1:
        sizes = _sizes_in_words([int(np.count_nonzero(world.registered)) for world in grown.models])
        warnings.append(f"the images form {len(grown.models)} separate models of {sizes}")
    return warnings


def _sizes_in_words(sizes: list[int]) -> str:
    """Sizes of models, the largest first; of many the largest and the smallest."""
    if len(sizes) <= _MOST_SIZES:
        return f"{', '.join(map(str, sizes))} images"
    return f"{sizes[-1]} to {sizes[0]} images each" if sizes[0] > sizes[-1] else f"{sizes[0]} images each"


def guessed_focal_lengths(cameras: Cameras, grown: GrownModels, settings: IncrementalSettings) -> list[str]:
    """Warn of cameras in models whose focal length is only a guess, or what pairs of few images tell.

    Parameters
    ----------
    cameras : Cameras
        What was known at the start.
    grown : GrownModels
        Models.
    settings : IncrementalSettings
        How many images a model needs before its focal lengths are adjusted.

    Returns
    -------
    list of str
        A sentence for each kind that there is.
    """
    usual = USUAL_FOCAL * cameras.sizes.max(axis=1, initial=0)
    guesses: dict[int, float] = {}
    rough: dict[int, float] = {}
    for world in grown.models:
        used = np.unique(world.image_cameras[world.registered])
        is_small = np.count_nonzero(world.registered) < settings.intrinsics_images
        for camera in used[cameras.guessed[used]].tolist():
            focal = float(world.intrinsics[camera, 0])
            if focal == usual[camera]:
                guesses[camera] = focal
            elif is_small:
                rough[camera] = focal
    return [
        *_focals_in_words(
            guesses, "is a guess", "too few images to determine it, the model may be distorted"
        ),
        *_focals_in_words(
            rough,
            "is only what pairs of images tell",
            "too few images to adjust it or a lens, it may be some percent off and the model distorted",
        ),
    ]


def _focals_in_words(focals: Mapping[int, float], is_what: str, so_what: str) -> list[str]:
    if not focals:
        return []
    number = "one camera" if len(focals) == 1 else f"{len(focals)} cameras"
    return [f"the focal length of {number} {is_what}, first {focals[min(focals)]:.0f} px: {so_what}"]


def _why_no_model(graph: MatchGraph) -> str:
    kinds = [pair.geometry.kind for pair in graph.pairs]
    if len(graph.photos) < 2:
        return f"{NO_MODEL}{len(graph.photos)} usable image, two are needed"
    if "general" in kinds or "planar" in kinds:
        return (
            f"{NO_MODEL}no two images see enough common points from sufficiently different positions; move "
            "the camera farther between photos, and mask what moves itself (--masks)"
        )
    turned = [pair for pair in graph.pairs if pair.geometry.kind == "rotation"]
    if turned and all(stands_still(graph, pair) for pair in turned):
        return f"{NO_MODEL}the camera did not move between these images; move it between photos"
    if turned:
        return (
            f"{NO_MODEL}the camera only turned, or the photos are identical; move the camera between photos"
        )
    return f"{NO_MODEL}no two of the {len(graph.photos)} images match"
