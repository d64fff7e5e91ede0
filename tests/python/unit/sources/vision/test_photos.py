"""Photos of a folder: what they tell, and that damaged ones are named."""

from __future__ import annotations

import io
import math
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.photos import Photo
from sfmcpp.sources.vision import (
    open_photos,
    read_color,
    read_gray,
    read_mask,
    thumbnail_jpeg,
    without_copies,
)
from sfmcpp.sources.vision.photos import read_color_and_opaque
from textured_photos import cut_short, texture, write_photo

Image = pytest.importorskip("PIL.Image", reason="Pillow is not installed: pip install 'sfmcpp[vision]'")
cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")

SMALL = texture(48, 64)
MAKE, MODEL, ORIENTATION = 0x010F, 0x0110, 0x0112
FOCAL, FOCAL_35MM, PLANE_X, PLANE_UNIT, STORED_WIDTH = 0x920A, 0xA405, 0xA20E, 0xA210, 0xA002
TAKEN, TAKEN_FRACTION, LENS = 0x9003, 0x9291, 0xA434


def only(folder: Path) -> Photo:
    (photo,) = open_photos(folder).photos
    return photo


def test_equal_content_has_an_equal_digest_and_a_mask_changes_it(tmp_path: Path) -> None:
    for name in ("a.png", "b.png"):
        write_photo(tmp_path / "photos" / name, SMALL)
    write_photo(tmp_path / "photos/c.png", 255 - SMALL)
    a, b, c = (photo.digest for photo in open_photos(tmp_path / "photos").photos)
    assert a == b != c
    write_photo(tmp_path / "masks/b.png", 255 - 0 * SMALL)
    masked = open_photos(tmp_path / "photos", masks=tmp_path / "masks").photos
    assert masked[0].digest == a
    assert masked[1].digest not in (a, c)


def test_of_photos_with_the_same_bytes_the_shortest_name_stays(tmp_path: Path) -> None:
    for name, picture in (("a.png", SMALL), ("a copy.png", SMALL), ("c.png", 255 - SMALL), ("d.png", SMALL)):
        write_photo(tmp_path / "photos" / name, picture)
    found = open_photos(tmp_path / "photos")
    kept = without_copies(found)
    assert [photo.name for photo in kept.photos] == ["a.png", "c.png"]
    assert kept.copies == {"a copy.png": "a.png", "d.png": "a.png"}
    assert (len(found.photos), found.copies) == (4, {})
    # With a mask of its own a copy shows something else.
    write_photo(tmp_path / "masks/d.png", 255 - 0 * SMALL)
    masked = without_copies(open_photos(tmp_path / "photos", masks=tmp_path / "masks"))
    assert [photo.name for photo in masked.photos] == ["a.png", "c.png", "d.png"]


@pytest.mark.parametrize(
    ("tags", "focal_px"),
    [
        ({FOCAL_35MM: 35}, 35 / math.hypot(36, 24) * math.hypot(64, 48)),
        # 6 mm on a sensor of 100 pixels a millimetre, and the photo half as large as it was.
        ({FOCAL: 6, PLANE_X: 1000, PLANE_UNIT: 3, STORED_WIDTH: 128}, 6 * 100 * 0.5),
        ({FOCAL: 0.5, PLANE_X: 2540, PLANE_UNIT: 2}, 0.5 * 100),
        ({FOCAL: 6}, None),
        ({FOCAL_35MM: 0}, None),
        ({FOCAL_35MM: 60_000}, None),
        ({FOCAL: math.nan, PLANE_X: 1000}, None),
    ],
)
def test_the_focal_length_in_pixels_is_that_of_the_tags(
    tmp_path: Path, tags: dict[int, Any], focal_px: float | None
) -> None:
    write_photo(tmp_path / "a.jpg", SMALL, exif=tags)
    assert only(tmp_path).focal_px == (focal_px if focal_px is None else pytest.approx(focal_px, rel=1e-6))


def test_photos_of_one_camera_at_one_focal_length_and_size_have_one_key(tmp_path: Path) -> None:
    body = {MAKE: "Maker\0\0", MODEL: "M 1 "}
    write_photo(tmp_path / "a.jpg", SMALL, body, exif={FOCAL: 6, LENS: "50mm"})
    write_photo(tmp_path / "b.jpg", 255 - SMALL, {**body, ORIENTATION: 6}, exif={FOCAL: 6, LENS: "50mm"})
    write_photo(tmp_path / "c.jpg", SMALL, body, exif={FOCAL: 7, LENS: "50mm"})
    write_photo(tmp_path / "d.jpg", SMALL[:40], body, exif={FOCAL: 6, LENS: "50mm"})
    write_photo(tmp_path / "e.jpg", SMALL, body)
    write_photo(tmp_path / "f.jpg", SMALL, exif={FOCAL: 6})
    keys = [photo.camera for photo in open_photos(tmp_path).photos]
    assert keys[0] == keys[1] == "Maker | M 1 | 50mm | 6 mm | 64×48"
    assert len(set(keys[:4])) == 3
    assert keys[4:] == ["", "6 mm | 64×48"]


def gps(latitude: Any, longitude: Any, north: str = "N", east: str = "E", **rest: Any) -> dict[int, Any]:
    height = {5: rest["below"], 6: rest["height"]} if "height" in rest else {}
    status = {9: rest["status"]} if "status" in rest else {}
    return {1: north, 2: latitude, 3: east, 4: longitude, **height, **status}


@pytest.mark.parametrize(
    ("tags", "position"),
    [
        (gps((46, 30, 36.0), (8, 15, 0.0), height=1200.5, below=b"\0"), (46.51, 8.25, 1200.5)),
        (gps((46, 30.6, 0), (8, 15, 0), "S", "W", height=12.5, below=b"\1"), (-46.51, -8.25, -12.5)),
        (gps((46, 30, 36), (8, 15, 0), height=3.5, below=b"\3"), (46.51, 8.25, -3.5)),
        (gps((46, 30, 36), (8, 15, 0), height=3.5, below=b"\2"), (46.51, 8.25, 3.5)),
        (gps((46.51, 0, 0), (8.25, 0, 0)), (46.51, 8.25, math.nan)),
        (gps((0, 0, 0), (0, 0, 0), height=0, below=b"\0"), None),
        (gps((46, 30, 36.0), (8, 15, 0.0), status="V"), None),
        (gps((95, 0, 0), (8, 15, 0)), None),
        (gps((46, 30, 36.0), (8, 15, 0.0), north=""), None),
        ({2: (46, 30, 36.0), 1: "N"}, None),
    ],
)
def test_the_position_is_that_of_the_gps_block(
    tmp_path: Path, tags: dict[int, Any], position: tuple[float, ...] | None
) -> None:
    write_photo(tmp_path / "a.jpg", SMALL, gps=tags)
    found = only(tmp_path).position
    assert found == (position if position is None else pytest.approx(position, abs=1e-9, nan_ok=True))


@pytest.mark.parametrize(
    ("later", "seconds"),
    [
        ({TAKEN: "2024:02:29 12:00:03", TAKEN_FRACTION: "250"}, 3.25),
        ({TAKEN: "2024:03:01 12:00:00"}, 86_400),
        ({0x9004: "2024:02:29 12:00:01"}, 1.0),
    ],
)
def test_times_differ_as_the_clock_of_the_camera_says(
    tmp_path: Path, later: dict[int, Any], seconds: float
) -> None:
    write_photo(tmp_path / "a.jpg", SMALL, exif={TAKEN: "2024:02:29 12:00:00"})
    write_photo(tmp_path / "b.jpg", SMALL, exif=later)
    first, second = (photo.taken_s for photo in open_photos(tmp_path).photos)
    assert first is not None
    assert second is not None
    assert second - first == seconds


@pytest.mark.parametrize("taken", ["0000:00:00 00:00:00", "    :  :     :  :  ", "yesterday"])
def test_an_unset_clock_tells_no_time(tmp_path: Path, taken: str) -> None:
    write_photo(tmp_path / "a.jpg", SMALL, exif={TAKEN: taken})
    assert only(tmp_path).taken_s is None


def test_a_damaged_exif_block_counts_as_none(tmp_path: Path) -> None:
    file = write_photo(tmp_path / "a.jpg", SMALL, {MAKE: "Maker", MODEL: "M"}, exif={FOCAL_35MM: 35})
    data = file.read_bytes()
    start = data.index(b"Exif\0\0") + 6
    for at in range(start, start + 60, 3):
        file.write_bytes(data[:at] + b"\xff\x7f\xee" + data[at + 3 :])
        assert only(tmp_path).size == (64, 48)


def test_pixels_are_as_they_are_stored(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (5, 7, 3), np.uint8)
    write_photo(tmp_path / "a.png", pixels, {ORIENTATION: 6})
    photo = only(tmp_path)
    assert photo.size == (7, 5)
    np.testing.assert_array_equal(read_color(photo), pixels)
    # ITU-R BT.601.
    np.testing.assert_allclose(read_gray(photo), pixels @ [0.299, 0.587, 0.114], atol=1)


def test_deep_and_indexed_pixels_are_read(tmp_path: Path) -> None:
    grey = np.arange(12, dtype=np.uint8).reshape(3, 4) * 20
    Image.fromarray(grey.astype(np.uint16) * 257).save(tmp_path / "deep.png")
    Image.fromarray(grey).convert("P").save(tmp_path / "indexed.png")
    Image.fromarray(grey).convert("LA").save(tmp_path / "transparent.png")
    for photo in open_photos(tmp_path).photos:
        np.testing.assert_array_equal(read_gray(photo), grey, err_msg=photo.name)


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_deep_pixels_use_all_of_eight_bits(tmp_path: Path, bits: int) -> None:
    grey = np.arange(12, dtype=np.uint16).reshape(3, 4) * 20 + 30
    Image.fromarray(grey << (bits - 8)).save(tmp_path / "deep.png")
    np.testing.assert_array_equal(read_gray(only(tmp_path)), grey)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".ppm"])
@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_deep_colours_use_all_of_eight_bits(tmp_path: Path, bits: int, suffix: str) -> None:
    rgb = np.arange(36, dtype=np.uint16).reshape(3, 4, 3) * 5 + 60
    assert cv2.imwrite(str(tmp_path / f"deep{suffix}"), (rgb << (bits - 8))[:, :, ::-1])
    np.testing.assert_array_equal(read_color(only(tmp_path)), rgb)


@pytest.mark.parametrize("bits", [12, 16])
def test_deep_colours_beside_transparent_parts_are_read(tmp_path: Path, bits: int) -> None:
    bgra = np.arange(48, dtype=np.uint16).reshape(3, 4, 4) * 4 + 60
    bgra[:, 2:, 3] = 0
    assert cv2.imwrite(str(tmp_path / "deep.png"), bgra << (bits - 8))
    pixels, opaque = read_color_and_opaque(only(tmp_path))
    np.testing.assert_array_equal(pixels, bgra[:, :, 2::-1])
    assert opaque is not None
    np.testing.assert_array_equal(opaque, bgra[:, :, 3] > 0)


def test_of_fractions_one_is_white(tmp_path: Path) -> None:
    grey = np.arange(12, dtype=np.float32).reshape(3, 4) / 11
    for name, scale in (("fractions.tif", 1), ("levels.tif", 255)):
        Image.fromarray(grey * np.float32(scale)).save(tmp_path / name)
    for photo in open_photos(tmp_path).photos:
        np.testing.assert_array_equal(read_gray(photo), np.rint(grey * 255), err_msg=photo.name)


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif", ".webp", ".bmp"])
def test_a_truncated_photo_is_found_out_when_it_is_read(tmp_path: Path, suffix: str) -> None:
    file = cut_short(write_photo(tmp_path / f"a{suffix}", texture(200, 300)))
    write_photo(tmp_path / "whole.png", SMALL)
    found = open_photos(tmp_path)
    opened = {photo.name: photo for photo in found.photos}
    if file.name in opened:
        for read in (read_gray, read_color, lambda photo: thumbnail_jpeg(photo, 50)):
            with pytest.raises(DatasetError, match=rf"a\{suffix}: cannot be decoded"):
                read(opened[file.name])
    else:
        assert "decoded" in found.unreadable[file.name]


def test_what_is_no_image_is_unreadable_and_the_others_stay(tmp_path: Path) -> None:
    write_photo(tmp_path / "good.jpg", SMALL)
    (tmp_path / "empty.jpg").write_bytes(b"")
    (tmp_path / "text.png").write_text("no image at all")
    (tmp_path / "phone.jpg").write_bytes(b"\0\0\0\x18ftypheic" + bytes(50))
    found = open_photos(tmp_path)
    assert [photo.name for photo in found.photos] == ["good.jpg"]
    assert found.unreadable == {
        "empty.jpg": "the file is empty",
        "phone.jpg": "is HEIC in spite of its name: convert it to JPEG",
        "text.png": "is no image that can be decoded (15 bytes)",
    }


def test_a_folder_without_readable_photos_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no such file or directory"):
        open_photos(tmp_path / "missing")
    with pytest.raises(DatasetError, match="holds no image: must have files named"):
        open_photos(tmp_path)
    (tmp_path / "a.jpg").write_bytes(b"xyz")
    with pytest.raises(DatasetError, match=r"none of its 1 images can be read; a\.jpg: is no image"):
        open_photos(tmp_path)
    with pytest.raises(DatasetError, match="is no folder"):
        open_photos(tmp_path / "a.jpg")


def test_masks_are_found_by_either_name_and_are_no_photos_themselves(tmp_path: Path) -> None:
    for name in ("a.jpg", "sub/b.jpg", "c.jpg"):
        write_photo(tmp_path / name, SMALL)
    mask = np.zeros_like(SMALL)
    mask[:, 20:] = 1
    write_photo(tmp_path / "masks/a.jpg.png", mask)
    write_photo(tmp_path / "masks/sub/b.png", mask)
    a, c, b = open_photos(tmp_path, masks=tmp_path / "masks").photos
    assert [photo.mask and photo.mask.name for photo in (a, b, c)] == ["a.jpg.png", "b.png", None]
    for photo in (a, b):
        assert photo.mask is not None
        found = read_mask(photo.mask, photo.size, photo.name)
        np.testing.assert_array_equal(found, mask[:, :, 0] > 0)


@pytest.mark.parametrize("level", [1, 255, 256, 65535])
def test_a_mask_of_16_bits_is_black_where_it_is_zero(tmp_path: Path, level: int) -> None:
    write_photo(tmp_path / "photos/a.png", SMALL)
    light = np.zeros(SMALL.shape[:2], np.bool_)
    light[10:, 20:] = True
    (tmp_path / "masks").mkdir()
    Image.fromarray((level * light).astype(np.uint16)).save(tmp_path / "masks/a.png")
    (photo,) = open_photos(tmp_path / "photos", masks=tmp_path / "masks").photos
    assert photo.mask is not None
    np.testing.assert_array_equal(read_mask(photo.mask, photo.size, photo.name), light)


def test_wrong_masks_are_refused(tmp_path: Path) -> None:
    write_photo(tmp_path / "photos/a.jpg", SMALL)
    masks = tmp_path / "masks"
    with pytest.raises(DatasetError, match="no such file or directory"):
        open_photos(tmp_path / "photos", masks=masks)
    masks.mkdir()
    with pytest.raises(DatasetError, match=r"holds no mask of any photo: there is no a\.jpg\.png"):
        open_photos(tmp_path / "photos", masks=masks)
    write_photo(masks / "a.png", SMALL[:40])
    with pytest.raises(DatasetError, match=r"a\.png: the mask has 64×40 pixels: must be 64×48 as a\.jpg"):
        open_photos(tmp_path / "photos", masks=masks)
    (masks / "a.png").write_bytes(b"xyz")
    with pytest.raises(DatasetError, match=r"a\.png: is no image"):
        open_photos(tmp_path / "photos", masks=masks)


def test_a_photo_that_has_changed_or_gone_is_named(tmp_path: Path) -> None:
    photo_file = write_photo(tmp_path / "a.png", SMALL)
    photo = only(tmp_path)
    write_photo(photo_file, SMALL[:40])
    with pytest.raises(DatasetError, match="has 64×40 pixels now, and had 64×48"):
        read_gray(photo)
    photo_file.unlink()
    with pytest.raises(DatasetError, match=r"a\.png: no such file"):
        read_gray(photo)
    with pytest.raises(DatasetError, match="by its tracks alone"):
        read_gray(Photo("b"))


@pytest.mark.parametrize(("longest", "size"), [(32, (32, 24)), (500, (64, 48))])
def test_a_thumbnail_is_a_small_jpeg_of_the_same_picture(
    tmp_path: Path, longest: int, size: tuple[int, int]
) -> None:
    ramp = np.repeat(np.linspace(0, 255, 64).astype(np.uint8)[None, :, None], 48, axis=0).repeat(3, axis=2)
    write_photo(tmp_path / "a.jpg", ramp)
    with Image.open(io.BytesIO(thumbnail_jpeg(only(tmp_path), longest))) as small:
        assert (small.format, small.size) == ("JPEG", size)
        wanted = np.linspace(0, 255, size[0])
        np.testing.assert_allclose(np.asarray(small.convert("L"))[5], wanted, atol=6)
    with pytest.raises(InvalidArgument, match="longest_px = 0"):
        thumbnail_jpeg(only(tmp_path), 0)


def test_without_pillow_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_photo(tmp_path / "a.jpg", SMALL)
    monkeypatch.setitem(sys.modules, "PIL", None)
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'sfmcpp\[vision\]'"):
        open_photos(tmp_path)


def packet(flag: str = "50", east: str = "0.012", element: bool = False) -> bytes:
    """An XMP packet as RTK drones write it."""
    told = {"RtkFlag": flag, "RtkStdLon": east, "RtkStdLat": "0.014", "RtkStdHgt": "0.025"}
    pieces = (
        f"<drone-dji:{k}>{v}</drone-dji:{k}>" if element else f'drone-dji:{k}="{v}"' for k, v in told.items()
    )
    return f"<x:xmpmeta>{' '.join(pieces)}</x:xmpmeta>".encode()


@pytest.mark.parametrize(
    ("xmp", "sigmas"),
    [
        (packet(), (0.012, 0.014, 0.025)),
        (packet(element=True), (0.012, 0.014, 0.025)),
        (packet(flag="16", east="+1.500"), (1.5, 0.014, 0.025)),
        (packet(flag="0"), None),
        (packet(east="0.0"), None),
        (packet(east="nan"), None),
        (b"<x:xmpmeta></x:xmpmeta>", None),
    ],
)
@pytest.mark.parametrize("positioned", [True, False])
def test_the_accuracy_of_the_position_is_that_of_the_xmp_packet(
    tmp_path: Path, xmp: bytes, sigmas: tuple[float, ...] | None, positioned: bool
) -> None:
    exif = Image.Exif()
    exif.get_ifd(0x8825).update(
        gps((46, 30, 36.0), (8, 15, 0.0), height=1200.5, below=b"\0") if positioned else {}
    )
    Image.fromarray(SMALL).save(tmp_path / "a.jpg", exif=exif)
    whole = (tmp_path / "a.jpg").read_bytes()
    segment = b"http://ns.adobe.com/xap/1.0/\0" + xmp
    # Behind the start of the image.
    size = (len(segment) + 2).to_bytes(2, "big")
    (tmp_path / "a.jpg").write_bytes(whole[:2] + b"\xff\xe1" + size + segment + whole[2:])
    assert only(tmp_path).position_sigmas_m == (sigmas if positioned else None)


@pytest.mark.real
def test_drone_photos_tell_their_focal_length_and_place(data_dir: Path) -> None:
    photos = open_photos(data_dir / "drone_beach" / "images").photos
    assert len(photos) == 18
    assert len({photo.camera for photo in photos}) == 1
    latitudes, longitudes, heights = np.array([photo.position for photo in photos]).T
    # On the shore of Lake Superior near Duluth, within 84 m.
    assert np.ptp(latitudes) * 111_000 < 90
    assert np.ptp(longitudes) * 76_000 < 90
    assert abs(latitudes.mean() - 46.84) < 0.01
    assert abs(longitudes.mean() + 91.99) < 0.01
    assert 180 < heights.mean() < 300
    times = [photo.taken_s for photo in photos]
    assert times == sorted(times)
