"""Images as the input of a SLAM run: their tracks, their camera, their times, and the truth beside them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from sfmcpp.cli.camera_files import find_intrinsics, places_beside
from sfmcpp.cli.slam_job import ImageOptions
from sfmcpp.errors import DatasetError
from sfmcpp.io.compression import read_bytes
from sfmcpp.io.failures import failures_named
from sfmcpp.io.number_text import NumberText
from sfmcpp.io.trajectories import read_trajectory
from sfmcpp.model import Trajectory
from sfmcpp.model.problem import FloatArray
from sfmcpp.slam import TrackSequence
from sfmcpp.vision import FeatureTracks, Frames, open_frames, track_features

_FOLDER_FPS = 10.0
_TIMES = "times.txt"
_TRUTH = "poses.txt"


def read_images(
    source: Path,
    options: ImageOptions,
    stamps: FloatArray | None = None,
    show: Callable[[int, int], None] | None = None,
) -> tuple[TrackSequence, Trajectory | None]:
    """Follow corners through a folder of images or a video.

    The images are taken to be free of distortion. The truth is ``poses.txt``, with the images or one folder
    above, where there is one.

    Parameters
    ----------
    source : Path
        The folder or the video.
    options : ImageOptions
        Camera and frame rate, where the user gives them.
    stamps : (n,) float64, optional
        Times of the first n images or more as the sensors know them [s]. With a frame rate in `options` only
        the first counts.
    show : callable, optional
        Called with the number of images looked at, and of all, after each.

    Returns
    -------
    sequence : TrackSequence
        Its times are, the first that there is: the frame rate of `options`, the stamps, ``times.txt``, the
        frame rate of the video, ten a second.
    truth : Trajectory or None
        As many poses as images, at their times unless it has its own.

    Raises
    ------
    DatasetError
        If an image cannot be read, or what is found beside the images does not fit them; without a camera, or
        a frame rate, it says where one can be put.
    """
    frames = open_frames(source)
    intrinsics = find_intrinsics(source) if options.intrinsics is None else np.array(options.intrinsics)
    # What can fail at once is tried before the images are looked at.
    _times(frames, len(frames), options, stamps)
    callback = None if show is None else lambda number: show(number + 1, len(frames))
    tracks = track_features(frames, callback=callback)
    _require_principal_point_inside(source, intrinsics, tracks)
    t_s = _times(frames, tracks.num_frames, options, stamps)
    sequence = TrackSequence(t_s, tracks.frame_index, tracks.track_index, tracks.pixels, intrinsics)
    return sequence, _truth(source, t_s)


def _times(frames: Frames, count: int, options: ImageOptions, stamps: FloatArray | None) -> FloatArray:
    if options.fps is not None:
        start = 0.0 if stamps is None else float(stamps[0])
        return start + np.arange(count) / options.fps
    if stamps is not None:
        if len(stamps) < count:
            reason = f"{count} images for {len(stamps)} stamps of the sensors' drive: give --fps"
            raise DatasetError(frames.path, reason)
        return stamps[:count]
    listed = next((p / _TIMES for p in places_beside(frames.path) if (p / _TIMES).is_file()), None)
    if listed is not None:
        return _listed_times(listed, count)
    return np.arange(count) / _own_fps(frames)


def _own_fps(frames: Frames) -> float:
    if frames.fps is not None:
        return frames.fps
    if frames.path.is_dir():
        return _FOLDER_FPS
    raise DatasetError(frames.path, "the video tells no frame rate: give --fps")


def _listed_times(path: Path, count: int) -> FloatArray:
    with failures_named(path):
        text = NumberText(path, read_bytes(path), comments=True)
    text.require_line_counts(text.lines.count == 1, "1, the time of an image in seconds")
    if len(text.values) != count:
        raise DatasetError(path, f"holds {len(text.values)} times for {count} images: must be as many")
    later = np.diff(text.values, prepend=-np.inf) > 0
    if not later.all():
        worst = int(np.argmin(later))
        raise text.error(f"time {text.values[worst]:.9g} s: must be later than the one before", worst)
    return text.values


def _truth(source: Path, t_s: FloatArray) -> Trajectory | None:
    path = next((p / _TRUTH for p in places_beside(source) if (p / _TRUTH).is_file()), None)
    if path is None:
        return None
    truth = read_trajectory(path)
    if truth.stamped:
        return truth
    if len(truth) != len(t_s):
        raise DatasetError(path, f"holds {len(truth)} poses for {len(t_s)} images: must be as many")
    return Trajectory(t_s, truth.poses)


def _require_principal_point_inside(source: Path, intrinsics: FloatArray, tracks: FeatureTracks) -> None:
    _, _, cx, cy, _ = intrinsics
    if not (0 < cx < tracks.width and 0 < cy < tracks.height):
        size = f"{tracks.width}×{tracks.height}"
        reason = f"the camera's principal point ({cx:g}, {cy:g}) lies outside of the images of {size} pixels"
        raise DatasetError(source, reason)
