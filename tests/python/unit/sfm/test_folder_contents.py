"""What stands in a folder beside its photos, and what is given in place of one."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

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
    assert foreign == (
        "1 photo is of a kind not read here, and left out: phone.heic; convert to JPEG: "
        "`mogrify -format jpg *.heic`"
    )


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
    (tmp_path / "clip.gif").write_bytes(b"no matter")
    with pytest.raises(
        DatasetError, match=r"kind that is not read; convert to JPEG: `mogrify -format jpg \*\.gif`"
    ):
        reconstruct(tmp_path / "clip.gif")


@pytest.mark.parametrize("name", ["100_0001_PPKRAW.bin", "cameras.txt"])
def test_files_that_a_model_might_have_do_not_hide_photos(tmp_path: Path, name: str) -> None:
    for photo in ("a.png", "b.png"):
        write_photo(tmp_path / photo, texture(48, 64))
    (tmp_path / name).write_bytes(b"no matter")
    assert reconstruct(tmp_path, subpixel=False).images.keys() == {"a.png", "b.png"}
    (tmp_path / "images.bin").write_bytes(b"no matter")
    with pytest.raises(DatasetError, match="without a COLMAP model"):
        reconstruct(tmp_path)


@pytest.mark.parametrize(
    ("name", "remedy"),
    [("IMG_1.HEIC", r"`mogrify -format jpg \*\.HEIC`"), ("a.dng", "8 or 16 bits of TIFF")],
)
def test_a_folder_of_photos_that_are_not_read_tells_what_to_do(
    tmp_path: Path, name: str, remedy: str
) -> None:
    (tmp_path / name).write_bytes(b"no matter")
    with pytest.raises(DatasetError, match=rf"kinds that are not read, as {name}; convert to JPEG.*{remedy}"):
        reconstruct(tmp_path)


@pytest.mark.parametrize("suffix", ["png", "webp", "tif"])
def test_further_images_of_a_file_are_told(tmp_path: Path, suffix: str) -> None:
    from PIL import Image

    frames = [Image.fromarray(texture(48, 64, seed=seed)) for seed in range(4)]
    if suffix == "webp":
        pytest.importorskip("PIL._webp")
    frames[0].save(tmp_path / f"a.{suffix}", save_all=True, append_images=frames[1:])
    frames[0].save(tmp_path / f"b.{suffix}")
    found = open_photos(tmp_path)
    assert [photo.further_images for photo in found.photos] == [3, 0]
    told = f"1 file holds more than one image, and only the first is used: a.{suffix} (3 more); save "
    assert [warning.startswith(told) for warning in warnings_of_folder(found)] == [True]


def test_previews_and_masks_are_no_further_images(tmp_path: Path) -> None:
    from PIL import Image

    image = Image.fromarray(texture(48, 64))
    small, kind = image.resize((32, 24)), 254
    for name, page, subfile in (("small", small, 0), ("reduced", image.copy(), 1), ("mask", image.copy(), 4)):
        page.encoderinfo = {"tiffinfo": {kind: subfile}}
        image.save(tmp_path / f"{name}.tif", save_all=True, append_images=[page])
    # As phones write a preview behind a photo, and stereo cameras the other view.
    image.save(tmp_path / "phone.jpg", format="MPO", save_all=True, append_images=[small])
    image.save(tmp_path / "stereo.jpg", format="MPO", save_all=True, append_images=[image.copy()])
    found = {photo.name: photo.further_images for photo in open_photos(tmp_path).photos}
    assert found == {"mask.tif": 0, "phone.jpg": 0, "reduced.tif": 0, "small.tif": 0, "stereo.jpg": 1}


GPANO = '<rdf:Description xmlns:GPano="http://ns.google.com/photos/1.0/panorama/" {}'


@pytest.mark.parametrize(
    "packet",
    ['GPano:ProjectionType="equirectangular"/>', "><GPano:ProjectionType>cylindrical</GPano:ProjectionType>"],
)
def test_panoramas_are_told_by_xmp(tmp_path: Path, packet: str) -> None:
    from PIL import Image, PngImagePlugin

    image, xmp = Image.fromarray(texture(48, 96)), GPANO.format(packet)
    image.save(tmp_path / "round.jpg", xmp=xmp.encode())
    info = PngImagePlugin.PngInfo()
    info.add_itxt("XML:com.adobe.xmp", xmp)
    image.save(tmp_path / "round.png", pnginfo=info)
    image.save(tmp_path / "usual.jpg", xmp=GPANO.format("/>").encode())
    found = open_photos(tmp_path)
    assert [p.name for p in found.photos if p.is_panorama] == ["round.jpg", "round.png"]
    (told,) = warnings_of_folder(found)
    assert told.startswith(
        "2 photos are panoramas by EXIF, XMP or their borders, first round.jpg: no camera model fits"
    )


def seen_all_around(height: int, seed: int) -> NDArray[np.uint8]:
    """Equirectangular image of waves in space on a sphere."""
    random = np.random.default_rng(seed)
    azimuth = (np.arange(2 * height) + 0.5) * np.pi / height
    polar = (np.arange(height)[:, None] + 0.5) * np.pi / height
    axes = (np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar) + 0 * azimuth)
    waves = np.tensordot(random.normal(0, 6, (12, 3)), np.stack(axes), axes=1)
    levels = 128 + 20 * np.sin(waves + np.arange(12)[:, None, None]).sum(axis=0)
    return levels.clip(0, 255).astype(np.uint8)


def test_panoramas_without_metadata_are_told_by_their_borders(tmp_path: Path) -> None:
    from PIL import Image

    around = seen_all_around(256, seed=1)
    white = np.full((256, 512), 255, np.uint8)  # an object before a white wall
    white[64:192, 128:384] = around[64:192, 128:384]
    others = {
        "half": around[:128, :256],
        "between": around[50:206, 100:412],
        "turned": around.T,
        "white": white,
        "sky": np.concatenate([np.full((128, 512), 200, np.uint8), around[64:192]]),
        "tiny": seen_all_around(64, seed=2),
    }
    for name, pixels in ({"around": around} | others).items():
        Image.fromarray(pixels).save(tmp_path / f"{name}.png")
    Image.fromarray(np.roll(around, 150, axis=1)).save(tmp_path / "rolled.jpg", quality=85)
    found = {photo.name for photo in open_photos(tmp_path).photos if photo.is_panorama}
    assert found == {"around.png", "rolled.jpg"}


def test_sweeps_of_phones_are_told_by_exif(tmp_path: Path) -> None:
    from PIL import Image

    for name, rendered in (("sweep", 6), ("hdr", 2)):
        image = Image.fromarray(texture(48, 96))
        exif = image.getexif()
        exif.get_ifd(0x8769)[0xA401] = rendered
        image.save(tmp_path / f"{name}.jpg", exif=exif)
    assert [p.name for p in open_photos(tmp_path).photos if p.is_panorama] == ["sweep.jpg"]
