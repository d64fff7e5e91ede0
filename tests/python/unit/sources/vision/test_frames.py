"""Folders of images and videos become grey frames in order, or an error that names the file."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from sfmcpp.errors import DatasetError
from sfmcpp.sources.vision import open_frames
from sfmcpp.sources.vision.images import load_cv2

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")


def write_grey(path: Path, grey: int, size: tuple[int, int] = (48, 64)) -> None:
    assert cv2.imwrite(str(path), np.full(size, grey, np.uint8))


def write_video(path: Path, greys: list[int], fps: float = 25.0) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), fps, (64, 48))
    assert writer.isOpened()
    for grey in greys:
        writer.write(np.full((48, 64, 3), grey, np.uint8))
    writer.release()


def levels(path: Path) -> list[int]:
    return [round(float(image.mean())) for image in open_frames(path)]


def test_images_come_by_name_with_numbers_by_value_and_other_files_are_left_alone(tmp_path: Path) -> None:
    for name, grey in [("f10.png", 30), ("f2.pgm", 20), ("f1.PNG", 10), ("g0.bmp", 40)]:
        write_grey(tmp_path / name, grey)
    (tmp_path / "notes.txt").write_text("no image")
    (tmp_path / "._f1.png").write_bytes(b"a companion file")
    assert levels(tmp_path) == [10, 20, 30, 40]
    assert len(open_frames(tmp_path)) == 4


def test_a_colour_image_becomes_its_luma(tmp_path: Path) -> None:
    blue_green_red = np.array([200, 100, 50])
    assert cv2.imwrite(str(tmp_path / "a.png"), np.tile(blue_green_red, (8, 8, 1)).astype(np.uint8))
    (image,) = open_frames(tmp_path)
    assert (image.shape, image.dtype) == ((8, 8), np.uint8)
    # ITU-R BT.601.
    assert abs(image.astype(float) - blue_green_red @ [0.114, 0.587, 0.299]).max() <= 1


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_deep_images_have_one_white(tmp_path: Path, bits: int) -> None:
    for name, grey in (("1.png", 200), ("2.png", 3), ("3.png", 255)):
        cv2.imwrite(str(tmp_path / name), np.full((48, 64), grey << (bits - 8), dtype=np.uint16))
    assert levels(tmp_path) == [200, 3, 255]


@pytest.mark.parametrize("dark", [0, 40])
def test_deep_images_of_a_camera_that_starts_in_the_dark_keep_their_highlights(
    tmp_path: Path, dark: int
) -> None:
    for number in range(30):
        grey = dark if number < 4 else 60_000 - 100 * number
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.full((48, 64), grey, dtype=np.uint16))
    found = levels(tmp_path)
    assert found[:4] == [0] * 4
    assert found[4:] == [(60_000 - 100 * number) // 256 for number in range(4, 30)]


def test_a_few_images_of_another_size_are_left_out_and_more_are_refused(tmp_path: Path) -> None:
    for number in range(20):
        write_grey(tmp_path / f"{number}.png", number)
    for number in (3, 19):
        write_grey(tmp_path / f"{number}.png", number, (6, 8))
    frames = open_frames(tmp_path)
    assert [number for number, _ in frames.numbered()] == [*range(3), *range(4, 19)]
    assert frames.unreadable["3.png"] == "has 8×6 pixels: must be 64×48 as 0.png"
    write_grey(tmp_path / "4.png", 4, (6, 8))
    with pytest.raises(DatasetError, match=r"the first, 3\.png: has 8×6 pixels: must be 64×48 as 0\.png"):
        list(frames.numbered())


def test_a_video_gives_its_frames_and_its_rate_as_often_as_asked(tmp_path: Path) -> None:
    write_video(tmp_path / "a.avi", [40, 80, 120], fps=12.5)
    frames = open_frames(tmp_path / "a.avi")
    assert (len(frames), frames.fps) == (3, 12.5)
    for _ in range(2):
        np.testing.assert_allclose([image.mean() for image in frames], [40, 80, 120], atol=2)


def test_an_image_that_cannot_be_decoded_is_named(tmp_path: Path) -> None:
    write_grey(tmp_path / "a.png", 10)
    for name, content in [
        ("b.png", b"text"),
        ("c.png", b""),
        ("d.png", (tmp_path / "a.png").read_bytes()[:30]),
    ]:
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(DatasetError, match=rf"{name}: is no image that can be decoded"):
            list(open_frames(tmp_path))
        path.unlink()


def test_an_image_of_another_size_is_named_with_both_sizes(tmp_path: Path) -> None:
    write_grey(tmp_path / "a.png", 10)
    write_grey(tmp_path / "b.png", 10, (48, 65))
    with pytest.raises(DatasetError, match=r"b\.png: has 65×48 pixels: must be 64×48 as a\.png"):
        list(open_frames(tmp_path))


def test_an_empty_folder_and_an_absent_one_are_told_apart(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="holds no image"):
        open_frames(tmp_path)
    with pytest.raises(DatasetError, match="no such file"):
        open_frames(tmp_path / "absent")


def test_a_video_without_frames_or_of_other_bytes_is_refused(tmp_path: Path) -> None:
    write_video(tmp_path / "none.avi", [])
    with pytest.raises(DatasetError, match=r"none\.avi: (the video has no frame|is no video)"):
        open_frames(tmp_path / "none.avi")
    (tmp_path / "text.mp4").write_text("no video")
    with pytest.raises(DatasetError, match=r"text\.mp4: is no video that can be decoded"):
        open_frames(tmp_path / "text.mp4")


def test_a_video_whose_name_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a\udcff.avi"
    write_video(tmp_path / "a.avi", [40, 80])
    (tmp_path / "a.avi").rename(path)
    with pytest.raises(DatasetError, match=r"'\\udcff' cannot be written as UTF-8"):
        open_frames(path)


def test_a_pipe_in_the_place_of_a_video_does_not_block(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.mp4")
    with pytest.raises(DatasetError, match="is not a regular file"):
        open_frames(tmp_path / "a.mp4")


@pytest.mark.parametrize("begin", ["ffconcat version 1.0\nfile {}\n", "#EXTM3U\n#EXTINF:1,\n{}\n"])
def test_a_list_of_videos_opens_none(tmp_path: Path, begin: str) -> None:
    write_video(tmp_path / "a.avi", [40, 80])
    (tmp_path / "list.mp4").write_text(begin.format("a.avi"))
    with pytest.raises(DatasetError, match="is a list of other files: must be a video"):
        open_frames(tmp_path / "list.mp4")


def test_without_opencv_the_error_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(DatasetError, match=r"images need cv2: pip install 'sfmcpp\[vision\]'"):
        open_frames(tmp_path)


@pytest.mark.parametrize("inside", [False, True], ids=["before 4.13", "4.13 and later"])
def test_opencv_of_any_version_is_silenced(inside: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[int] = []
    holder = SimpleNamespace(setLogLevel=told.append)
    opencv = SimpleNamespace(utils=SimpleNamespace(logging=holder)) if inside else holder
    monkeypatch.setitem(sys.modules, "cv2", opencv)
    assert load_cv2() is opencv
    assert told == [0]
