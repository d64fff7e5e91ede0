"""What a copy of a photo without distortion keeps of the file: colour profile and EXIF."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model.photos import Photo
from sfmcpp.model.process_state import without_warnings
from sfmcpp.sources.vision.exif import EXIF_BLOCK, GPS_BLOCK, STORED_SIZE, exif_blocks
from sfmcpp.sources.vision.images import load_pillow
from sfmcpp.sources.vision.photo_pixels import bytes_of, opened_image

# Kinds of files that Pillow writes with both, as OpenCV compresses them.
_KINDS: dict[str, tuple[str, dict[str, Any]]] = {
    ".jpg": ("JPEG", {}),
    ".jpeg": ("JPEG", {}),
    ".jfif": ("JPEG", {}),
    ".png": ("PNG", {"compress_level": 1}),
    ".webp": ("WEBP", {"lossless": True}),
}
_COLOR_SPACE, _RGB = slice(16, 20), b"RGB "
# How the file stored its pixels, and its XMP.
_OF_THE_FILE = (
    *range(0x0100, 0x0107),
    0x0111,
    *range(0x0115, 0x0118),
    0x011C,
    0x0201,
    0x0202,
    0x02BC,
    0x8773,
)
# Blocks that are copied apart, or name places in the old file: of interoperability, of the maker.
_BLOCKS = (EXIF_BLOCK, GPS_BLOCK, 0xA005, 0x927C)
# Orientation, as the pixels of a model are as stored; focal length by the field of view of the whole.
_OF_THE_VIEW = (0x0112, 0xA405, *STORED_SIZE)
_DROPPED = frozenset((*_OF_THE_FILE, *_BLOCKS, *_OF_THE_VIEW))


def kept_metadata(photo: Photo, size: tuple[int, int]) -> dict[str, bytes]:
    """Colour profile and EXIF of a photo for a copy of red, green and blue at another size.

    Parameters
    ----------
    photo : Photo
        One with a file.
    size : (int, int)
        Width and height of the copy [px].

    Returns
    -------
    dict
        ``icc_profile`` and ``exif``, as Pillow takes them; without what the file lacks or is damaged in it.

    Raises
    ------
    DatasetError
        If the file is gone, or is no image any more.
    """
    if photo.path is None:
        return {}
    with opened_image(photo.path, bytes_of(photo.path)) as image, without_warnings():
        profile, exif = image.info.get("icc_profile") or b"", b""
        # Pillow raises whatever its parser, and its writer of what that has found, stumble over.
        with suppress(Exception):
            exif = _exif_of(image, size)
    kept = {"icc_profile": profile if profile[_COLOR_SPACE] == _RGB else b"", "exif": exif}
    return {name: value for name, value in kept.items() if value}


def _exif_of(image: Any, size: tuple[int, int]) -> bytes:
    main, exif, gps = (dict(_kept(block)) for block in exif_blocks(image))
    if not (main or exif or gps):
        return b""
    made = load_pillow().Exif()
    made.update(main)
    made.get_ifd(EXIF_BLOCK).update(exif | dict(zip(STORED_SIZE, size, strict=True)))
    if gps:
        made.get_ifd(GPS_BLOCK).update(gps)
    return b"Exif\0\0" + bytes(made.tobytes()).removeprefix(b"Exif\0\0")


def _kept(block: Any) -> Iterator[tuple[int, Any]]:
    return ((tag, value) for tag, value in block.items() if tag not in _DROPPED)


def encoded_with(
    metadata: dict[str, bytes], pixels: NDArray[np.uint8], suffix: str, quality: int
) -> bytes | None:
    """Content of a file with `metadata`; None for kinds of files without it, or where it is too long.

    Parameters
    ----------
    metadata : dict
        Of :func:`kept_metadata`.
    pixels : (height, width, 3 or 4) uint8
        Red, green, blue, and opacity where the kind of file has room for it.
    suffix : str
        Of the file, in small letters.
    quality : int
        Of JPEG.
    """
    if not metadata or suffix not in _KINDS:
        return None
    kind, options = _KINDS[suffix]
    if kind == "JPEG":
        options = {"quality": quality}
    written = BytesIO()
    with suppress(ValueError):  # of EXIF or profiles that are longer than a segment of JPEG
        load_pillow().fromarray(pixels).save(written, kind, **options, **metadata)
        return written.getvalue()
    return None
