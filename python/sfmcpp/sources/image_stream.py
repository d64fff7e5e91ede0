"""Frames of a camera by its images: corners are tracked through them, and found again in right images."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from sfmcpp.errors import DatasetError
from sfmcpp.geometry.pinhole import pinhole_rows
from sfmcpp.model import Trajectory
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.frames import Frame, View
from sfmcpp.sources.cameras import (
    doubt_of_size,
    file_beside,
    find_camera,
    intrinsics_of,
    read_camera,
    size_that_fits,
)
from sfmcpp.sources.frame_times import TimeOf, require_as_many, times_of_images
from sfmcpp.sources.frames import FrameSource, RightUse
from sfmcpp.sources.io.calibration import Calibration
from sfmcpp.sources.io.trajectories import read_trajectory
from sfmcpp.sources.right_images import RightImages
from sfmcpp.sources.stereo_pair import StereoArgument, right_images, stereo_pair
from sfmcpp.sources.vision import CORNERS, Frames, KltSettings, follow_features, open_frames, read_mask
from sfmcpp.sources.vision.images import GreyImage
from sfmcpp.sources.vision.masks import told_of_no_mask

T = TypeVar("T")

_TRUTH = "poses.txt"
# Images looked at while the caller works on one.
_AHEAD = 2

CameraArgument = str | PathLike[str] | Sequence[float] | None


class ImageStream(FrameSource):
    """Frames of a camera; images are read and corners tracked while the caller works on the frame before.

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
    right : RightImages, optional
        Those of a second camera.
    """

    def __init__(
        self,
        images: Frames,
        intrinsics: FloatArray,
        time_of: TimeOf,
        settings: KltSettings,
        mask: BoolArray | None = None,
        right: RightImages | None = None,
    ) -> None:
        self._mask, self._right = mask, right
        self._images, self._time_of, self._settings = images, time_of, settings
        self._count, self._last = len(images), len(images) - 1
        self._expected_s = self._span_to(self._last)
        self.intrinsics = intrinsics
        self.corners = settings.corners
        self.image_names = images.names
        self.first_pixel_px = 0.0  # as OpenCV and its calibrations have it
        self.seconds: float = 0.0
        self.repeated: list[int] = []
        self._unreadable: Mapping[str, str] = {}
        self._right_use: RightUse | None = None if right is None else right.use

    def identity(self) -> dict[str, Any]:
        """Camera, times, and how corners are followed; the same whether or not images have been read."""
        known = {"camera": self.intrinsics, "count": len(self._images), "times": self._expected_s}
        masked = {} if self._mask is None else {"mask": self._mask}
        right = {} if self._right is None else {"right": self._right.identity()}
        return {**known, "settings": self._settings, **masked, **right}

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
        self.num_tracks, self.seconds, self.repeated, self._unreadable = 0, 0.0, [], {}
        count, last = 0, self._last
        for seen in _taken_ahead(self._looked_at(), _AHEAD):
            self._note(seen)
            count, last = count + 1, seen.number
            yield Frame(seen.number, self._time_of(seen.number), seen.view)
        self._count, self._last = count, last
        self._unreadable, self.shortfall = self._images.unreadable, self._images.shortfall

    def _looked_at(self) -> Iterator[_Seen]:
        """What each image shows. In a thread of its own: nothing is told but by what it gives."""
        latest: tuple[int, GreyImage, bool] | None = None  # with whether it repeats the one before

        def images() -> Iterator[GreyImage]:
            nonlocal latest
            for number, image in self._images.numbered():
                latest = number, image, latest is not None and np.array_equal(image, latest[1])
                yield image

        right = self._right
        if right is not None:
            right.begin()
        started = time.perf_counter()
        for view in follow_features(images(), self._settings, self._mask):
            assert latest is not None
            number, image, repeats = latest
            both = view if right is None else right.beside(number, image, view)
            yield _Seen(
                number,
                both,
                image.shape,
                repeats,
                time.perf_counter() - started,
                dict(self._images.unreadable),
                None if right is None else right.use,
            )
            started = time.perf_counter()

    def _note(self, seen: _Seen) -> None:
        self.num_tracks = max(self.num_tracks, int(seen.view.tracks.max(initial=-1)) + 1)
        self.seconds += seen.seconds
        self.image_size = seen.shape[1], seen.shape[0]
        self.repeated += [seen.number] * seen.repeats
        self._unreadable, self._right_use = seen.unreadable, seen.right_use

    @property
    def unreadable(self) -> Mapping[str, str]:
        """Reason for each image left out so far because it cannot be read, by its name."""
        return self._unreadable

    @property
    def right_use(self) -> RightUse | None:  # type: ignore[override]
        """As of :class:`FrameSource`."""
        return self._right_use

    @property
    def right_doubts(self) -> Sequence[str]:  # type: ignore[override]
        """As of :class:`FrameSource`."""
        return () if self._right is None else self._right.doubts


class _Seen(NamedTuple):
    """An image that has been looked at: what it shows, and what is known by then."""

    number: int
    view: View
    shape: tuple[int, int]
    repeats: bool  # the image before, to the last bit
    seconds: float
    unreadable: Mapping[str, str]
    right_use: RightUse | None


def _taken_ahead(items: Iterator[T], count: int) -> Iterator[T]:
    """The same items; the next `count` are made in another thread while the caller works on one.

    Who stops early waits for these, so that as many have been made however long they take.
    """
    with ThreadPoolExecutor(1) as thread:
        waiting = deque(thread.submit(next, items, None) for _ in range(count))
        while (item := waiting.popleft().result()) is not None:
            waiting.append(thread.submit(next, items, None))
            yield item


def open_images(
    source: Path,
    camera: CameraArgument = None,
    fps: float | None = None,
    corners: str = CORNERS[0],
    stamps: FloatArray | None = None,
    mask: str | PathLike[str] | None = None,
    stereo: StereoArgument | None = None,
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
    stereo : StereoArgument, optional
        Take the right images of a pair, too, with what is told of them; see
        :mod:`sfmcpp.sources.stereo_pair`.

    Returns
    -------
    stream : ImageStream
        Its times are, the first that there is: `fps`, the stamps, ``times.txt``, KITTI's ``timestamps.txt``,
        EuRoC's ``data.csv``, names
        of images that are nanoseconds, the times or the rate of the video, ten a second; see
        :mod:`sfmcpp.sources.frame_times`. While it runs, it leaves out images of a folder that cannot be
        read, up to a tenth, and raises a DatasetError if they are more, or an image has no time.
    truth : Trajectory or None
        As many poses as images, at their times unless it has its own.

    Raises
    ------
    DatasetError
        If no image can be read, or what is found beside the images, or the camera, does not fit
        them; without a camera, a frame rate, or a right camera, it says where one can be put.
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
    right = None if stereo is None else _open_right(images, camera, intrinsics, size, settings, stereo)
    stream = ImageStream(images, intrinsics, time_of, settings, usable, right)
    stream.assumed_fps, stream.doubt = assumed_fps, doubt
    if usable is not None and usable.all():
        stream.mask_doubt = told_of_no_mask(1)
    if calibration.size is None:
        stream.camera_doubt = doubt_of_size(intrinsics, *size)
    return stream, truth


def _calibration(source: Path, camera: CameraArgument) -> Calibration:
    if camera is not None and not isinstance(camera, (str, PathLike)):
        return Calibration(intrinsics_of(camera))
    return read_camera(find_camera(source) if camera is None else Path(camera))


def _open_right(
    left: Frames,
    camera: CameraArgument,
    intrinsics: FloatArray,
    size: tuple[int, int],
    settings: KltSettings,
    told: StereoArgument,
) -> RightImages:
    right = open_frames(right_images(left.path, told))
    file = find_camera(left.path) if camera is None else camera_path(camera)
    pair = stereo_pair(left.path, right.path, intrinsics, file, told.baseline_m)
    found = size_that_fits(right, pair.right, None)
    if found != size:
        sizes = " pixels, those of the left camera ".join("×".join(map(str, s)) for s in (found, size))
        raise DatasetError(right.path, f"its images have {sizes}: must be the same size")
    return RightImages(right, left, pair, settings)


def camera_path(camera: CameraArgument) -> Path | None:
    """The file of a camera; None if it is told by numbers, or not at all."""
    return Path(camera) if isinstance(camera, (str, PathLike)) else None


def _truth(images: Frames, time_of: TimeOf) -> tuple[Trajectory | None, TimeOf]:
    """True poses beside the images, and the times of these; those of poses without stamps are the same."""
    path = file_beside(images.path, _TRUTH)
    truth = None if path is None else read_trajectory(path)
    if path is None or truth is None or truth.stamped:
        return truth, time_of
    require_as_many(path, len(truth), "poses", images)
    t_s = np.array([time_of(number) for number in range(len(truth))])
    return Trajectory(t_s, truth.poses), lambda k: float(t_s[k]) if k < len(t_s) else time_of(k)
