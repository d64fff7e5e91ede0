"""Decoding of the file of a photo: colours of 8 bits, and where it is transparent."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.sources.vision.images import (
    bytes_of_picture,
    eight_bits,
    load_cv2,
    load_pillow,
    open_image,
    white_level,
)

ColorImage = NDArray[np.uint8]

_HEIC_BRANDS = (b"heic", b"heix", b"hevc", b"hevx", b"heim", b"heis", b"mif1", b"msf1")
_TIFF_MAGICS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
# Pillow's modes of 16 bits a pixel and of floats; 32-bit "I" is what its older versions make of 16-bit PNG.
_DEEP_MODES = ("I;16", "I;16L", "I;16B", "I;16N", "I", "F")
# Of files of 16 bits a colour, too, and Pillow keeps the upper 8 only: of a camera's 12 bits that is 4.
_SHORTENED_MODES = ("RGB", "RGBA", "LA")
_MOST_OF_16_BITS = 65535
# Kinds of files whose images may differ in size; MPO is what phones and stereo cameras write as JPEG.
_KINDS_OF_PAGES = ("TIFF", "MPO")
_SUBFILE_TYPE, _REDUCED, _MASK = 254, 1, 4


def bytes_of(file: Path) -> bytes:
    """Content of a file; a DatasetError if it cannot be read, or is empty."""
    data = bytes_of_picture(file)
    if not data:
        raise DatasetError(file, "the file is empty")
    return data


@contextmanager
def opened_image(file: Path, data: bytes) -> Iterator[Any]:
    """Pillow's image of a file's bytes, its header read; errors name the file."""
    try:
        image = open_image(file, data)
    except load_pillow().UnidentifiedImageError:
        raise DatasetError(file, _undecodable(data)) from None
    except DatasetError:
        raise
    except Exception as error:  # its parsers raise whatever they stumble over
        raise DatasetError(file, f"cannot be decoded: {_error_text(error)}") from error
    with image:
        yield image


def _undecodable(data: bytes) -> str:
    """Why Pillow knows no way to decode a file: phones' photos are often HEIC with the suffix of JPEG."""
    if data[4:8] == b"ftyp" and data[8:12] in _HEIC_BRANDS:
        return "is HEIC in spite of its name: convert it to JPEG"
    if data[:4] in _TIFF_MAGICS:
        return "is a TIFF of a kind that is not read, such as colours of floats: convert it to 8 or 16 bits"
    return f"is no image that can be decoded ({len(data)} bytes)"


def as_rgb(file: Path, data: bytes, image: Any) -> ColorImage:
    """Red, green and blue (height, width, 3) of Pillow's image of a file's bytes.

    Raises
    ------
    DatasetError
        If it cannot be decoded.
    """
    is_deep = has_deep_colors(image)
    pixels = decoded(file, image)
    return _of_8_bits(_deep_colors(data, pixels) if is_deep else pixels)


def _of_8_bits(pixels: NDArray[Any]) -> ColorImage:
    """Colours of 8 bits (height, width, 3) of colours or grey levels of any depth."""
    levels = pixels if pixels.dtype == np.uint8 else eight_bits(pixels, white_level(pixels))
    return levels if levels.ndim == 3 else _of_three(levels)


def _of_three(grey: NDArray[Any]) -> NDArray[Any]:
    return np.repeat(grey[:, :, None], 3, axis=2)


def as_levels(file: Path, data: bytes, image: Any) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """Red, green, blue, and opacity where there is any (height, width, 3 or 4), with the file's bits.

    Floats have 8 bits, as in :func:`as_rgb`.

    Raises
    ------
    DatasetError
        If it cannot be decoded.
    """
    is_deep, mode = has_deep_colors(image), "RGBA" if has_transparency(image) else "RGB"
    pixels = decoded(file, image, mode)
    if is_deep:
        pixels = _deep_colors(data, pixels)
    if pixels.ndim == 2 and _fits_16_bits(pixels):
        return _of_three(pixels.astype(np.uint16))
    return pixels if pixels.dtype in (np.uint8, np.uint16) else _of_8_bits(pixels)


def _fits_16_bits(grey: NDArray[Any]) -> bool:
    return grey.dtype.kind in "iu" and bool(0 <= grey.min() <= grey.max() <= _MOST_OF_16_BITS)


def with_8_bits(levels: NDArray[Any]) -> NDArray[np.uint8]:
    """Levels of :func:`as_levels`, or of its result resampled, for a kind of file that has 8 bits."""
    return levels if levels.dtype == np.uint8 else eight_bits(levels, white_level(levels))


def further_images(image: Any) -> int:
    """Images of a file that are as large as the first one, without it; Pillow's `image` ends at the last.

    Smaller copies of it, and masks, do not count. What is damaged ends the count.
    """
    size, found = image.size, 0
    with suppress(Exception):  # its parsers raise whatever they stumble over
        frames = int(getattr(image, "n_frames", 1))
        if image.format not in _KINDS_OF_PAGES:
            return max(frames - 1, 0)
        for number in range(1, frames):
            image.seek(number)
            found += image.size == size and not _is_copy_or_mask(image)
    return found


def _is_copy_or_mask(page: Any) -> bool:
    """Whether a page of a TIFF file says that it is the first one at another size, or a mask of it."""
    kind = getattr(page, "tag_v2", {}).get(_SUBFILE_TYPE, 0)
    return bool(kind & (_REDUCED | _MASK))


def has_deep_colors(image: Any) -> bool:
    """Whether the file of an image that is not decoded yet has colours of 16 bits."""
    if image.mode not in _SHORTENED_MODES:
        return False
    formats = [str(word) for _, _, _, args in image.tile for word in np.atleast_1d(args)]
    return any(";16" in word or word == str(_MOST_OF_16_BITS) for word in formats)


def _deep_colors(data: bytes, shortened: NDArray[Any]) -> NDArray[Any]:
    """All 16 bits of as many colours by OpenCV, or what is left of them if it cannot decode the file."""
    cv2 = load_cv2()
    deep = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
    if deep is None or deep.dtype != np.uint16 or deep.ndim != 3 or deep.shape[:2] != shortened.shape[:2]:
        return shortened
    colors = [2, 1, 0, 3][: shortened.shape[2]]
    return np.ascontiguousarray(deep[:, :, colors]) if max(colors) < deep.shape[2] else shortened


def opaque_part(file: Path, image: Any) -> NDArray[np.bool_] | None:
    """Where an image (height, width) is not transparent; None if it is so nowhere or everywhere."""
    opaque = decoded(file, image, "RGBA")[:, :, 3] > 0 if has_transparency(image) else None
    return opaque if opaque is not None and opaque.any() != opaque.all() else None


def has_transparency(image: Any) -> bool:
    """Whether parts of an image may be transparent."""
    return image.getbands()[-1] == "A" or ("transparency" in image.info and image.mode not in _DEEP_MODES)


def decoded(file: Path, image: Any, mode: str = "RGB") -> NDArray[Any]:
    """Colours of a mode (height, width, 3 or 4), or grey levels (height, width) of 16 bits or floats.

    All is decoded: Pillow, unlike OpenCV, refuses a file that is cut short.
    """
    try:
        return np.asarray(image if image.mode in (mode, *_DEEP_MODES) else image.convert(mode))
    except Exception as error:  # its decoders raise whatever they stumble over
        raise DatasetError(file, f"cannot be decoded: {_error_text(error)}") from error


def _error_text(error: Exception) -> str:
    return str(error) or type(error).__name__
