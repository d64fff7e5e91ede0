"""Photos of which no model, or only a part of one, can be made: what ``sfmcpp reconstruct`` says of them."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from cli_helpers import strict_json
from rendered import SMALL, photos_of, reconstructed, registered
from sfmcpp.cli.main import main

FEW = 6


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A few good photos."""
    folder = tmp_path_factory.mktemp("field") / "photos"
    photos_of("drone", folder, FEW)
    return folder


def refused(capsys: pytest.CaptureFixture[str], folder: Path, out: Path, *options: str, code: int = 2) -> str:
    """What is said of photos that give no model: one line, and the exit code."""
    assert main(["reconstruct", str(folder), "-o", str(out), "--quiet", *options]) == code
    shown = capsys.readouterr()
    assert (shown.out, len(shown.err.splitlines())) == ("", 1)
    assert shown.err.startswith(f"sfmcpp: error: {folder}: ") or options
    return shown.err


def test_a_folder_without_images(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos/readme.txt").write_text("no photo")
    assert "holds no image" in refused(capsys, tmp_path / "photos", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("place", "count", "options", "told"),
    [
        ("planar", 1, (), "only usable image"),
        ("identical", 3, (), "the photos are identical"),
        ("apart", 3, (), "matches no other image"),
        ("rotation", 4, (), "the camera only turned"),
        ("rotation", 4, ("--camera", "288"), "the camera only turned"),
    ],
)
def test_photos_that_tell_no_depth(
    place: str,
    count: int,
    options: tuple[str, ...],
    told: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    photos_of(place, tmp_path / "photos", count)
    said = refused(capsys, tmp_path / "photos", tmp_path / "out", *options, code=3)
    assert "no model" in said
    assert told in said
    report = strict_json(tmp_path / "out/report.json")
    assert (registered(report), len(report["images"])) == ([], count)
    assert all(outcome["reason"] for outcome in report["images"].values())


def test_masks_that_cover_everything(field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from PIL import Image

    black = Image.fromarray(np.zeros(SMALL[::-1], dtype=np.uint8))
    (tmp_path / "masks").mkdir()
    for photo in field.iterdir():
        black.save(tmp_path / "masks" / f"{photo.name}.png")
    said = refused(capsys, field, tmp_path / "out", "--masks", str(tmp_path / "masks"), code=3)
    assert "almost no features were detected outside its mask" in said


def test_positions_that_no_photo_tells_are_asked_for_before_the_work(
    field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(capsys, field, tmp_path / "out", "--gps", "exif")
    assert "--gps 'exif': no image tells its position with its height" in said
    assert not (tmp_path / "out").exists()
    table = tmp_path / "other.csv"
    table.write_text("name,lat,lon,height\nelsewhere.jpg,46.5,9.25,12.5\n")
    refused(capsys, field, tmp_path / "out", "--gps", str(table))
    assert not (tmp_path / "out").exists()


def test_a_calibration_matrix_of_other_images(
    field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "K.txt").write_text("2759.48 0 1520.69\n0 2764.16 1006.81\n0 0 1\n")
    said = refused(capsys, field, tmp_path / "out", "--camera", str(tmp_path / "K.txt"))
    assert "320×240" in said
    assert "images of another size" in said


def test_files_that_cannot_be_decoded_are_named_and_the_others_go_on(
    field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photos = tmp_path / "photos"
    shutil.copytree(field, photos)
    data = (photos / "0002.jpg").read_bytes()
    (photos / "0002.jpg").write_bytes(data[: len(data) // 2])
    (photos / "0006.jpg").write_bytes(b"no photo")
    assert main(["reconstruct", str(photos), "-o", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().err
    assert "partial model: 5 of 7 images" in said
    assert "0002.jpg" in said
    assert "0006.jpg" in said
    report = strict_json(tmp_path / "out/report.json")
    assert registered(report) == ["0000.jpg", "0001.jpg", "0003.jpg", "0004.jpg", "0005.jpg"]
    assert "truncated" in report["images"]["0002.jpg"]["reason"]
    assert "is no image" in report["images"]["0006.jpg"]["reason"]


def test_names_that_no_list_of_images_holds_are_told_and_the_others_go_on(
    field: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photos = tmp_path / "photos"
    shutil.copytree(field, photos)
    (photos / "0004.jpg").rename(photos / "new\nline.jpg")
    (photos / "0005.jpg").rename(os.fsdecode(os.fsencode(photos) + b"/bad\xff.jpg"))
    assert main(["reconstruct", str(photos), "-o", str(tmp_path / "out"), "--no-subpixel"]) == 0
    assert "partial model: 4 of 6 images" in capsys.readouterr().err
    report = strict_json(tmp_path / "out/report.json")
    assert registered(report) == ["0000.jpg", "0001.jpg", "0002.jpg", "0003.jpg"]
    told = {name: outcome["reason"] for name, outcome in report["images"].items()}
    assert "hold a line break" in told["new\nline.jpg"]
    assert sum("cannot be written as UTF-8" in reason for reason in told.values()) == 1


@pytest.mark.parametrize(("apart_deg", "height_m"), [(0.0, 100.0), (1e-4, 100.0), (1e-4, None)])
def test_positions_at_one_place_on_a_line_or_without_height_are_not_used(
    field: Path, tmp_path: Path, apart_deg: float, height_m: float | None
) -> None:
    from PIL import Image

    (tmp_path / "photos").mkdir()
    for k, photo in enumerate(sorted(field.iterdir())):
        told, height = Image.Exif(), {} if height_m is None else {6: height_m}
        place = {1: "N", 2: (45.0, 0.0, 0.0), 3: "E", 4: (7.0 + k * apart_deg, 0.0, 0.0)}
        told.get_ifd(0x8825).update(place | height)
        with Image.open(photo) as image:
            image.save(tmp_path / "photos" / photo.name, exif=told, quality=95)
    assert main(["reconstruct", str(tmp_path / "photos"), "-o", str(tmp_path / "out"), "--no-subpixel"]) == 0
    report = strict_json(tmp_path / "out/report.json")
    assert len(registered(report)) == FEW
    assert height_m is None or any(
        "positions that the files tell are not used" in w for w in report["warnings"]
    )


def test_images_of_two_sizes_get_a_camera_each(tmp_path: Path) -> None:
    photos, large = tmp_path / "photos", tmp_path / "large"
    first = photos_of("planar", photos, 8, image_size=(320, 240))
    second = photos_of("planar", large, 8, image_size=(400, 300), focal_px=350.0)
    for number in (1, 3, 5):
        shutil.copy(large / f"{number:04d}.jpg", photos)
    _, report = reconstructed(photos, tmp_path / "out")
    assert len(registered(report)) == 8
    found = {camera["width"]: camera["focal_px"] for camera in report["cameras"]}
    assert found[320] == pytest.approx(first.intrinsics[0, 0], rel=0.01)
    assert found[400] == pytest.approx(second.intrinsics[0, 0], rel=0.01)


def test_a_focal_length_that_nothing_tells_is_said_to_be_a_guess(tmp_path: Path) -> None:
    photos_of("planar", tmp_path / "photos", 3)
    _, report = reconstructed(tmp_path / "photos", tmp_path / "out")
    assert any("focal length" in warning and "guess" in warning for warning in report["warnings"])


def test_one_plane_with_an_unknown_focal_length_is_right_or_said_not_to_be(tmp_path: Path) -> None:
    truth = photos_of("planar", tmp_path / "photos", FEW)
    code, report = reconstructed(tmp_path / "photos", tmp_path / "out")
    assert (code, len(registered(report))) == (0, FEW)
    focal = sfmcpp.read(tmp_path / "out/model").intrinsics[0, 0]
    assert focal == pytest.approx(truth.intrinsics[0, 0], rel=0.01) or report["warnings"]
