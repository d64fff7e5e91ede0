"""Warnings of masks that are not used, or mask nothing."""

from __future__ import annotations

from collections.abc import Sequence

from sfmcpp.errors import DatasetError
from sfmcpp.model.photos import Photo
from sfmcpp.sources.vision.masks import read_mask, told_of_no_mask
from sfmcpp.sources.vision.photos import PhotoFolder
from sfmcpp.wording import counted, first_few

_MOST_NAMED = 3


def mask_warnings(folder: PhotoFolder) -> list[str]:
    """Tell of images that are named as masks, of photos without one, and of masks that are black nowhere.

    Parameters
    ----------
    folder : PhotoFolder
        Photos with their masks, and images that are named as masks.

    Returns
    -------
    list of str
        Empty if there are no masks, or each photo has one and there is black in any of them.
    """
    masked = [photo for photo in folder.photos if photo.mask is not None]
    warnings = _of_images_named_as_masks(folder)
    if masked and len(masked) < len(folder.photos):
        whole = [photo.name for photo in folder.photos if photo.mask is None]
        photos = counted(len(whole), "photo has no mask and is", "photos have no mask and are")
        few, missing = first_few(whole, _MOST_NAMED), f"{whole[0]}.png"
        warnings.append(f"{photos} used whole: {few}; there is no {missing} or the like")
    if masked and not _any_masks(masked):
        warnings.append(told_of_no_mask(len(masked)))
    return warnings


def _of_images_named_as_masks(folder: PhotoFolder) -> list[str]:
    if not folder.masks:
        return []
    images = counted(len(folder.masks), "image is named as a mask", "images are named as masks")
    few = first_few((f"{mask} of {photo}" for mask, photo in folder.masks.items()), _MOST_NAMED)
    return [f"{images}, and left out: {few}; to mask photos by them, give their folder (--masks)"]


def _any_masks(photos: Sequence[Photo]) -> bool:
    """Whether any mask is black anywhere: mostly the first is, so few are read."""
    return any(_masks_something(photo) for photo in photos)


def _masks_something(photo: Photo) -> bool:
    """What cannot be decoded is told of where its photo is read, and counts here as black."""
    if photo.mask is None:
        return False
    try:
        return not bool(read_mask(photo.mask, photo.size, photo.name).all())
    except DatasetError:
        return True
