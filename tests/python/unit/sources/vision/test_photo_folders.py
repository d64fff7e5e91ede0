"""Folders of photos: which files count, by which names."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.vision import open_photos
from textured_photos import texture, write_photo

pytest.importorskip("PIL.Image", reason="Pillow is not installed: pip install 'sfmcpp[vision]'")
pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")

SMALL = texture(48, 64)


def test_photos_of_all_folders_come_by_name_with_numbers_by_value(tmp_path: Path) -> None:
    for name in ("b/10.png", "b/9.JPG", "a.jpg", ".hidden/c.jpg", "._a.jpg"):
        write_photo(tmp_path / name, SMALL)
    (tmp_path / "K.txt").write_text("1 0 0")
    found = open_photos(tmp_path)
    assert [photo.name for photo in found.photos] == ["a.jpg", "b/9.JPG", "b/10.png"]
    assert {photo.size for photo in found.photos} == {(64, 48)}
    assert found.unreadable == {}


def test_links_to_folders_are_followed_and_each_folder_counts_once(tmp_path: Path) -> None:
    photos, elsewhere = tmp_path / "photos", tmp_path / "elsewhere"
    for folder in (photos / "a", elsewhere):
        folder.mkdir(parents=True)
    write_photo(photos / "a" / "1.png", texture(48, 64))
    write_photo(elsewhere / "2.png", texture(48, 64))
    for link, place in (("linked", elsewhere), ("again", photos / "a"), ("a/round", photos)):
        (photos / link).symlink_to(place)
    assert [photo.name for photo in open_photos(photos).photos] == ["a/1.png", "linked/2.png"]


def test_a_link_to_a_photo_that_is_gone_is_named(tmp_path: Path) -> None:
    (tmp_path / "b.jpg").symlink_to(tmp_path / "nowhere.jpg")
    with pytest.raises(DatasetError, match=r"none of its 1 images can be read; b\.jpg: no such file"):
        open_photos(tmp_path)
    write_photo(tmp_path / "a.png", SMALL)
    found = open_photos(tmp_path)
    assert [photo.name for photo in found.photos] == ["a.png"]
    assert found.unreadable == {"b.jpg": "no such file or directory"}


def test_a_folder_that_cannot_be_read_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a", "closed"):
        (tmp_path / name).mkdir()
        write_photo(tmp_path / name / "1.png", texture(48, 64))
    scan = os.scandir

    def refuse_closed(path: str) -> object:
        if Path(path).name == "closed":
            raise PermissionError(13, "Permission denied", path)
        return scan(path)

    monkeypatch.setattr(os, "scandir", refuse_closed)
    found = open_photos(tmp_path)
    assert [photo.name for photo in found.photos] == ["a/1.png"]
    assert found.unreadable == {"closed/": "permission denied"}
    (tmp_path / "a" / "1.png").unlink()
    with pytest.raises(DatasetError, match="closed/: permission denied"):
        open_photos(tmp_path)
    with pytest.raises(DatasetError, match="closed: permission denied"):
        open_photos(tmp_path / "closed")


def test_videos_beside_photos_are_named_and_hinted_at_where_there_are_no_photos(tmp_path: Path) -> None:
    (tmp_path / "clip.MP4").write_bytes(b"no matter")
    with pytest.raises(DatasetError, match=r"but videos, as clip\.MP4; `ffmpeg -i clip\.MP4 "):
        open_photos(tmp_path)
    write_photo(tmp_path / "a.png", SMALL)
    assert open_photos(tmp_path).videos == ["clip.MP4"]


def test_photos_of_kinds_that_are_not_read_are_named_unless_one_beside_them_is(tmp_path: Path) -> None:
    for name in ("b.HEIC", "a.CR2", "._c.heic"):
        (tmp_path / name).write_bytes(b"no matter")
    with pytest.raises(DatasetError, match=r"but photos of kinds that are not read, as a\.CR2; convert to"):
        open_photos(tmp_path)
    write_photo(tmp_path / "a.jpg", SMALL)  # developed by the camera, too
    (tmp_path / "a.jpg").rename(tmp_path / "a.jfif")
    found = open_photos(tmp_path)
    assert [photo.name for photo in found.photos] == ["a.jfif"]
    assert found.foreign == ["b.HEIC"]


def test_tiff_of_colours_in_floats_is_refused_as_that(tmp_path: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    assert cv2.imwrite(str(tmp_path / "a.tif"), np.ones((8, 9, 3), dtype=np.float32))
    with pytest.raises(DatasetError, match=r"a\.tif: is a TIFF of a kind that is not read.* 8 or 16 bits"):
        open_photos(tmp_path)
