"""What stands in a folder beside its photos, and what is given in place of one."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sfm import reconstruct
from sfmcpp.sfm.outcome import warnings_of_folder
from sfmcpp.sources.synthetic.photos import render_photos
from sfmcpp.sources.vision.photos import open_photos
from textured_photos import texture, write_photo

for extra in ("cv2", "PIL", "poselib"):
    pytest.importorskip(extra, reason=f"{extra} is not installed: pip install 'sfmcpp[vision]'")


def test_copies_and_videos_are_left_aside_and_named(tmp_path: Path) -> None:
    truth = render_photos("planar", tmp_path, num_images=4, image_size=(240, 180), suffix=".png", seed=2)
    options = {"camera": truth.intrinsics[0], "gps": "none", "subpixel": False}
    alone = reconstruct(tmp_path, **options)
    first = sorted(tmp_path.glob("*.png"))[0]
    shutil.copy(first, tmp_path / f"{first.stem} copy.png")
    (tmp_path / "clip.mp4").write_bytes(b"no matter")
    (tmp_path / "phone.heic").write_bytes(b"no matter")
    run = reconstruct(tmp_path, **options)
    assert alone.model is not None
    assert run.model is not None
    assert run.problem().cameras.tobytes() == alone.problem().cameras.tobytes()
    copies, videos, foreign = (warning for warning in run.warnings if warning not in alone.warnings)
    assert copies == f"1 image is a copy, byte for byte, and left out: {first.stem} copy.png of {first.name}"
    assert videos.startswith("1 video is not read: clip.mp4; `ffmpeg -i clip.mp4 ")
    assert foreign == "1 photo is of a kind not read here, and left out: phone.heic; convert to JPEG"


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp"])
def test_photos_that_ask_to_be_shown_mirrored_are_told(tmp_path: Path, suffix: str) -> None:
    from PIL import Image

    for orientation in range(1, 9):
        image = Image.fromarray(texture(48, 64))
        exif = image.getexif()
        exif[0x0112] = orientation
        image.save(tmp_path / f"{orientation}.{suffix}", exif=exif)
    found = open_photos(tmp_path)
    # 2 and 4 flip; 5 and 7 flip and turn (CIPA DC-008).
    assert [p.name[0] for p in found.photos if p.is_mirrored] == ["2", "4", "5", "7"]
    (told,) = (w for w in warnings_of_folder(found) if "shown mirrored" in w)
    assert told.startswith(f"4 photos ask by EXIF to be shown mirrored, first 2.{suffix}; ")


def test_photos_without_an_orientation_are_not_mirrored(tmp_path: Path) -> None:
    write_photo(tmp_path / "a.jpg", texture(48, 64))
    assert warnings_of_folder(open_photos(tmp_path)) == []


def test_one_image_or_a_video_in_place_of_a_folder_is_told_what_to_give(tmp_path: Path) -> None:
    write_photo(tmp_path / "a.jpg", texture(48, 64))
    (tmp_path / "clip.mov").write_bytes(b"no matter")
    with pytest.raises(DatasetError, match="is one image: give the folder"):
        reconstruct(tmp_path / "a.jpg")
    with pytest.raises(DatasetError, match=r"is a video: `ffmpeg -i clip\.mov "):
        reconstruct(tmp_path / "clip.mov")


@pytest.mark.parametrize("name", ["100_0001_PPKRAW.bin", "cameras.txt"])
def test_files_that_a_model_might_have_do_not_hide_photos(tmp_path: Path, name: str) -> None:
    for photo in ("a.png", "b.png"):
        write_photo(tmp_path / photo, texture(48, 64))
    (tmp_path / name).write_bytes(b"no matter")
    assert reconstruct(tmp_path, subpixel=False).images.keys() == {"a.png", "b.png"}
    (tmp_path / "images.bin").write_bytes(b"no matter")
    with pytest.raises(DatasetError, match="without a COLMAP model"):
        reconstruct(tmp_path)
