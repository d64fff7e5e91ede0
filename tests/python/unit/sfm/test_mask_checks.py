"""Masks of photos that are not used, or mask nothing, are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sfm.mask_checks import mask_warnings
from sfmcpp.sources.vision import open_photos
from textured_photos import texture, write_photo

for extra in ("cv2", "PIL"):
    pytest.importorskip(extra, reason=f"{extra} is not installed: pip install 'sfmcpp[vision]'")

SMALL = texture(48, 64)
HALF = np.where(np.arange(64)[None, :, None] < 32, 0, 255 + 0 * SMALL).astype(np.uint8)


def names_of(folder: Path, masks: Path | None = None) -> list[str]:
    return [photo.name for photo in open_photos(folder, masks=masks).photos]


@pytest.mark.parametrize("mask", ["a.jpg.png", "masks/a.jpg.png", "masks/a.png", "Mask/deep/a.PNG"])
def test_images_named_as_masks_are_no_photos_and_are_told(tmp_path: Path, mask: str) -> None:
    for name in ("a.jpg", "b.jpg"):
        write_photo(tmp_path / name, texture(48, 64, seed=len(name)))
    write_photo(tmp_path / mask, HALF)
    found = open_photos(tmp_path)
    assert [photo.name for photo in found.photos] == ["a.jpg", "b.jpg"]
    assert found.masks == {mask: "a.jpg"}
    assert mask_warnings(found) == [
        f"1 image is named as a mask, and left out: {mask} of a.jpg; to mask photos by them, give their "
        "folder (--masks)"
    ]


def test_photos_are_no_masks_for_a_name_that_others_have(tmp_path: Path) -> None:
    names = ["a.jpg.png", "b.jpg", "b.png", "left/c.png", "masks/d.png", "right/c.png"]
    for seed, name in enumerate(names):
        write_photo(tmp_path / name, texture(48, 64, seed=seed))
    assert names_of(tmp_path) == names
    assert names_of(tmp_path / "masks") == ["d.png"]


def test_masks_beside_the_photos_are_used_when_given_and_not_told(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        write_photo(tmp_path / name, SMALL)
    write_photo(tmp_path / "a.png.png", HALF)
    found = open_photos(tmp_path, masks=tmp_path / "." / ".." / tmp_path.name)
    # A photo that is PNG is no mask of its own.
    assert [photo.mask and photo.mask.name for photo in found.photos] == ["a.png.png", None]
    assert found.masks == {}
    assert mask_warnings(found) == [
        "1 photo has no mask and is used whole: b.png; there is no b.png.png or the like"
    ]


def test_masks_that_are_black_nowhere_are_told(tmp_path: Path) -> None:
    for name in ("a.jpg", "b.jpg"):
        write_photo(tmp_path / "photos" / name, SMALL)
        write_photo(tmp_path / "masks" / f"{name}.png", np.maximum(HALF, 3))
    (told,) = mask_warnings(open_photos(tmp_path / "photos", masks=tmp_path / "masks"))
    assert told.startswith("2 masks are black nowhere, so nothing is masked")
    write_photo(tmp_path / "masks" / "b.jpg.png", HALF)
    assert mask_warnings(open_photos(tmp_path / "photos", masks=tmp_path / "masks")) == []


def test_a_mask_of_a_photo_that_was_turned_upright_is_told_as_such(tmp_path: Path) -> None:
    write_photo(tmp_path / "photos/a.jpg", SMALL, {0x0112: 6})
    write_photo(tmp_path / "masks/a.jpg.png", HALF.transpose(1, 0, 2))
    told = r"48×64 pixels: must be 64×48 as a\.jpg is stored, before EXIF's orientation turns it"
    with pytest.raises(DatasetError, match=told):
        open_photos(tmp_path / "photos", masks=tmp_path / "masks")


def test_a_folder_that_is_given_as_masks_must_have_one(tmp_path: Path) -> None:
    write_photo(tmp_path / "a.png", SMALL)
    with pytest.raises(DatasetError, match=r"holds no mask of any photo: there is no a\.png\.png"):
        open_photos(tmp_path, masks=tmp_path)
