"""Photos of a folder: facts without decoding, and pixels on request."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from hashlib import blake2b
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.model.arguments import checked
from sfmcpp.model.checks import require_count
from sfmcpp.model.photos import Photo
from sfmcpp.model.process_state import without_warnings
from sfmcpp.sources.io.checks import fault_of_image_name
from sfmcpp.sources.io.files import failures_named, is_folder, require_present
from sfmcpp.sources.vision.equirectangular import shows_all_around
from sfmcpp.sources.vision.exif import exif_facts
from sfmcpp.sources.vision.images import (
    GreyImage,
    images_and_videos,
    is_foreign_picture,
    is_picture,
    is_video,
    load_cv2,
    load_pillow,
    where_images_are,
)
from sfmcpp.sources.vision.masks import DIGEST_BYTES, named_as_masks, with_mask
from sfmcpp.sources.vision.photo_pixels import (
    ColorImage,
    as_levels,
    as_rgb,
    bytes_of,
    further_images,
    has_deep_colors,
    has_transparency,
    opaque_part,
    opened_image,
)

_THUMBNAIL_QUALITY = 80


@dataclass(frozen=True)
class PhotoFolder:
    """The photos of a folder.

    Attributes
    ----------
    path : Path
        The folder.
    photos : list of Photo
        Those whose files can be opened, by name, numbers in names by their value.
    unreadable : dict
        Reason for each image file, and each folder (``name/``), that cannot, by its name below the folder.
    copies : dict
        Name of the photo that each copy was of, by the name of the copy; see :func:`without_copies`.
    videos : list of str
        Names of the videos beside them.
    foreign : list of str
        Names of the photos of kinds that are not read, as HEIC and raw ones, except those beside one of the
        same name that is.
    masks : dict
        Name of the photo that each image is named as a mask of, by the name of the image: it is no photo.
    """

    path: Path
    photos: list[Photo]
    unreadable: dict[str, str] = field(default_factory=dict)
    copies: dict[str, str] = field(default_factory=dict)
    videos: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)
    masks: dict[str, str] = field(default_factory=dict)


@checked()
def open_photos(folder: str | PathLike[str], *, masks: str | PathLike[str] | None = None) -> PhotoFolder:
    """Find the photos in a folder and in the folders below it; read their sizes and EXIF blocks.

    No image is decoded: that a file is cut short shows when its pixels are read (:func:`read_gray`). Pixels
    are as they are stored, whatever orientation the file asks to be shown in. Files and folders whose name
    starts with a dot are left alone. Links to folders are followed, each folder counts once. Images that are
    named as masks of others (``a.jpg.png`` beside ``a.jpg``, or ``masks/a.png``) are no photos.

    Parameters
    ----------
    folder : path-like
        Where the photos are: files with a suffix of `PICTURES`.
    masks : path-like, optional
        Folder of images; ``masks/NAME.png``, with or without the photo's own suffix before ``.png``, is the
        mask of the photo NAME: nothing is detected where it is black. Photos without one are used whole.

    Returns
    -------
    PhotoFolder
        Its photos and the files that cannot be opened.

    Raises
    ------
    DatasetError
        If there is no such folder, or no image in it, or none can be opened; if no photo has a mask in
        `masks`, or one cannot be opened or has another size than its photo.
    ModuleNotFoundError
        If Pillow is not installed.
    """
    path, masks_path = Path(folder), None if masks is None else Path(masks)
    for place in (path, masks_path):
        _require_folder(place)
    closed: dict[str, str] = {}
    with failures_named(path):
        files = images_and_videos(path, masks_path, closed)
        taken = {file.with_suffix("") for _, file in files if is_picture(file)}
        images = [one for one in files if is_picture(one[1])]
        if not images and not closed:
            raise DatasetError(path, f"holds no image: {where_images_are(path)}")
    found = PhotoFolder(
        path,
        [],
        closed,
        videos=[name for name, file in files if is_video(file)],
        foreign=[n for n, file in files if is_foreign_picture(file) and file.with_suffix("") not in taken],
    )
    for name, file in images:
        try:
            photo = _opened_photo(name, file)
        except DatasetError as error:
            found.unreadable[name] = error.reason
            continue
        found.photos.append(photo if masks_path is None else with_mask(photo, masks_path))
    _require_some(found, masks_path)
    return _without_masks(found)


def _without_masks(found: PhotoFolder) -> PhotoFolder:
    """The folder without the photos that are named as masks of others."""
    masks = named_as_masks(photo.name for photo in found.photos)
    used = {photo.mask.resolve() for photo in found.photos if photo.mask is not None}
    unused = {name: photo for name, photo in masks.items() if (found.path / name).resolve() not in used}
    photos = [photo for photo in found.photos if photo.name not in masks]
    return replace(found, photos=photos, masks=unused)


def without_copies(folder: PhotoFolder) -> PhotoFolder:
    """The folder with one of all photos that have the same bytes, and the same mask.

    A copy tells nothing new, and would count twice. The shortest name stays, of several the first.

    Parameters
    ----------
    folder : PhotoFolder
        What was found; left as it is.

    Returns
    -------
    PhotoFolder
        One whose `copies` name what was left out; the same folder if all are one photo.
    """
    kept: dict[str, str] = {}
    for photo in sorted(folder.photos, key=lambda photo: len(photo.name)):
        kept.setdefault(photo.digest, photo.name)
    photos = [photo for photo in folder.photos if kept[photo.digest] == photo.name]
    # One photo again and again: that they are the same is told where no model comes of them.
    if len(photos) == 1:
        return folder
    copies = {p.name: kept[p.digest] for p in folder.photos if kept[p.digest] != p.name}
    return replace(folder, photos=photos, copies=folder.copies | copies)


def read_gray(photo: Photo) -> GreyImage:
    """Grey levels of a photo.

    Parameters
    ----------
    photo : Photo
        One with a file.

    Returns
    -------
    (height, width) uint8
        ITU-R BT.601 luma.

    Raises
    ------
    DatasetError
        If the file is gone, cut short or otherwise not to be decoded, or has become another size.
    """
    return np.asarray(load_cv2().cvtColor(read_color(photo), load_cv2().COLOR_RGB2GRAY))


def read_color(photo: Photo) -> ColorImage:
    """Red, green and blue of a photo.

    Parameters
    ----------
    photo : Photo
        One with a file.

    Returns
    -------
    (height, width, 3) uint8
        Of deeper levels the upper 8 of the bits used: 8, 10, 12, 14 or 16. Of floats 1 is white.

    Raises
    ------
    DatasetError
        If the file is gone, cut short or otherwise not to be decoded, or has become another size.
    """
    return read_color_and_opaque(photo)[0]


def read_color_and_opaque(photo: Photo) -> tuple[ColorImage, NDArray[np.bool_] | None]:
    """As :func:`read_color`, and where it is not transparent; None if it is so nowhere or everywhere."""
    file = _file_of(photo)
    data = bytes_of(file)
    with opened_image(file, data) as image:
        pixels, opaque = as_rgb(file, data, image), opaque_part(file, image)
    _require_same_size(photo, file, pixels)
    return pixels, opaque


def read_levels(photo: Photo) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """All that the file of a photo holds: levels of up to 16 bits, and opacity.

    Parameters
    ----------
    photo : Photo
        One with a file.

    Returns
    -------
    (height, width, 3 or 4) uint8 or uint16
        Red, green and blue; opacity comes last where parts may be transparent. Of floats 8 bits, as
        :func:`read_color`.

    Raises
    ------
    DatasetError
        If the file is gone, cut short or otherwise not to be decoded, or has become another size.
    """
    file = _file_of(photo)
    data = bytes_of(file)
    with opened_image(file, data) as image:
        levels = as_levels(file, data, image)
    _require_same_size(photo, file, levels)
    return levels


def thumbnail_jpeg(photo: Photo, longest_px: int) -> bytes:
    """A small copy of a photo, pixels as stored.

    Parameters
    ----------
    photo : Photo
        One with a file.
    longest_px : int
        Longest side at most [px]; a smaller photo keeps its size.

    Returns
    -------
    bytes
        A JPEG file.

    Raises
    ------
    InvalidArgument
        If `longest_px` is not positive.
    DatasetError
        If the file is gone, cut short or otherwise not to be decoded.
    """
    require_count("longest_px", longest_px, 1)
    file = _file_of(photo)
    data = bytes_of(file)
    with opened_image(file, data) as image:
        # Of JPEG, only as many pixels are decoded as are needed.
        image.draft("RGB", (2 * longest_px, 2 * longest_px))
        small = load_pillow().fromarray(as_rgb(file, data, image))
    small.thumbnail((longest_px, longest_px))
    written = BytesIO()
    small.save(written, "JPEG", quality=_THUMBNAIL_QUALITY)
    return written.getvalue()


def _require_same_size(photo: Photo, file: Path, pixels: NDArray[Any]) -> None:
    if pixels.shape[1::-1] != photo.size:
        now, then = "×".join(map(str, pixels.shape[1::-1])), "×".join(map(str, photo.size))
        raise DatasetError(file, f"has {now} pixels now, and had {then} when the folder was opened")


def _require_folder(path: Path | None) -> None:
    if path is None:
        return
    with failures_named(path):
        require_present(path)
        if not is_folder(path):
            raise DatasetError(path, "is no folder")


def _opened_photo(name: str, file: Path) -> Photo:
    if (fault := fault_of_image_name(name)) is not None:
        raise DatasetError(file, f"the name of an image {fault}")
    data = bytes_of(file)
    # Pillow warns of damaged EXIF blocks; they count as not there.
    with opened_image(file, data) as image, without_warnings():
        facts, size = exif_facts(image), image.size
        # Caches may have features of its transparent parts, or of the upper 8 of its 16 bits.
        key = b"opaque" * has_transparency(image) + b"deep" * has_deep_colors(image)
        further = further_images(image)
    return Photo(
        name,
        file,
        size,
        focal_px=facts.focal_px,
        camera=facts.camera,
        position=facts.position,
        taken_s=facts.taken_s,
        digest=blake2b(data, digest_size=DIGEST_BYTES, key=key).hexdigest(),
        position_sigmas_m=facts.position_sigmas_m,
        is_mirrored=facts.is_mirrored,
        is_panorama=facts.is_panorama or shows_all_around(file, data, size),
        further_images=further,
    )


def _require_some(found: PhotoFolder, masks: Path | None) -> None:
    if not found.photos:
        name, reason = next(iter(found.unreadable.items()))
        count = len(found.unreadable)
        raise DatasetError(found.path, f"none of its {count} images can be read; {name}: {reason}")
    if masks is not None and all(photo.mask is None for photo in found.photos):
        example = f"{found.photos[0].name}.png"
        raise DatasetError(masks, f"holds no mask of any photo: there is no {example} or the like")


def _file_of(photo: Photo) -> Path:
    if photo.path is None:
        raise DatasetError(photo.name, "is known by its tracks alone: there is no file to read")
    return photo.path
