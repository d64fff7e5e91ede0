"""Report of a reconstruction, as text, plain values and files."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sfmcpp.model.process_state import peak_memory_bytes
from sfmcpp.sfm.outcome import NO_MODEL
from sfmcpp.study.report_files import plain
from sfmcpp.study.report_table import NAMES_LISTED, ReportTable, gps_rows, grouped_by_reason, listed_names
from sfmcpp.study.sfm_measures import ModelMeasures

if TYPE_CHECKING:
    from sfmcpp.model.photos import Photo
    from sfmcpp.sfm import Pair, SfmRun

# Small picture of a photo as JPEG; None if it cannot be made.
Thumbnail = Callable[["Photo"], "bytes | None"]

# Longest side of a small picture.
THUMBNAIL_PX = 256
# How a run was carried out changes no result: the report leaves it out, so that it is the same for all.
_OF_THE_MACHINE = frozenset({"threads", "resume", "cache", "progress"})
_REASONS_LISTED = 5
_ERRORS = ("rms_px", "mean_error_px", "mean_point_error_px", "mean_track_length")
_FOLDERS_OF_ANY_SET = frozenset({"images", "photos", "pictures", "img", "jpg"})


class SfmReport(ReportTable):
    """Report of a reconstruction, as text, plain values and files.

    Parameters
    ----------
    run : SfmRun
        What :func:`sfmcpp.sfm.reconstruct` returned.
    thumbnail : callable, optional
        Makes the small picture of a photo: JPEG bytes, or None. Default: from its file, where it has one.
    """

    def __init__(self, run: SfmRun, thumbnail: Thumbnail | None = None) -> None:
        self.run = run
        self.thumbnail = thumbnail_of_file if thumbnail is None else thumbnail

    @cached_property
    def measures(self) -> list[ModelMeasures]:
        """Figures of each model."""
        sigmas = None if self.run.gps is None else self.run.gps.intrinsics_sigmas
        models = self.run.models
        return [ModelMeasures(world, None if number else sigmas) for number, world in enumerate(models)]

    @property
    def title(self) -> str:
        """Name of the set: of its folder, or of the one above where that is called "images" or the like."""
        path = Path(self.run.source)
        named = path.parent if path.name.lower() in _FOLDERS_OF_ANY_SET and path.parent.name else path
        return named.name or str(self.run.source)

    @property
    def is_partial(self) -> bool:
        """Whether images are missing from the largest model."""
        return 0 < self.run.num_registered < len(self.run.images)

    def left_out(self) -> dict[str, list[str]]:
        """Names of the images without a pose in the largest model, by the reason; the most frequent first."""
        found: list[tuple[str, str]] = []
        for name, outcome in self.run.images.items():
            if not outcome.registered:
                found.append((outcome.reason, name))
            elif outcome.model:
                found.append((f"in model {outcome.model}, which is not connected to the largest", name))
        return grouped_by_reason(found)

    def verdict(self) -> str:
        """Sentence on how many images are in the model, and why others are not."""
        run = self.run
        if run.model is None:
            text = f"{NO_MODEL}none of {len(run.images):,} images could be registered"
        else:
            text = f"{run.num_registered:,} of {len(run.images):,} images are in the model"
        reasons = [f"{listed_names(names)}: {reason}" for reason, names in self.left_out().items()]
        if len(reasons) > _REASONS_LISTED:
            reasons[_REASONS_LISTED:] = [f"and {len(reasons) - _REASONS_LISTED:,} more reasons"]
        text = f"{text} ({'; '.join(reasons)})" if reasons else text
        return "; ".join([text, *(w.removeprefix(NO_MODEL) for w in run.warnings if w.startswith(NO_MODEL))])

    def to_dict(self) -> dict[str, Any]:
        """All of it as plain values; what is not finite is None.

        It is the same for every run with the same input, options and seed; how long it took is
        :meth:`timings`.
        """
        run, graph = self.run, self.run.graph
        largest = self.measures[0].to_dict() if self.measures else {}
        content = {
            "input": {
                "path": str(run.source),
                "images": len(run.images),
                "features": int(sum(map(len, graph.features))),
                "pairs": len(graph.pairs),
            },
            "options": self.options(),
            "interrupted": run.interrupted,
            "warnings": list(run.warnings),
            "counts": {
                "registered": run.num_registered,
                "models": len(run.models),
                **{name: largest.get(name, 0) for name in ("points", "observations")},
            },
            **{name: largest.get(name) for name in _ERRORS},
            "track_lengths": largest.get("track_lengths", {}),
            "cameras": largest.get("cameras", []),
            "models": [measures.to_dict() for measures in self.measures],
            "gps": None if self.run.gps is None else self.run.gps.to_dict(),
            "images": self.images(),
            "pairs": [self.pair(pair) for pair in graph.pairs],
        }
        found: dict[str, Any] = plain(content)
        return found

    def timings(self) -> dict[str, dict[str, float]]:
        """Wall time of each stage and of all [s]."""
        seconds = self.run.seconds
        return {"seconds": {**seconds, "total": sum(seconds.values())}}

    def options(self) -> dict[str, Any]:
        """Options of the run that affect its result; paths as text."""
        given = {key: value for key, value in self.run.options.items() if key not in _OF_THE_MACHINE}
        return {key: str(value) if isinstance(value, PathLike) else value for key, value in given.items()}

    def images(self) -> dict[str, dict[str, Any]]:
        """Outcome of each image, by name."""
        numbers = {photo.name: number for number, photo in enumerate(self.run.graph.photos)}
        residuals = self.run.gps.residuals_m if self.run.gps else {}
        found = {}
        for name, outcome in self.run.images.items():
            number = numbers.get(name)
            entry: dict[str, Any] = {
                "registered": outcome.registered,
                "model": outcome.model,
                "reason": outcome.reason,
                "keypoints": 0 if number is None else len(self.run.graph.features[number]),
                "observations": 0,
                "mean_error_px": None,
            }
            if number is not None and outcome.registered:
                measures = self.measures[outcome.model or 0]
                entry["observations"] = int(measures.observations_of_images[number])
                entry["mean_error_px"] = float(measures.errors_of_images_px[number])
                entry["camera"] = int(measures.world.camera_ids[measures.world.image_cameras[number]])
            if name in residuals:
                entry["gps_residual_m"] = residuals[name]
            found[name] = entry
        return found

    def pair(self, pair: Pair) -> dict[str, Any]:
        """Outcome of a pair of images."""
        photos, geometry = self.run.graph.photos, pair.geometry
        return {
            "first": photos[pair.first].name,
            "second": photos[pair.second].name,
            "matches": len(pair.matches),
            "inliers": int(np.count_nonzero(geometry.inliers)),
            "kind": geometry.kind,
            "median_angle_deg": geometry.median_angle_deg,
            "reason": geometry.message,
        }

    def write(self, folder: str | PathLike[str]) -> list[Path]:
        """Write models, report and pages; without a model the report and its page alone.

        Without a model, nothing is written into a folder that has one of an earlier run.

        Parameters
        ----------
        folder : path-like
            Where to, made if missing; files of these names are replaced, and further models of an earlier run
            removed. Others are left alone.

        Returns
        -------
        list of Path
            What was written.

        Raises
        ------
        DatasetError
            If a file could not be written; the others are.
        """
        from sfmcpp.study.sfm_files import write_files

        return write_files(self, Path(folder))

    def _rows(self) -> Iterator[tuple[str, str]]:
        run, graph = self.run, self.run.graph
        yield "input", str(run.source)
        yield "images", f"{run.num_registered:,} of {len(run.images):,} in the model"
        reasons = list(self.left_out().items())
        for reason, names in reasons[:_REASONS_LISTED]:
            yield "left out", f"{listed_names(names)}: {reason}"
        if len(reasons) > _REASONS_LISTED:
            yield "left out", f"and {len(reasons) - _REASONS_LISTED:,} more reasons"
        matched = sum(pair.geometry.kind != "none" for pair in graph.pairs)
        yield "pairs", f"{matched:,} of {len(graph.pairs):,} match"
        for number, measures in enumerate(self.measures):
            yield "model" if number == 0 else f"model {number}", _model_line(measures)
        for measures in self.measures[:1]:
            for camera in measures.cameras[:NAMES_LISTED]:
                yield "camera", camera_line(measures, camera)
            if len(measures.cameras) > NAMES_LISTED:
                yield "camera", f"and {len(measures.cameras) - NAMES_LISTED:,} more"
        if run.gps is not None:
            yield from gps_rows(run.gps)
        stages = ", ".join(f"{name} {seconds:.1f}" for name, seconds in run.seconds.items())
        yield "seconds", f"{sum(run.seconds.values()):.1f} ({stages})"
        yield "peak memory", f"{peak_memory_bytes() / 1e6:.0f} MB"
        for warning in run.warnings:
            yield "warning", warning


def thumbnail_of_file(photo: Photo) -> bytes | None:
    """Make the small picture of a photo from its file; None if there is none, or it cannot be read."""
    if photo.path is None:
        return None
    from sfmcpp.errors import SfmcppError
    from sfmcpp.sources.vision.photos import thumbnail_jpeg

    try:
        return thumbnail_jpeg(photo, THUMBNAIL_PX)
    except (SfmcppError, ImportError, OSError):
        return None


def camera_line(measures: ModelMeasures, camera: int) -> str:
    """Description of a camera in a line: its model, focal length and distortion."""
    facts = measures.camera_dict(camera)
    sigma = facts["sigma"].get("f")
    focal = f"focal length {facts['focal_px']:.2f} px" + (f" ± {sigma:.2g}" if sigma else "")
    distortion = "".join(f", {name} {value:.4g}" for name, value in facts["distortion"].items())
    count = facts["images"]
    aspect = f", aspect {facts['aspect']:.5g}" if facts["aspect"] != 1 else ""
    return f"{facts['model']}, {focal}{aspect}{distortion}, {count:,} image{'s' * (count != 1)}"


def _model_line(measures: ModelMeasures) -> str:
    counts = f"{measures.num_images:,} images, {measures.num_points:,} points"
    if measures.mean_error_px is None:
        return counts
    return (
        f"{counts}, mean error {measures.mean_error_px:.3f} px of observations, "
        f"{measures.mean_point_error_px:.3f} px of points (COLMAP's mean), "
        f"RMS length {measures.rms_px:.3f} px"
    )
