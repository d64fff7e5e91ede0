"""Frames of a camera: the images of a folder, or those of a video, as grey levels."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from os import PathLike
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.model.arguments import checked
from sfmcpp.model.photos import natural_order
from sfmcpp.sources.io.files import (
    failures_named,
    is_folder,
    require_present,
    require_regular_file,
)
from sfmcpp.sources.vision.images import (
    RAW_VIDEOS,
    GreyImage,
    bytes_of_picture,
    eight_bits,
    is_picture,
    load_cv2,
    open_image,
    require_few_pixels,
    where_images_are,
    white_level,
)

# More of the images of a folder are no accident of one of them; one always is.
_MOST_UNREADABLE_PART = 0.1
# Images of a folder of deep ones that tell how bright they get.
_LOOKED_AT = 8
# Containers only estimate how many frames they hold; a file that was cut short misses more.
_LEAST_DECODED_PART = 0.9
# Stamps that differ by less are the same but for rounding.
_SAME_TIME_S = 1e-6
# Playlists, which FFmpeg knows by how they begin.
_LISTS = (b"ffconcat version", b"#EXTM3U")


class Frames(ABC):
    """Images of one size, in the order in which they were taken.

    Attributes
    ----------
    path : Path
        The folder, or the video.
    fps : float or None
        Frames per second, where the source tells.
    names : sequence of str
        Names of the files, of a folder; a video has none.
    unreadable : mapping of str to str
        Reason for each file that :meth:`numbered` has left out, by its name.
    stamps : sequence of float
        Times of the frames of a video decoded so far, since the first one, increasing [s].
    shortfall : str or None
        How many frames a video lacks of those that it declares, if they are many, once all are decoded.
    """

    path: Path
    fps: float | None = None
    names: Sequence[str] = ()
    unreadable: Mapping[str, str] = MappingProxyType({})
    stamps: Sequence[float] = ()
    shortfall: str | None = None

    @abstractmethod
    def __len__(self) -> int:
        """Number of frames; for a video what its container says, which can be a few too many."""

    @property
    def fewest(self) -> int:
        """Fewest frames that there can be."""
        return len(self)

    @abstractmethod
    def __iter__(self) -> Iterator[GreyImage]:
        """Each frame (height, width) uint8, decoded when it is asked for."""

    def numbered(self) -> Iterator[tuple[int, GreyImage]]:
        """Each frame that can be decoded, with its number from 0.

        Of a folder, up to a tenth may be left out: what cannot be decoded, or differs in size from the first.

        Raises
        ------
        DatasetError
            While iterating, if these are more, or the size of a video changes.
        """
        return enumerate(self)


@checked()
def open_frames(path: str | PathLike[str]) -> Frames:
    """Open a folder of images or a video.

    Parameters
    ----------
    path : path-like
        A folder: its files with a suffix of `PICTURES`, by name, numbers in names by their value; what else
        it holds is left alone. Or a file that OpenCV decodes as a video. The pixels are taken as they are
        stored, whatever orientation the file asks to be shown in.

    Returns
    -------
    Frames
        To iterate as often as wanted.

    Raises
    ------
    DatasetError
        If there is no such file, no image in the folder, no frame in the video, or OpenCV is not installed;
        and while iterating, if an image cannot be decoded, or its size differs from that of the first, except
        in :meth:`Frames.numbered`.
    """
    source = Path(path)
    try:
        cv2 = load_cv2()
    except ModuleNotFoundError as error:
        raise DatasetError(source, str(error)) from None
    with failures_named(source):
        require_present(source)
        return _Folder(source, cv2) if is_folder(source) else _Video(source, cv2)


class _Folder(Frames):
    def __init__(self, path: Path, cv2: ModuleType) -> None:
        self.path, self._cv2 = path, cv2
        self._files = sorted(filter(is_picture, path.iterdir()), key=lambda f: natural_order(f.name))
        if not self._files:
            raise DatasetError(path, f"holds no image: {where_images_are(path)}")
        self.names = [file.name for file in self._files]
        self._white: float | None = None  # where there are more than 8 bits

    def __len__(self) -> int:
        return len(self._files)

    def __iter__(self) -> Iterator[GreyImage]:
        first: tuple[tuple[int, ...], str] | None = None
        for file in self._files:
            image = self._read(file)
            first = first or (image.shape, file.name)
            _require_size(file, image.shape, *first)
            yield image

    def numbered(self) -> Iterator[tuple[int, GreyImage]]:
        self.unreadable = reasons = {}
        first: tuple[tuple[int, ...], str] | None = None
        for number, file in enumerate(self._files):
            try:
                image = self._read(file)
                first = first or (image.shape, file.name)
                _require_size(file, image.shape, *first)
            except DatasetError as error:
                reasons[file.name] = error.reason
                self._require_few_unreadable()
                continue
            yield number, image
        if first is None:
            name, reason = next(iter(reasons.items()))
            raise DatasetError(self.path, f"none of its images can be read; {name}: {reason}")

    def _require_few_unreadable(self) -> None:
        if len(self.unreadable) > max(1, _MOST_UNREADABLE_PART * len(self._files)):
            name, reason = next(iter(self.unreadable.items()))
            counts = f"{len(self.unreadable)} of its {len(self._files)} images cannot be read"
            rule = f"may be {_MOST_UNREADABLE_PART:.0%} and no more"
            raise DatasetError(self.path, f"{counts}: {rule}; the first, {name}: {reason}")

    def _read(self, file: Path) -> GreyImage:
        image = self._decoded(file)
        return image if image.dtype == np.uint8 else self._eight_bits(image)

    def _decoded(self, file: Path) -> NDArray[Any]:
        content = bytes_of_picture(file)
        _require_few_pixels(file, content)
        data = np.frombuffer(content, np.uint8)
        cv2 = self._cv2
        flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
        try:
            image = cv2.imdecode(data, flags) if len(data) else None
        except cv2.error:
            image = None
        if image is None:
            raise DatasetError(file, f"is no image that can be decoded ({len(data)} bytes)")
        return np.asarray(image)

    def _eight_bits(self, deep: NDArray[Any]) -> GreyImage:
        """An image in 8 bits, with one white for all: points are followed by their brightness."""
        if self._white is None:
            self._white = max(white_level(deep), self._white_of_others(deep.dtype))
        return eight_bits(deep, self._white)

    def _white_of_others(self, kind: np.dtype[Any]) -> float:
        """White of some images that are spread over the folder, as the first one may be dark."""
        white = 0.0
        for file in self._files[:: max(1, len(self._files) // _LOOKED_AT)]:
            with suppress(DatasetError):
                image = self._decoded(file)
                white = max(white, white_level(image) if image.dtype == kind else 0.0)
        return white


class _Video(Frames):
    def __init__(self, path: Path, cv2: ModuleType) -> None:
        self.path, self._cv2 = path, cv2
        _require_one_video(path)
        video = self._open()
        self._count = max(0, int(video.get(cv2.CAP_PROP_FRAME_COUNT)))
        fps = float(video.get(cv2.CAP_PROP_FPS))
        told = path.suffix.lower() not in RAW_VIDEOS and math.isfinite(fps) and fps > 0
        self.fps = fps if told else None
        sides = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
        require_few_pixels(path, *(int(video.get(side)) for side in sides))
        readable, _ = video.read()
        video.release()
        if not readable:
            raise DatasetError(path, "the video has no frame")

    def __len__(self) -> int:
        return self._count

    @property
    def fewest(self) -> int:
        return math.ceil(_LEAST_DECODED_PART * self._count)

    def __iter__(self) -> Iterator[GreyImage]:
        video = self._open()
        decoded, first = 0, None
        clock = _VideoClock(self.fps)
        self.stamps = clock.stamps
        try:
            while (image := self._next(video)) is not None:
                first = first or image.shape
                _require_size(self.path, image.shape, first, f"frame 0, in frame {decoded}")
                decoded += 1
                clock.note(1e-3 * float(video.get(self._cv2.CAP_PROP_POS_MSEC)))
                yield image
        finally:
            video.release()
        if decoded < self.fewest:
            self.shortfall = f"only {decoded} of the {self._count} frames that it declares can be decoded"

    def _open(self) -> Any:
        # Absolute, as a name with a colon could be that of a protocol.
        video = self._cv2.VideoCapture(str(self.path.absolute()))
        if not video.isOpened():
            raise DatasetError(self.path, "is no video that can be decoded")
        video.set(self._cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        return video

    def _next(self, video: Any) -> GreyImage | None:
        readable, image = video.read()
        if not readable:
            return None
        grey = image if image.ndim == 2 else self._cv2.cvtColor(image, self._cv2.COLOR_BGR2GRAY)
        return np.asarray(grey, dtype=np.uint8)


class _VideoClock:
    """Times of the frames of a video: cameras of telephones take fewer in the dark."""

    def __init__(self, fps: float | None) -> None:
        self._usual_s = 1 / (fps or 1.0)
        self._first_s = 0.0
        self.stamps: list[float] = []

    def note(self, time_s: float) -> None:
        """Take the time of the next frame, as the file tells it; one that is not later tells nothing."""
        if not self.stamps:
            self._first_s = time_s
        since_s = time_s - self._first_s
        counted_s = len(self.stamps) * self._usual_s
        if abs(since_s - counted_s) < _SAME_TIME_S:
            since_s = counted_s
        before_s = self.stamps[-1] if self.stamps else -math.inf
        self.stamps.append(since_s if since_s > before_s else before_s + self._usual_s)


def _require_one_video(path: Path) -> None:
    """Refuse a pipe, a list of other files, and a name that OpenCV cannot be told."""
    require_regular_file(path)
    with failures_named(path):
        str(path.absolute()).encode()
        with path.open("rb") as file:
            begin = file.read(max(map(len, _LISTS)))
    if begin.startswith(_LISTS):
        raise DatasetError(path, "is a list of other files: must be a video")


def _require_few_pixels(file: Path, data: bytes) -> None:
    """Look at the header before OpenCV decodes it all."""
    try:
        open_image(file, data).close()
    except DatasetError:
        raise
    except Exception:  # Pillow's parsers raise whatever they stumble over; OpenCV may know the format
        return


def _require_size(file: Path, shape: tuple[int, ...], first: tuple[int, ...], of: str) -> None:
    if shape != first:
        sizes = f"{shape[1]}×{shape[0]} pixels: must be {first[1]}×{first[0]}"
        raise DatasetError(file, f"has {sizes} as {of}")
