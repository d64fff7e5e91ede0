"""Masks of photos: which file is the mask of which photo, and where it is black."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from hashlib import blake2b
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import DatasetError
from sfmcpp.model.photos import Photo
from sfmcpp.sources.io.files import is_regular_file
from sfmcpp.sources.vision.photo_pixels import bytes_of, decoded, opened_image
from sfmcpp.wording import counted

DIGEST_BYTES = 20
_SUFFIX = ".png"
_FOLDERS = ("mask", "masks")


def read_mask(file: Path, size: tuple[int, int], masked: str) -> NDArray[np.bool_]:
    """Mask of the pixels of images in which features may be detected.

    Parameters
    ----------
    file : Path
        An image.
    size : (int, int)
        Width and height of the images [px].
    masked : str
        What they are called.

    Returns
    -------
    (height, width) bool
        False where the mask is black.

    Raises
    ------
    DatasetError
        If the mask is gone, cut short or otherwise not to be decoded, or has another size.
    """
    with opened_image(file, bytes_of(file)) as image:
        _require_mask_size(file, image.size, size, masked)
        pixels = decoded(file, image)
        return np.asarray(pixels.reshape(*pixels.shape[:2], -1).any(axis=2))


def told_of_no_mask(count: int) -> str:
    """A sentence on as many masks that mask nothing."""
    masks = counted(count, "mask is", "masks are")
    return f"{masks} black nowhere, so nothing is masked: black is 0 in all colours, however transparent"


def with_mask(photo: Photo, masks: Path) -> Photo:
    """The photo with its mask in a folder, and a digest of both; itself if it has none there.

    Raises
    ------
    DatasetError
        If the mask cannot be opened, or has another size than the photo.
    """
    names = (photo.name + _SUFFIX, str(Path(photo.name).with_suffix(_SUFFIX)))
    # Where masks lie beside the photos, a photo that is PNG has the second name itself.
    own = None if photo.path is None else photo.path.resolve()
    files = (file for name in names if is_regular_file(file := masks / name))
    mask = next((file for file in files if file.resolve() != own), None)
    if mask is None:
        return photo
    data = bytes_of(mask)
    with opened_image(mask, data) as image:
        _require_mask_size(mask, image.size, photo.size, photo.name)
    both = blake2b(data, digest_size=DIGEST_BYTES, key=photo.digest.encode())
    return replace(photo, mask=mask, digest=both.hexdigest())


def named_as_masks(names: Iterable[str]) -> dict[str, str]:
    """Find the images of a folder that are named as masks of others: a photo would hardly be.

    These are ``a.jpg.png`` where there is ``a.jpg`` in any folder, and ``masks/a.png`` where there is an
    ``a`` of any suffix outside of folders called so.

    Parameters
    ----------
    names : iterable of str
        Paths below the folder, with forward slashes.

    Returns
    -------
    dict of str to str
        Name of the photo, by that of the mask; in the order of `names`.
    """
    paths = [PurePosixPath(name) for name in names]
    by_name = {path.name: str(path) for path in reversed(paths)}
    by_stem = {path.stem: str(path) for path in reversed(paths) if not _is_in_mask_folder(path)}
    found = {}
    for path in paths:
        if path.suffix.lower() != _SUFFIX:
            continue
        photo = by_name.get(path.stem)
        if photo is None and _is_in_mask_folder(path):
            photo = by_stem.get(path.stem)
        if photo is not None:
            found[str(path)] = photo
    return found


def _is_in_mask_folder(path: PurePosixPath) -> bool:
    return any(folder.lower() in _FOLDERS for folder in path.parts[:-1])


def _require_mask_size(mask: Path, found: tuple[int, int], size: tuple[int, int], masked: str) -> None:
    if found == size:
        return
    sizes = f"{found[0]}×{found[1]} pixels: must be {size[0]}×{size[1]} as {masked}"
    # Programs that show photos upright, by EXIF, make masks of that shape.
    hint = " is stored, before EXIF's orientation turns it" if found == size[::-1] else ""
    raise DatasetError(mask, f"the mask has {sizes}{hint}")
