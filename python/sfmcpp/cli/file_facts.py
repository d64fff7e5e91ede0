"""What files hold, each fact with its name: the lines of `sfmcpp info`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.model import Problem, SensorStream, Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.sources.io.files import is_folder

if TYPE_CHECKING:
    from sfmcpp.sources.frames import TrackSequence

Fact = tuple[str, str]


def of_problem(source: Path) -> Iterator[Fact]:
    """The format and the contents of a problem."""
    from sfmcpp.cli.reading import read_with_notes
    from sfmcpp.sources.io.api import format_of

    chosen = format_of(source)
    problem = read_with_notes(source)
    yield "format", f"{chosen.name}: {chosen.description}"
    yield from _contents(problem)


def _contents(problem: Problem) -> Iterator[Fact]:
    """What a problem has."""
    from sfmcpp.sources.io.conversion_notes import amounts_in

    cameras, points, seen = problem.num_cameras, problem.num_points, problem.num_observations
    yield "cameras", f"{cameras:,}, camera model {problem._model.name}"
    yield "intrinsics", _intrinsics(problem)
    if problem.metadata.image_sizes is not None and cameras:
        sizes = {f"{width}×{height}" for width, height in problem.metadata.image_sizes.tolist()}
        yield "image size", next(iter(sizes)) + " px" if len(sizes) == 1 else f"{len(sizes)} sizes"
    yield "points", f"{points:,}"
    each = (
        f": {seen / points:.1f} for a point, {seen / cameras:.0f} for a camera" if points and cameras else ""
    )
    yield "observations", f"{seen:,}{each}"
    if problem.rigs is not None:
        rigs = problem.rigs
        free = f", {rigs.free_sensors.sum():,} free" if rigs.free_sensors.any() else ""
        yield "rigs", f"{rigs.num_frames:,} frames of {rigs.num_sensors:,} sensors{free}"
    yield "world", _world(problem)
    fixed = int(problem.fixed_cameras.sum()), int(problem.fixed_points.sum())
    if any(fixed):
        yield "fixed", f"{fixed[0]:,} cameras, {fixed[1]:,} points"
    told = {"points", "observations", "rotations and intrinsics", "image sizes", "masks", "rigid frames"}
    told |= {"origin of the world", "shared intrinsics"}
    more = {name: amount for name, amount in amounts_in(problem).items() if amount and name not in told}
    if more:
        names = (name if amount is True else f"{amount:,} {name}" for name, amount in more.items())
        yield "also", ", ".join(names)


def _intrinsics(problem: Problem) -> str:
    names, rows = problem.intrinsic_names, len(problem.intrinsics)
    if not names:
        return "none apart from the projection matrices"
    free = [name for k, name in enumerate(names) if rows and not problem.fixed_intrinsics[:, k].all()]
    shared = "one row for each camera" if rows == problem.num_cameras else f"{rows:,} rows, shared by cameras"
    words = [shared if rows != 1 else "one row for all", f"free: {', '.join(free) or 'none'}"]
    if "f" in names and rows:
        focal = problem.intrinsics[:, names.index("f")]
        low, high = f"{focal.min():.6g}", f"{focal.max():.6g}"
        words.append(f"f = {low} px" if low == high else f"f = {low} to {high} px")
    return "; ".join(words)


def _world(problem: Problem) -> str:
    from sfmcpp.model.metadata import WorldOrigin

    if not problem.is_metric:
        return "projective"
    origin = WorldOrigin.of(problem.metadata)
    if origin is None:
        return "no origin: the file does not tell its unit and axes"
    place = ", ".join(f"{name} {number:.10g}" for name, number in origin.to_dict().items())
    return f"georeferenced, metres; origin at {place}"


def of_drive(source: Path) -> Iterator[Fact]:
    """A KITTI drive with its sensors."""
    from sfmcpp.sources.drives import tracks_of_kitti
    from sfmcpp.sources.io.kitti_mat import read_kitti_mat

    drive = read_kitti_mat(source)
    yield "format", "KITTI drive: tracks and sensors"
    yield from _sequence(tracks_of_kitti(drive))
    yield from _streams((drive.velocity, drive.angular_rate))
    yield "truth", _path(drive.truth)


def of_tracks(source: Path) -> Iterator[Fact]:
    """Tracks of a calibrated camera, with times."""
    from sfmcpp.sources.frames import TrackSequence
    from sfmcpp.sources.io.track_files import read_tracks

    tracks = read_tracks(source)
    yield "format", "tracks of a calibrated camera"
    yield from _sequence(TrackSequence(**vars(tracks)))


def of_image_tracks(source: Path) -> Iterator[Fact]:
    """Tracks of uncalibrated images."""
    from sfmcpp.sources.io.image_tracks import read_image_tracks

    found = read_image_tracks(source)
    yield "format", "tracks of uncalibrated images"
    yield "images", f"{found.num_images:,}"
    yield "tracks", f"{found.num_tracks:,}"
    yield "observations", f"{len(found.pixels):,}"


def _sequence(frames: TrackSequence) -> Iterator[Fact]:
    yield "frames", _span(frames.t_s)
    yield "tracks", f"{frames.num_tracks:,}"
    yield "camera", _camera(frames.intrinsics)


def of_euroc(source: Path) -> Iterator[Fact]:
    """A EuRoC sequence: images, rates, truth."""
    from sfmcpp.sources.drives import euroc_folder
    from sfmcpp.sources.io.sensor_csv import read_sensor_csv
    from sfmcpp.sources.io.trajectories import read_trajectory

    folder = euroc_folder(source)
    assert folder is not None
    yield "format", "euroc: images and sensors"
    yield from list(of_images(folder.images))[1:]
    if folder.rates is not None:
        yield from _streams(read_sensor_csv(folder.rates).values())
    if folder.truth is not None:
        yield "truth", _path(read_trajectory(folder.truth))


def of_images(source: Path) -> Iterator[Fact]:
    """Images or a video: number, size, times, camera."""
    from sfmcpp.sources.cameras import find_camera, read_intrinsics
    from sfmcpp.sources.frame_times import times_of_images
    from sfmcpp.sources.vision import open_frames

    images = open_frames(source)
    height, width = next(iter(images)).shape
    yield "format", "images" if is_folder(source) else "video"
    yield "images", f"{len(images):,}, the first of {width}×{height} px"
    time_of, assumed_fps, doubt = times_of_images(images, None, None)
    if assumed_fps is not None:
        yield "times", "none with the images"
    else:
        yield "times", _span(np.array([time_of(k) for k in range(images.fewest)]))
    if doubt is not None and assumed_fps is None:
        yield "doubt", doubt
    try:
        yield "camera", _camera(read_intrinsics(find_camera(source)))
    except DatasetError:
        yield "camera", "no calibration with the images"


def of_calibration(source: Path) -> Iterator[Fact]:
    """All cameras of a file, those too that are refused, with the reason."""
    from sfmcpp.sources.cameras import read_intrinsics
    from sfmcpp.sources.io.calibration import camera_names
    from sfmcpp.sources.io.documents import DOCUMENTS

    names = camera_names(source) if source.suffix.lower() in DOCUMENTS else [""]
    if names == [""]:
        read_intrinsics(source)
    yield "format", "calibration"
    for name in names:
        try:
            told = _camera(read_intrinsics(source.with_name(f"{source.name}:{name}") if name else source))
        except DatasetError as error:
            told = f"refused: {error.reason}"
        yield name or "camera", told


def of_photos(source: Path) -> Iterator[Fact]:
    """What EXIF tells of the photos of a folder."""
    from sfmcpp.sources.vision import open_photos

    photos = open_photos(source).photos
    focal = sum(photo.focal_px is not None for photo in photos)
    placed = sum(photo.position is not None for photo in photos)
    yield "EXIF", f"focal length in {focal:,}, GPS in {placed:,} of {len(photos):,}"


def of_sensors(source: Path) -> Iterator[Fact]:
    """The streams of a sensor file."""
    from sfmcpp.sources.io.sensor_csv import left_out_columns, read_sensor_csv

    streams = read_sensor_csv(source)
    yield "format", "sensor file"
    yield from _streams(streams.values())
    if ignored := left_out_columns(source):
        yield "left out", f"columns of unknown names: {', '.join(ignored)}"


def _streams(streams: Iterable[SensorStream]) -> Iterator[Fact]:
    from sfmcpp.model.sensor_stream import SENSORS

    for stream in streams:
        name = next(sensor for sensor, kinds in SENSORS.items() if stream.kind in kinds)
        count = len(stream.gaps())
        gaps = f", {count:,} gap{'s' * (count > 1)}" if count else ""
        yield name, f"{stream.kind.replace('_', ' ')}: {_span(stream.t_s)}{gaps}"
        if stream.left_out:
            yield "left out", f"of {stream.kind.replace('_', ' ')}: {stream.left_out}"


def of_control_points(source: Path) -> Iterator[Fact]:
    """Ground control points and their marks."""
    from sfmcpp.sources.io import read_control_points

    found = read_control_points(source)
    images = len({mark.image for mark in found.marks})
    sigmas = "without" if found.sigmas_m is None else "with"
    counts = f"{len(found.names):,}, {len(found.checks):,} of them check points"
    yield "format", "ground control points and their marks"
    yield "points", f"{counts}: {_axes(geodetic=found.geodetic)}, {sigmas} σ"
    yield "marks", f"{len(found.marks):,} in {images:,} images"


def of_positions(source: Path) -> Iterator[Fact]:
    """Positions of images."""
    from sfmcpp.sources.io.position_csv import read_position_csv

    found = read_position_csv(source, numbered=True)
    yield "format", "positions of images"
    sigmas = "without" if found.sigmas is None else "with"
    axes = _axes(geodetic=found.geodetic)
    yield "positions", f"{len(found.positions):,}: {axes}, {sigmas} standard deviations"
    if found.named_by != "name":
        yield "images by", found.named_by
    if found.unread:
        yield "not read", f"columns that seem to be standard deviations: {', '.join(found.unread)}"


def _axes(*, geodetic: bool) -> str:
    return "latitude, longitude, height" if geodetic else "x, y, z [m]"


def of_trajectory(source: Path) -> Iterator[Fact]:
    """A trajectory: poses, times, length."""
    from sfmcpp.sources.io.trajectories import read_trajectory

    found = read_trajectory(source)
    yield "format", "trajectory"
    yield "poses", _path(found)


def _path(found: Trajectory) -> str:
    times = _span(found.t_s) if found.stamped else f"{len(found):,} without times"
    return f"{times}, {found.length_m:.6g} long"


def _span(t_s: FloatArray) -> str:
    """How many, at which rate and how long."""
    if len(t_s) < 2:
        return f"{len(t_s):,}"
    rate_hz = 1.0 / np.median(np.diff(t_s))
    return f"{len(t_s):,} in {t_s[-1] - t_s[0]:.3f} s from {t_s[0]:.3f} s on, {rate_hz:.4g} Hz"


def _camera(intrinsics: FloatArray) -> str:
    f, aspect, cx, cy = intrinsics[:4]
    lens = ", with distortion" if len(intrinsics) > 5 else ""
    return f"f = {f:.6g} px, aspect {aspect:.6g}, principal point ({cx:.6g}, {cy:.6g}) px{lens}"
