"""Notes on what a conversion between formats leaves out or changes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.metadata import LOOSE, SECOND_SIGHTINGS, WorldOrigin
from sfmcpp.sources.io.colmap.to_tables import changed_models
from sfmcpp.sources.io.format import Format
from sfmcpp.sources.io.intrinsics import has_distortion, has_square_pixels, pixels_without_inverse
from sfmcpp.sources.io.rrd import recorded_origin
from sfmcpp.sources.io.views import UNREGISTERED
from sfmcpp.wording import counted, first_few

_MOST_NAMES = 3
UNCERTAINTIES = "uncertainties of observations"


def left_out_on_reading(problem: Problem) -> Iterator[str]:
    """Sentences on what the file has and the problem has not."""
    if second := _extras(problem, SECOND_SIGHTINGS):
        total = problem.num_observations + second
        yield (
            f"{second:,} of {total:,} observations are second sightings of a point by one image, which count "
            "once: a COLMAP model that is written has them, a solve has not"
        )
    if count := _extras(problem, UNREGISTERED):
        images = counted(count, "image without a pose is", "images without a pose are")
        yield f"{images} left out: {first_few(problem.metadata.extra[UNREGISTERED], _MOST_NAMES)}"


def left_out_on_writing(problem: Problem, format: Format) -> list[str]:
    """What the problem has and files of the format have not: ``["40 points", "image names"]``."""
    amounts = {
        name: amount for name, amount in amounts_in(problem).items() if name in format.lacks and amount
    }
    return [name if amount is True else f"{amount:,} {name}" for name, amount in amounts.items()]


def changed_on_writing(problem: Problem, path: Path, format: Format) -> Iterator[str]:
    """Sentences on what files of the format have in another form."""
    if format.name in ("colmap-text", "colmap-binary"):
        for old, new in changed_models(problem, path):
            yield f"cameras of model {old} have become {new}, the smallest one with all that they need"
        if problem.metadata.image_sizes is None and "colmap_camera_sizes" not in problem.metadata.extra:
            yield "image sizes are not known: each is as large as its observations ask for"
    if format.name == "colmap-text" and any(len(name.split()) > 1 for name in problem.metadata.image_names):
        yield "COLMAP reads names of images with spaces wrongly from text, and right from binary files"
    if format.undistorts and has_distortion(problem):
        yield f"pixels are as cameras without distortion would have seen them: {format.name} has no other"
        if count := pixels_without_inverse(problem):
            yield (
                f"{count:,} of {problem.num_observations:,} observations are where the lens has no inverse, "
                "and are written as they are"
            )
    if format.name == "rerun" and (origin := recorded_origin(problem)).any():
        place = ", ".join(f"{number:.10g}" for number in origin)
        yield f"the world begins at {place}: a recording has single precision, too little so far from zero"
    if format.name == "nvm" and not has_square_pixels(problem):
        yield "pixels are as cameras of square pixels would have seen them: nvm has no other; the RMS changes"


def amounts_in(problem: Problem) -> dict[str, int]:
    """What a problem may have, by the names of `Format.lacks`: how many, or whether at all."""
    metadata = problem.metadata
    uncertainties = (problem.sigma_px, problem.covariance_px2)
    return {
        "points": problem.num_points,
        "observations": problem.num_observations,
        "keypoints without a point": _extras(problem, LOOSE[0]),
        "rotations and intrinsics": problem.num_cameras > 0,
        "image names": bool(metadata.image_names),
        "image sizes": metadata.image_sizes is not None,
        "colours": metadata.point_colors is not None,
        "masks": bool(problem.fixed_cameras.any() or problem.fixed_points.any()),
        "rigid frames": 0 if problem.rigs is None else problem.rigs.num_frames,
        "shared intrinsics": shares_free_intrinsics(problem),
        "origin of the world": WorldOrigin.of(metadata) is not None,
        UNCERTAINTIES: any(given is not None for given in uncertainties),
    }


def shares_free_intrinsics(problem: Problem) -> bool:
    """Whether cameras share what a solve would find: where each has its own, another problem is solved."""
    cameras_of_row = np.bincount(problem.intrinsics_index, minlength=len(problem.intrinsics))
    return bool((~problem.fixed_intrinsics[cameras_of_row > 1]).any())


def _extras(problem: Problem, name: str) -> int:
    return len(problem.metadata.extra.get(name, ()))
