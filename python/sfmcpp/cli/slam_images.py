"""Images as the input of a SLAM run: what they see frame by frame, their camera, their times, the truth."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from sfmcpp.cli.camera_files import find_intrinsics, places_beside
from sfmcpp.cli.slam_job import ImageOptions
from sfmcpp.errors import DatasetError
from sfmcpp.model import Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.slam import Frame, View
from sfmcpp.sources.io.compression import read_bytes
from sfmcpp.sources.io.failures import failures_named
from sfmcpp.sources.io.number_text import NumberText
from sfmcpp.sources.io.trajectories import read_trajectory
from sfmcpp.sources.vision import FrameFeatures, Frames, KltSettings, follow_features, open_frames

_FOLDER_FPS = 10.0
_TIMES = "times.txt"
_TRUTH = "poses.txt"

TimeOf = Callable[[int], float]


class ImageStream:
    """Frames of a camera, each image read and its corners followed when the frame is asked for.

    Parameters
    ----------
    images : Frames
        A folder or a video.
    intrinsics : (5,) float64
        ``(f, aspect, cx, cy, skew)``.
    time_of : callable
        Time of the image of that number [s].
    settings : KltSettings
        How corners are found and followed.

    Attributes
    ----------
    num_tracks : int
        Tracks met so far.
    seconds : float
        Spent so far on reading images and following corners [s].
    """

    def __init__(
        self, images: Frames, intrinsics: FloatArray, time_of: TimeOf, settings: KltSettings
    ) -> None:
        self._images, self._time_of, self._settings = images, time_of, settings
        self._count = len(images)
        self.intrinsics = intrinsics
        self.num_tracks = 0
        self.seconds = 0.0

    def __len__(self) -> int:
        """Frames expected; those that there were, once all have been seen."""
        return self._count

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first image, and of the last one expected that has a time [s]."""
        first_s = self._time_of(0)
        try:
            return first_s, self._time_of(self._count - 1)
        except DatasetError:  # the run tells which image has no time
            return first_s, first_s

    def __iter__(self) -> Iterator[Frame]:
        self.num_tracks, self.seconds, number = 0, 0.0, 0
        stream = follow_features(self._images, self._settings)
        while (seen := self._timed_next(stream)) is not None:
            self.num_tracks = max(self.num_tracks, int(seen.tracks.max(initial=-1)) + 1)
            yield Frame(number, self._time_of(number), View(seen.tracks, seen.pixels))
            number += 1
        self._count = number

    def _timed_next(self, stream: Iterator[FrameFeatures]) -> FrameFeatures | None:
        started = time.perf_counter()
        features = next(stream, None)
        self.seconds += time.perf_counter() - started
        return features


def open_images(
    source: Path, options: ImageOptions, stamps: FloatArray | None = None
) -> tuple[ImageStream, Trajectory | None]:
    """Open a folder of images or a video; the first image is looked at, and no other.

    The images are taken to be free of distortion. The truth is ``poses.txt``, with the images or one folder
    above, where there is one.

    Parameters
    ----------
    source : Path
        The folder or the video.
    options : ImageOptions
        Camera, frame rate and corners, where the user gives them.
    stamps : (n,) float64, optional
        Times of the first n images or more as the sensors know them [s]. With a frame rate in `options` only
        the first counts.

    Returns
    -------
    stream : ImageStream
        Its times are, the first that there is: the frame rate of `options`, the stamps, ``times.txt``, the
        frame rate of the video, ten a second. While it runs, it raises a DatasetError that names the image
        which cannot be read, or has no time.
    truth : Trajectory or None
        As many poses as images, at their times unless it has its own.

    Raises
    ------
    DatasetError
        If the first image cannot be read, or what is found beside the images does not fit them; without a
        camera, or a frame rate, it says where one can be put.
    """
    images = open_frames(source)
    intrinsics = find_intrinsics(source) if options.intrinsics is None else np.array(options.intrinsics)
    time_of = _time_of(images, options, stamps)
    truth = _truth(images, time_of)
    _require_principal_point_inside(images, intrinsics)
    return ImageStream(images, intrinsics, time_of, KltSettings(corners=options.corners)), truth


def _time_of(images: Frames, options: ImageOptions, stamps: FloatArray | None) -> TimeOf:
    if options.fps is not None:
        return _even(options.fps, 0.0 if stamps is None else float(stamps[0]))
    if stamps is not None:
        if len(stamps) < len(images):
            reason = f"{len(images)} images for {len(stamps)} stamps of the sensors' drive: give --fps"
            raise DatasetError(images.path, reason)
        return _looked_up(images.path, stamps)
    listed = _beside(images.path, _TIMES)
    if listed is not None:
        return _looked_up(images.path, _listed_times(listed, images))
    return _even(_own_fps(images))


def _even(fps: float, start_s: float = 0.0) -> TimeOf:
    return lambda number: start_s + number / fps


def _looked_up(source: Path, t_s: FloatArray) -> TimeOf:
    def time_of(number: int) -> float:
        if number >= len(t_s):
            raise DatasetError(source, f"image {number} has no time: {len(t_s)} are known; give --fps")
        return float(t_s[number])

    return time_of


def _own_fps(images: Frames) -> float:
    if images.fps is not None:
        return images.fps
    if images.path.is_dir():
        return _FOLDER_FPS
    raise DatasetError(images.path, "the video tells no frame rate: give --fps")


def _beside(source: Path, name: str) -> Path | None:
    return next((place / name for place in places_beside(source) if (place / name).is_file()), None)


def _listed_times(path: Path, images: Frames) -> FloatArray:
    with failures_named(path):
        text = NumberText(path, read_bytes(path), comments=True)
    text.require_line_counts(text.lines.count == 1, "1, the time of an image in seconds")
    _require_as_many(path, len(text.values), "times", images)
    later = np.diff(text.values, prepend=-np.inf) > 0
    if not later.all():
        worst = int(np.argmin(later))
        raise text.error(f"time {text.values[worst]:.9g} s: must be later than the one before", worst)
    return text.values


def _truth(images: Frames, time_of: TimeOf) -> Trajectory | None:
    path = _beside(images.path, _TRUTH)
    if path is None:
        return None
    truth = read_trajectory(path)
    if truth.stamped:
        return truth
    _require_as_many(path, len(truth), "poses", images)
    return Trajectory(np.array([time_of(number) for number in range(len(truth))]), truth.poses)


def _require_as_many(path: Path, count: int, what: str, images: Frames) -> None:
    """As many as images; what a video says of itself can be a few too many."""
    if count not in range(images.fewest, len(images) + 1):
        raise DatasetError(path, f"holds {count} {what} for {len(images)} images: must be as many")


def _require_principal_point_inside(images: Frames, intrinsics: FloatArray) -> None:
    _, _, cx, cy, _ = intrinsics
    height, width = next(iter(images)).shape
    if not (0 < cx < width and 0 < cy < height):
        size = f"{width}×{height}"
        reason = f"the camera's principal point ({cx:g}, {cy:g}) lies outside of the images of {size} pixels"
        raise DatasetError(images.path, reason)
