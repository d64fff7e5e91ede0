"""The files of a reconstruction."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.threads import on_threads
from sfmcpp.sources.io.colmap import binary, text
from sfmcpp.sources.io.colmap.formats import ORIGIN, write_colmap_of_both_kinds
from sfmcpp.sources.io.files import failures_named, is_folder, is_present
from sfmcpp.sources.io.ply import write_ply
from sfmcpp.sources.io.transforms import folder_from, write_transforms
from sfmcpp.study.pages.model_page import ModelScene, corners_at_distance_one, save_model_page
from sfmcpp.study.pages.parts import save_page
from sfmcpp.study.pages.sfm_page import sfm_page
from sfmcpp.study.report_files import MODEL, POINTS, REPORT, VIEW, Step, write_report, write_steps

if TYPE_CHECKING:
    from sfmcpp.study.sfm_measures import ModelMeasures
    from sfmcpp.study.sfm_report import SfmReport

_MODEL_FILES = (*text.FILES, *binary.FILES, ORIGIN)
TIMINGS, PAGE, TRANSFORMS = "timings.json", "report.html", "transforms.json"
FILES = (REPORT, TIMINGS, PAGE, VIEW, TRANSFORMS, POINTS)
# Reading photos takes time, and pictures make pages large.
MOST_THUMBNAILS = 1000
_READERS = 4


def write_files(report: SfmReport, folder: Path) -> list[Path]:
    """Write all files of a reconstruction, also after one fails; without a model, report and page alone.

    Beside the model of an earlier run these would tell of what is not there: then nothing is written.

    Raises
    ------
    DatasetError
        If any could not be written.
    """
    if not report.run.models and is_present(folder / MODEL):
        return []
    written = write_steps(_steps(report), folder)
    if report.run.models:
        _remove_further_models(folder, len(report.run.models))
    return written


def _remove_further_models(folder: Path, number: int) -> None:
    """Remove what an earlier run has written as model `number` and behind: they are no part of this one."""
    while is_folder(old := folder / f"{MODEL}_{number}"):
        with failures_named(old):
            for name in _MODEL_FILES:
                (old / name).unlink(missing_ok=True)
        with suppress(OSError):  # what else is in it is not ours
            old.rmdir()
        number += 1


def _steps(report: SfmReport) -> Iterator[Step]:
    pictures = _Pictures(report)
    for number in range(len(report.run.models)):
        problem = report.run.problem(number)
        name = MODEL if number == 0 else f"{MODEL}_{number}"
        yield name, partial(_write_model, problem)
        if number == 0:
            yield TRANSFORMS, partial(_write_transforms, report, problem)
            yield POINTS, partial(write_ply, problem, cameras=False)
            yield VIEW, lambda path: save_model_page(_scene(report, pictures.by_name), path)
    yield REPORT, lambda path: write_report(report.to_dict(), path)
    yield TIMINGS, lambda path: write_report(report.timings(), path)
    yield PAGE, lambda path: save_page(sfm_page(report, pictures.by_name), path)


def _write_model(problem: Problem, folder: Path) -> None:
    with failures_named(folder):
        write_colmap_of_both_kinds(problem, folder)


def _write_transforms(report: SfmReport, problem: Problem, path: Path) -> None:
    """Write the cameras, with the places of the photos and of the points as seen from the folder."""
    source = Path(report.run.source)
    write_transforms(problem, path, folder_from(path, source) if is_folder(source) else "", points=POINTS)


class _Pictures:
    """Thumbnails of the photos, made once on request."""

    def __init__(self, report: SfmReport) -> None:
        self._report = report

    @cached_property
    def by_name(self) -> dict[str, bytes]:
        photos = self._report.run.graph.photos
        chosen = photos[:: max(1, -(-len(photos) // MOST_THUMBNAILS))]
        make: Callable[..., bytes | None] = self._report.thumbnail
        made = on_threads(make, chosen, _READERS)
        return {photo.name: jpeg for photo, jpeg in zip(chosen, made, strict=True) if jpeg}


def _scene(report: SfmReport, thumbnails: dict[str, bytes]) -> ModelScene:
    run, measures = report.run, report.measures[0]
    world = measures.world
    images, known = np.flatnonzero(world.registered), world.known
    facts = {
        "images": f"{run.num_registered:,} of {len(run.images):,}",
        "points": f"{measures.num_points:,}",
    }
    if measures.mean_error_px is not None:
        facts["mean error of observations"] = f"{measures.mean_error_px:.3f} px"
        facts["mean error of points (COLMAP's mean)"] = f"{measures.mean_point_error_px:.3f} px"
    return ModelScene(
        report.title,
        world.points[known],
        world.point_colors[known],
        world.poses[images],
        image_corners(measures, images),
        [world.image_names[i] for i in images],
        [_image_note(report, int(i)) for i in images],
        [thumbnails.get(world.image_names[i]) for i in images],
        facts,
        "m" if run.gps is not None else "",
        run.gps is not None,
    )


def image_corners(measures: ModelMeasures, images: NDArray[np.intp]) -> FloatArray:
    """(i, 4) left, top, right and bottom of images at distance 1 from their cameras, without distortion."""
    world = measures.world
    rows = []
    for camera in world.image_cameras[images].tolist():
        values = measures.intrinsics_of(camera)
        f, cx, cy = values["f"], values.get("cx", 0.0), values.get("cy", 0.0)
        width, height = world.camera_sizes[camera].tolist()
        if not (width and height):
            width, height = (2 * cx, 2 * cy) if min(cx, cy) > 0 else (f, 0.75 * f)
        if "cx" not in values:  # pixels counted from the middle
            cx, cy = width / 2, height / 2
        rows.append((f, values.get("aspect", 1.0), cx, cy, width, height))
    return corners_at_distance_one(*np.array(rows, dtype=np.float64).reshape(-1, 6).T)


def _image_note(report: SfmReport, image: int) -> str:
    measures = report.measures[0]
    count = int(measures.observations_of_images[image])
    note = f"{count:,} observations"
    if count:
        note += f", mean error {measures.errors_of_images_px[image]:.3f} px"
    residual = (report.run.gps.residuals_m if report.run.gps else {}).get(measures.world.image_names[image])
    return note if residual is None else f"{note}, {residual:.2f} m from its GPS position"
