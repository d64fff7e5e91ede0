"""Frames of one camera: tracks read from a file, or corners tracked through images."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry.pinhole import PINHOLE, pinhole_rows
from sfmcpp.model import Trajectory
from sfmcpp.model.arrays import (
    ANY,
    BoolArray,
    FloatArray,
    IndexArray,
    finite_array,
    index_array,
    require_increasing,
    shaped_array,
)
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.model.checks import require_positive
from sfmcpp.model.frames import Frame, RightView, View
from sfmcpp.sources.cameras import (
    doubt_of_size,
    file_beside,
    find_camera,
    intrinsics_of,
    read_camera,
    size_that_fits,
)
from sfmcpp.sources.frame_times import TimeOf, require_as_many, times_of_images
from sfmcpp.sources.io.calibration import Calibration
from sfmcpp.sources.io.trajectories import read_trajectory
from sfmcpp.sources.vision import CORNERS, Frames, KltSettings, follow_features, open_frames, read_mask
from sfmcpp.sources.vision.images import GreyImage

_TRUTH = "poses.txt"
_DENSE_ENOUGH = 100_000
_DISTORTED = len(PERSPECTIVE)

CameraArgument = str | PathLike[str] | Sequence[float] | None


class FrameSource(ABC):
    """Source of frames, one after the other.

    Attributes
    ----------
    intrinsics : (5,) or (12,) float64
        ``(f, aspect, cx, cy, skew)`` of the camera; with distortion all of the model ``"perspective"``.
    num_tracks : int
        Tracks met so far.
    corners : str or None
        What is followed in images; None for tracks that were followed before.
    seconds : float or None
        Spent so far on reading images and following corners [s]; None where there are no images.
    assumed_fps : float or None
        Frames per second where nothing tells their times; None where something does.
    doubt : str or None
        What makes their times doubtful, a sentence.
    camera_doubt : str or None
        What makes the intrinsics doubtful, a sentence.
    image_size : tuple of int or None
        Width and height of the images [px], once one has been seen; None for tracks.
    image_names : sequence of str
        Names of the files, by the number of the frame; empty for tracks and videos.
    repeated : sequence of int
        Frames so far whose image is that of the frame before, to the last bit.
    shortfall : str or None
        As of :class:`sfmcpp.sources.vision.Frames`, once all frames have been seen.
    first_pixel_px : float
        Where the centre of the top left pixel is, in u and v [px]: 0.5 where pixels count from the corner of
        the image. Tracks are taken for such, as they do not tell.
    """

    intrinsics: FloatArray
    num_tracks: int = 0
    corners: str | None = None
    seconds: float | None = None
    assumed_fps: float | None = None
    doubt: str | None = None
    camera_doubt: str | None = None
    image_size: tuple[int, int] | None = None
    image_names: Sequence[str] = ()
    repeated: Sequence[int] = ()
    shortfall: str | None = None
    first_pixel_px: float = 0.5

    @property
    def assumption(self) -> str | None:
        """A sentence on the rate that is assumed; None where something tells the times."""
        if self.assumed_fps is None:
            return None
        return f"{self.assumed_fps:g} frames per second assumed: neither times.txt nor --fps is given"

    @property
    def unreadable(self) -> Mapping[str, str]:
        """Reason for each image left out so far because it cannot be read, by its name."""
        return MappingProxyType({})

    @property
    @abstractmethod
    def span_s(self) -> tuple[float, float]:
        """Times of the first frame and of the last one expected [s]."""

    def identity(self) -> dict[str, Any]:
        """Identity of these frames, as far as it is known before they are read."""
        return {"camera": self.intrinsics, "count": len(self), "times": self.span_s}

    @abstractmethod
    def __len__(self) -> int:
        """How many frames are expected."""

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """Give the frames in order; later ones have later times."""


class TrackSequence(FrameSource):
    """Tracks of one calibrated camera over n frames.

    Parameters
    ----------
    t_s : (n,)
        Time of each frame [s], increasing.
    frame_index, track_index : (M,) int
        Frame and track of each observation. A map has room for every number: where one is larger than M and
        than 100,000, tracks are numbered anew, in the order of their numbers.
    pixels : (M, 2)
        Where the frame sees the track [px].
    intrinsics : (5,) or (12,)
        ``(f, aspect, cx, cy, skew)``; with distortion all of the model ``"perspective"``.
    right_px : (M, 2), optional
        Where the right camera of a rectified pair sees it [px]; not a number where it does not.
    baseline_m : float, optional
        How far that is beside the left one [m].

    Raises
    ------
    InvalidArgument
        If there is no frame, a shape is wrong, a number is not finite, an index is out of range, the stamps
        do not increase, or a frame sees a track twice.
    """

    def __init__(
        self,
        t_s: ArrayLike,
        frame_index: ArrayLike,
        track_index: ArrayLike,
        pixels: ArrayLike,
        intrinsics: ArrayLike,
        right_px: ArrayLike | None = None,
        baseline_m: float | None = None,
    ) -> None:
        self.t_s = finite_array("t_s", t_s, (-1,))
        if not len(self.t_s):
            raise InvalidArgument("t_s: there is no frame, must be at least one")
        require_increasing("t_s", self.t_s)
        given = finite_array("intrinsics", intrinsics, (ANY,))
        width = _DISTORTED if len(given) == _DISTORTED else PINHOLE
        self.intrinsics = pinhole_rows(finite_array("intrinsics", given, (width,)))
        frames = index_array("frame_index", frame_index)
        tracks = index_array("track_index", track_index)
        seen = finite_array("pixels", pixels, (len(frames), 2))
        if len(tracks) != len(frames):
            raise InvalidArgument(f"track_index: {len(tracks)} entries for {len(frames)} observations")
        if len(frames) and not (frames.min() >= 0 and frames.max() < len(self.t_s)):
            raise InvalidArgument(f"frame_index: must be in [0, {len(self.t_s)})")
        if len(tracks) and tracks.min() < 0:
            raise InvalidArgument("track_index: must not be negative")
        tracks = _numbered_densely(tracks)
        order = np.lexsort((tracks, frames))
        self._tracks, self._pixels, ordered = tracks[order], seen[order], frames[order]
        self._right = None if right_px is None else _right_view(right_px, baseline_m, len(frames)).only(order)
        if ((np.diff(self._tracks) == 0) & (np.diff(ordered) == 0)).any():
            raise InvalidArgument("track_index: a frame sees a track twice")
        self._begin = np.searchsorted(ordered, np.arange(len(self.t_s) + 1))
        self.num_tracks = int(tracks.max()) + 1 if len(tracks) else 0

    def identity(self) -> dict[str, Any]:
        """All that they see."""
        seen = {"times": self.t_s, "tracks": self._tracks, "begin": self._begin, "pixels": self._pixels}
        right = {} if self._right is None else {"right": vars(self._right)}
        return {"camera": self.intrinsics, **seen, **right}

    def __len__(self) -> int:
        return len(self.t_s)

    def __iter__(self) -> Iterator[Frame]:
        return map(self.frame, range(len(self)))

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and of the last frame [s]."""
        return float(self.t_s[0]), float(self.t_s[-1])

    def frame(self, number: int) -> Frame:
        """Frame of that number."""
        return Frame(number, float(self.t_s[number]), self.view(number))

    def view(self, frame: int) -> View:
        """Observations of `frame`."""
        span = slice(self._begin[frame], self._begin[frame + 1])
        right = None if self._right is None else self._right.only(span)
        return View(self._tracks[span], self._pixels[span], right)


def _right_view(right_px: ArrayLike, baseline_m: float | None, count: int) -> RightView:
    pixels = shaped_array("right_px", right_px, (count, 2))
    if baseline_m is None:
        raise InvalidArgument("baseline_m: missing, right_px needs it")
    require_positive("baseline_m", baseline_m)
    return RightView(pixels, baseline_m)


class ImageStream(FrameSource):
    """Frames of a camera; images are read and corners tracked lazily.

    Parameters
    ----------
    images : Frames
        A folder or a video.
    intrinsics : (5,) or (12,) float64
        ``(f, aspect, cx, cy, skew)``; with distortion all of the model ``"perspective"``.
    time_of : callable
        Time of the image of that number [s].
    settings : KltSettings
        How corners are found and followed.
    mask : (height, width) bool, optional
        False where nothing is followed.
    """

    def __init__(
        self,
        images: Frames,
        intrinsics: FloatArray,
        time_of: TimeOf,
        settings: KltSettings,
        mask: BoolArray | None = None,
    ) -> None:
        self._mask = mask
        self._images, self._time_of, self._settings = images, time_of, settings
        self._count, self._last = len(images), len(images) - 1
        self._expected_s = self._span_to(self._last)
        self.intrinsics = intrinsics
        self.corners = settings.corners
        self.image_names = images.names
        self.first_pixel_px = 0.0  # as OpenCV and its calibrations have it
        self.seconds: float = 0.0
        self.repeated: list[int] = []

    def identity(self) -> dict[str, Any]:
        """Camera, times, and how corners are followed; the same whether or not images have been read."""
        known = {"camera": self.intrinsics, "count": len(self._images), "times": self._expected_s}
        masked = {} if self._mask is None else {"mask": self._mask}
        return {**known, "settings": self._settings, **masked}

    def __len__(self) -> int:
        """Frames expected; those that there were, once all have been seen."""
        return self._count

    @property
    def span_s(self) -> tuple[float, float]:
        """Times of the first image, and of the last one expected that has a time [s]."""
        return self._span_to(self._last)

    def _span_to(self, last: int) -> tuple[float, float]:
        first_s = self._time_of(0)
        try:
            return first_s, self._time_of(last)
        except DatasetError:  # the run tells which image has no time
            return first_s, first_s

    def __iter__(self) -> Iterator[Frame]:
        self.num_tracks, self.seconds = 0, 0.0
        numbers: list[int] = []
        self.repeated = []

        def images() -> Iterator[GreyImage]:
            before: GreyImage | None = None
            for number, image in self._images.numbered():
                numbers.append(number)
                if before is not None and np.array_equal(image, before):
                    self.repeated.append(number)
                before = image
                self.image_size = image.shape[1], image.shape[0]
                yield image

        stream = follow_features(images(), self._settings, self._mask)
        while (seen := self._timed_next(stream)) is not None:
            self.num_tracks = max(self.num_tracks, int(seen.tracks.max(initial=-1)) + 1)
            yield Frame(numbers[-1], self._time_of(numbers[-1]), seen)
        self._count, self._last = len(numbers), max(numbers, default=self._last)
        self.shortfall = self._images.shortfall

    @property
    def unreadable(self) -> Mapping[str, str]:
        """Reason for each image left out so far because it cannot be read, by its name."""
        return self._images.unreadable

    def _timed_next(self, stream: Iterator[View]) -> View | None:
        started = time.perf_counter()
        features = next(stream, None)
        self.seconds += time.perf_counter() - started
        return features


def open_images(
    source: Path,
    camera: CameraArgument = None,
    fps: float | None = None,
    corners: str = CORNERS[0],
    stamps: FloatArray | None = None,
    mask: str | PathLike[str] | None = None,
) -> tuple[ImageStream, Trajectory | None]:
    """Open a folder of images or a video; the first image that can be read is looked at.

    The truth is ``poses.txt``, with the images or one folder above, where there is one.

    Parameters
    ----------
    source : Path
        The folder or the video.
    camera : path-like or sequence of float, optional
        A file of :func:`sfmcpp.sources.cameras.read_intrinsics`, or ``(f, cx, cy)`` or ``(f, aspect, cx, cy,
        skew)`` in pixels, free of distortion. Default: ``calib.txt``, ``K.txt`` or ``sensor.yaml``, with the
        images or one folder above.
    fps : float, optional
        Images per second.
    corners : str
        What is followed, one of :data:`sfmcpp.sources.vision.CORNERS`.
    stamps : (n,) float64, optional
        Times of the first n images or more as the sensors know them [s]. With `fps` only the first counts.
    mask : path-like, optional
        An image of the size of the frames: nothing is followed where it is black, as on a car's own bonnet.

    Returns
    -------
    stream : ImageStream
        Its times are, the first that there is: `fps`, the stamps, ``times.txt``, EuRoC's ``data.csv``, names
        of images that are nanoseconds, the times or the rate of the video, ten a second; see
        :mod:`sfmcpp.sources.frame_times`. While it runs, it leaves out images of a folder that cannot be
        read, up to a tenth, and raises a DatasetError if they are more, or an image has no time.
    truth : Trajectory or None
        As many poses as images, at their times unless it has its own.

    Raises
    ------
    DatasetError
        If no image can be read, or what is found beside the images, or the camera, does not fit
        them; without a camera, or a frame rate, it says where one can be put.
    InvalidArgument
        If `camera` is none, `fps` is not positive, or there are no such `corners`.
    """
    settings = KltSettings(corners=corners)
    images = open_frames(source)
    calibration = _calibration(source, camera)
    intrinsics = pinhole_rows(calibration.intrinsics)
    time_of, assumed_fps, doubt = times_of_images(images, fps, stamps)
    truth, time_of = _truth(images, time_of)
    size = size_that_fits(images, intrinsics, calibration.size)
    usable = None if mask is None else read_mask(Path(mask), size, "the frames")
    stream = ImageStream(images, intrinsics, time_of, settings, usable)
    stream.assumed_fps, stream.doubt = assumed_fps, doubt
    if calibration.size is None:
        stream.camera_doubt = doubt_of_size(intrinsics, *size)
    return stream, truth


def _calibration(source: Path, camera: CameraArgument) -> Calibration:
    if camera is not None and not isinstance(camera, (str, PathLike)):
        return Calibration(intrinsics_of(camera))
    return read_camera(find_camera(source) if camera is None else Path(camera))


def _numbered_densely(tracks: IndexArray) -> IndexArray:
    if tracks.max(initial=-1) <= max(len(tracks), _DENSE_ENOUGH):
        return tracks
    return np.unique(tracks, return_inverse=True)[1].astype(np.int32)


def _truth(images: Frames, time_of: TimeOf) -> tuple[Trajectory | None, TimeOf]:
    """True poses beside the images, and the times of these; those of poses without stamps are the same."""
    path = file_beside(images.path, _TRUTH)
    truth = None if path is None else read_trajectory(path)
    if path is None or truth is None or truth.stamped:
        return truth, time_of
    require_as_many(path, len(truth), "poses", images)
    t_s = np.array([time_of(number) for number in range(len(truth))])
    return Trajectory(t_s, truth.poses), lambda k: float(t_s[k]) if k < len(t_s) else time_of(k)
