"""Access to OpenCV and Pillow, image file types, and limits of image sizes."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, suppress
from functools import partial
from io import BytesIO
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.model.photos import natural_order
from sfmcpp.model.process_state import SharedChange, without_warnings
from sfmcpp.sources.io.files import (
    MAX_IMAGE,
    failures_named,
    is_folder,
    is_present,
    is_regular_file,
    largest_image,
    require_present,
)

GreyImage = NDArray[np.uint8]

PICTURES = (".png", ".jpg", ".jpeg", ".jfif", ".ppm", ".pgm", ".tif", ".tiff", ".bmp", ".webp")
# Photos, too, but of kinds that are not read.
RAW_PICTURES = (".dng", ".cr2", ".cr3", ".nef", ".arw", ".orf", ".raf", ".rw2")
FOREIGN_PICTURES = (*RAW_PICTURES, ".heic", ".heif", ".avif", ".jxl", ".jp2", ".gif")
# Images alone, one after the other, without a rate.
RAW_VIDEOS = (".mjpeg", ".mjpg")
VIDEOS = (
    ".mp4",
    ".avi",
    ".mkv",
    ".mov",
    ".webm",
    ".m4v",
    ".mpg",
    ".mpeg",
    ".mts",
    ".3gp",
    ".wmv",
    *RAW_VIDEOS,
)
_MOST_HINTS = 3
# Bits that cameras measure, and files of 16 bits hold as they are.
_SENSOR_BITS = (8, 10, 12, 14)
_SILENT = 0  # of OpenCV's levels of messages


def load_cv2() -> ModuleType:
    """OpenCV, with its own messages off: errors are raised as this package's exceptions."""
    # Read by OpenCV's decoder of videos when it first runs; -8 is FFmpeg's "quiet".
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    try:
        import cv2
    except ModuleNotFoundError as error:
        message = f"images need {error.name}: pip install 'sfmcpp[vision]'"
        raise ModuleNotFoundError(message, name=error.name) from None
    # Versions before 4.13 have it in the module itself.
    holder = cv2 if hasattr(cv2, "setLogLevel") else cv2.utils.logging
    holder.setLogLevel(_SILENT)
    module: ModuleType = cv2
    return module


def _set_one_opencv_thread() -> Callable[[], None]:
    cv2 = load_cv2()
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    return partial(cv2.setNumThreads, before)


_ONE_OPENCV_THREAD = SharedChange(_set_one_opencv_thread)


def one_opencv_thread() -> AbstractContextManager[None]:
    """Inside, OpenCV works in the thread that calls it: for programs that call it from several at once."""
    return _ONE_OPENCV_THREAD.made()


def load_pillow() -> ModuleType:
    """Pillow's module Image."""
    try:
        from PIL import Image
    except ModuleNotFoundError as error:
        message = f"photos need {error.name}: pip install 'sfmcpp[vision]'"
        raise ModuleNotFoundError(message, name=error.name) from None
    return Image


def open_image(file: Path, data: bytes) -> Any:
    """Pillow's image of a file's bytes, its header read; Pillow's errors are the caller's.

    Raises
    ------
    DatasetError
        If it has more pixels than `largest_image` allows.
    """
    pillow = load_pillow()
    # Pillow's own limit warns of photos that are no attack, for all threads.
    with without_warnings():  # alone: the limit, too, is that of the process
        before, pillow.MAX_IMAGE_PIXELS = pillow.MAX_IMAGE_PIXELS, None  # type: ignore[attr-defined]
        try:
            image = pillow.open(BytesIO(data))
        finally:
            pillow.MAX_IMAGE_PIXELS = before  # type: ignore[attr-defined]
    require_few_pixels(file, *image.size)
    return image


def require_few_pixels(file: Path, width: int, height: int) -> None:
    """Raise a DatasetError if an image has more pixels than `largest_image` allows."""
    if width * height > (most := largest_image()):
        size = f"{width}×{height} pixels, more than {most // 1_000_000} million"
        raise DatasetError(file, f"has {size}: refused; {MAX_IMAGE} allows more")


def is_picture(file: Path) -> bool:
    """Whether a file's name says that it is an image; a link to a file that is gone counts."""
    # Some systems leave a hidden companion, ._name.png, beside each file.
    if file.suffix.lower() not in PICTURES or file.name.startswith("."):
        return False
    return is_regular_file(file) or (file.is_symlink() and not is_present(file))


def holds_photos(path: Path) -> bool:
    """Whether a path is a folder of images: it is, unless it holds a model or tracks.

    Parts of a model beside photos may be something else, as the PPKRAW.bin of DJI's drones.

    Raises
    ------
    DatasetError
        If there is no such path, or it cannot be read.
    """
    with failures_named(path):
        require_present(path)
        if not is_folder(path) or any(
            is_present(path / n) for n in ("images.bin", "images.txt", "Image1.mat")
        ):
            return False
        in_part = any(path.glob("[!.]*.bin")) or is_present(path / "cameras.txt")
        return not in_part or any(map(is_picture, path.iterdir()))


def is_foreign_picture(file: Path) -> bool:
    """Whether a file's name says that it is an image of a kind that is not read."""
    return file.suffix.lower() in FOREIGN_PICTURES and not file.name.startswith(".") and is_regular_file(file)


def is_video(file: Path) -> bool:
    """Whether a file's name says that it is a video."""
    return file.suffix.lower() in VIDEOS and not file.name.startswith(".") and is_regular_file(file)


_KINDS = (is_picture, is_foreign_picture, is_video)


def images_and_videos(folder: Path, masks: Path | None, closed: dict[str, str]) -> list[tuple[str, Path]]:
    """Name and path of each image, read or not, and video below `folder`, except masks, in order.

    Folders that cannot be read go into `closed`, with the reason; if `folder` itself cannot, it raises that.
    """

    def note(error: OSError) -> None:
        place = Path(os.fsdecode(error.filename))
        if place == folder:
            raise error
        closed[f"{place.relative_to(folder).as_posix()}/"] = unreadable(place, error).reason

    found, seen = [], {os.path.realpath(folder)}
    if masks is not None:
        seen.add(os.path.realpath(masks))
    for place, folders, files in os.walk(folder, onerror=note, followlinks=True):
        here = Path(place)
        folders[:] = _not_seen(here, sorted(f for f in folders if not f.startswith(".")), seen)
        found += [file for name in files if any(kind(file := here / name) for kind in _KINDS)]
    named = [(file.relative_to(folder).as_posix(), file) for file in found]
    return sorted(named, key=lambda one: natural_order(one[0]))


def _not_seen(place: Path, folders: Sequence[str], seen: set[str]) -> list[str]:
    """The folders in a place that are none of the `seen`, by whatever name: links may lead in circles."""
    found = []
    for name in folders:
        if (real := os.path.realpath(place / name)) not in seen:
            seen.add(real)
            found.append(name)
    return found


def photos_of_video(name: str) -> str:
    """Hint for a video where photos are wanted."""
    return f"`ffmpeg -i {name} -vf fps=2 %05d.jpg` makes photos of it, and `sfmcpp slam` follows its camera"


def jpeg_of_foreign(name: str) -> str:
    """Hint for a photo of a kind that is not read, which has that name."""
    suffix = Path(name).suffix
    if suffix.lower() in RAW_PICTURES:
        return "convert to JPEG, 8 or 16 bits of TIFF"
    return f"convert to JPEG: `mogrify -format jpg *{suffix}`"


def require_no_single_picture(file: Path) -> None:
    """Raise a DatasetError if a file is an image or a video, where a folder of photos is wanted."""
    if is_picture(file):
        raise DatasetError(file, "is one image: give the folder that holds it and others of the scene")
    if is_foreign_picture(file):
        kind = f"is an image of a kind that is not read; {jpeg_of_foreign(file.name)}"
        raise DatasetError(file, f"{kind}, and give the folder of photos")
    if is_video(file):
        raise DatasetError(file, f"is a video: {photos_of_video(file.name)}")


def where_images_are(folder: Path) -> str:
    """Hint for a folder without images: they might be in a folder of it."""
    inside = sorted(place for place in folder.iterdir() if is_folder(place) and _has_picture(place))
    if inside:
        return f"did you mean {' or '.join(map(str, inside[:_MOST_HINTS]))}?"
    if videos := sorted(file for file in folder.iterdir() if is_video(file)):
        return f"but videos, as {videos[0].name}; {photos_of_video(videos[0].name)}"
    if foreign := sorted(file for file in folder.iterdir() if is_foreign_picture(file)):
        return (
            f"but photos of kinds that are not read, as {foreign[0].name}; {jpeg_of_foreign(foreign[0].name)}"
        )
    return f"must have files named {', '.join(PICTURES)}"


def _has_picture(folder: Path) -> bool:
    with suppress(OSError):
        return any(map(is_picture, folder.iterdir()))
    return False


def bytes_of_picture(file: Path) -> bytes:
    """Read a file; an error of the operating system is a DatasetError."""
    try:
        return file.read_bytes()
    except OSError as error:
        raise unreadable(file, error) from error


def unreadable(path: Path, error: OSError) -> DatasetError:
    """Error of the operating system for a file, as an error that names it."""
    return DatasetError(path, (error.strerror or str(error)).lower())


def white_level(grey: NDArray[Any]) -> float:
    """What is white in grey levels of more than 8 bits: the most that the bits used can hold; of floats, 1.

    Floats of which one is larger are taken for levels of 8 bits.
    """
    most = np.nan_to_num(grey).max(initial=0)
    if grey.dtype.kind == "f":
        return 1.0 if most <= 1 else 255.0
    return next((1 << bits for bits in _SENSOR_BITS if most < 1 << bits), 1 << 16) - 1.0


def eight_bits(grey: NDArray[Any], white: float) -> GreyImage:
    """Grey levels in 8 bits, the upper ones of integers; what is brighter than white is white."""
    if grey.dtype.kind == "f":
        levels = np.rint(np.nan_to_num(grey) * (255.0 / white))
    else:
        levels = grey.astype(np.int64) * 256 // int(white + 1)
    return np.asarray(levels.clip(0, 255), dtype=np.uint8)


def encode_png(pixels: NDArray[np.uint8], conversion: str | None) -> bytes:
    """Content of a PNG file of grey levels (height, width) or blue, green, red (height, width, 3).

    Parameters
    ----------
    pixels : array of uint8
        The image.
    conversion : str or None
        OpenCV's name of the conversion that makes it blue, green, red: ``"COLOR_RGB2BGR"``.
    """
    cv2 = load_cv2()
    image = pixels if conversion is None else cv2.cvtColor(pixels, getattr(cv2, conversion))
    _, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return bytes(data)
