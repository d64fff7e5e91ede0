"""Images come one at a time; their camera and times from the user or the files beside them, nearest first."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from sfmcpp import slam
from sfmcpp.errors import DatasetError
from sfmcpp.sources.cameras import find_camera, read_intrinsics
from sfmcpp.sources.drives import open_drive
from sfmcpp.sources.image_stream import ImageStream, open_images
from sfmcpp.sources.vision import Frames, KltSettings, follow_features, open_frames

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")

ROW = "700 0 600 {} 0 770 180 0 0 0 1 0"
CAMERA = (90.0, 1.0, 32.0, 24.0, 0.0)


def write_images(folder: Path, count: int = 3) -> Path:
    """Noise that moves a pixel to the right from image to image."""
    folder.mkdir()
    noise = np.random.default_rng(0).integers(0, 256, (48, 64 + count)).astype(np.uint8)
    noise = cv2.GaussianBlur(noise, (5, 5), 1.2)
    for number in range(count):
        assert cv2.imwrite(str(folder / f"{number}.png"), noise[:, count - number :][:, :64])
    return folder


def times_of(images: Path, fps: float | None = None, stamps: np.ndarray | None = None) -> list[float]:
    return [frame.t_s for frame in open_images(images, CAMERA, fps, stamps=stamps)[0]]


def test_frames_see_the_tracks_of_all_images_read_one_after_the_other(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images", 6)
    stream, _ = open_images(images, CAMERA)
    expected = list(follow_features(open_frames(images)))
    frames = list(stream)
    assert [frame.number for frame in frames] == list(range(6))
    for frame, view in zip(frames, expected, strict=True):
        np.testing.assert_array_equal(frame.view.tracks, view.tracks)
        np.testing.assert_array_equal(frame.view.pixels, view.pixels)
    assert len(stream) == 6
    assert stream.num_tracks == max(view.tracks.max() for view in expected) + 1 > 0
    assert stream.seconds > 0


def test_a_bad_image_is_left_out_and_known_once_its_turn_has_come(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images", 5)
    (images / "2.png").write_text("no picture")
    stream, _ = open_images(images, CAMERA, fps=10.0)
    frames = iter(stream)
    next(frames)
    assert next(frames).number == 1
    assert stream.unreadable == {}
    after = next(frames)
    assert (after.number, after.t_s) == (3, pytest.approx(0.3))
    assert len(after.view.tracks) > 0
    assert next(frames, None) is not None
    assert next(frames, None) is None
    assert stream.unreadable == {"2.png": "is no image that can be decoded (10 bytes)"}
    assert len(stream) == 4


def test_images_that_are_left_out_change_neither_what_frames_are_nor_when_they_end(
    tmp_path: Path,
) -> None:
    images = write_images(tmp_path / "images", 5)
    (images / "2.png").write_text("no picture")
    stream, _ = open_images(images, CAMERA, fps=10.0)
    before = stream.identity()
    for _ in range(2):
        assert [frame.number for frame in stream] == [0, 1, 3, 4]
        assert stream.span_s == pytest.approx((0.0, 0.4))
        after = stream.identity()
        assert after.pop("camera").tolist() == stream.intrinsics.tolist()
        assert after == {name: value for name, value in before.items() if name != "camera"}


def test_more_than_a_tenth_of_bad_images_are_refused(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images", 20)
    for number in (0, 7):
        (images / f"{number}.png").write_text("no picture")
    assert [frame.number for frame in open_images(images, CAMERA)[0]] == [*range(1, 7), *range(8, 20)]
    (images / "19.png").write_text("")
    refused = r"3 of its 20 images cannot be read: may be 10% and no more; the first, 0\.png: is no image"
    with pytest.raises(DatasetError, match=refused):
        list(open_images(images, CAMERA)[0])


def test_a_folder_of_bad_images_is_refused(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images", 1)
    (images / "0.png").write_text("no picture")
    with pytest.raises(DatasetError, match=r"none of its images can be read; 0\.png: is no image"):
        open_images(images, CAMERA)


def test_the_corners_asked_for_are_followed(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images")
    streams = [open_images(images, CAMERA, corners=corners)[0] for corners in ("shi-tomasi", "harris")]
    one, other = (next(iter(stream)).view.pixels for stream in streams)
    assert one.shape != other.shape or (one != other).any()


def test_a_stream_knows_its_images(tmp_path: Path) -> None:
    stream = open_images(write_images(tmp_path / "images"), CAMERA)[0]
    first = next(iter(stream.image_names))
    height, width = cv2.imread(str(tmp_path / "images" / first)).shape[:2]
    next(iter(stream))
    assert (stream.image_size, stream.first_pixel_px) == ((width, height), 0.0)
    assert stream.image_names == sorted(file.name for file in (tmp_path / "images").iterdir())


def write_video(path: Path, count: int, codec: str = "MJPG", noise: float = 0.0) -> Path:
    writer, rng = (
        cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), 10.0, (64, 48)),
        np.random.default_rng(0),
    )
    for number in range(count):
        writer.write((20 * number + noise * rng.uniform(size=(48, 64, 3))).astype(np.uint8))
    writer.release()
    return path


def test_a_video_that_is_cut_short_gives_what_there_is_and_says_so(tmp_path: Path) -> None:
    video = write_video(tmp_path / "clip.avi", 12, noise=30.0)
    whole, _ = open_images(video, CAMERA)
    assert (len(list(whole)), whole.shortfall) == (12, None)
    content = video.read_bytes()
    video.write_bytes(content[: 2 * len(content) // 3])
    frames = open_drive(video, camera=CAMERA).frames
    count = len(list(frames))
    assert 0 < count < 10
    assert frames.shortfall == f"only {count} of the 12 frames that it declares can be decoded"
    assert (
        f"the video is cut short or damaged: {frames.shortfall}"
        in slam.run(video, camera=CAMERA).result.warnings
    )


class LongerVideo(Frames):
    """A video whose container declares more frames than there are."""

    def __init__(self, path: Path, declared: int) -> None:
        self.path, self._frames, self._declared = path, open_frames(path), declared

    def __len__(self) -> int:
        return self._declared

    @property
    def fewest(self) -> int:
        return self._declared - 2

    def __iter__(self) -> Iterator[np.ndarray]:
        return iter(self._frames)


def test_a_video_with_fewer_frames_than_declared_is_counted_as_it_is(tmp_path: Path) -> None:
    video = LongerVideo(write_video(tmp_path / "clip.avi", 5), declared=6)
    stream = ImageStream(video, np.array(CAMERA), lambda number: 0.1 * number, KltSettings())
    assert len(stream) == 6
    assert [frame.number for frame in stream] == list(range(5))
    assert len(stream) == 5


def with_uneven_times(path: Path, steps: list[tuple[int, int]]) -> Path:
    """A video (.mp4) with other times between its frames: how many, and halves of the usual."""
    content = path.read_bytes()
    table = content.index(b"stts")
    length, _, count, _, usual = struct.unpack(">I4xIIII", content[table - 4 : table + 20])
    assert (length, count) == (24, 1)
    entries = b"".join(struct.pack(">II", number, halves * usual // 2) for number, halves in steps)
    patched = content[: table + 8] + struct.pack(">I", len(steps)) + entries + content[table + 20 :]
    for box in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts"):
        at = content.index(box) - 4
        size = struct.unpack(">I", patched[at : at + 4])[0] + 8 * (len(steps) - 1)
        patched = patched[:at] + struct.pack(">I", size) + patched[at + 4 :]
    path.write_bytes(patched)
    return path


def test_frames_of_a_video_have_the_times_that_it_tells(tmp_path: Path) -> None:
    video = with_uneven_times(write_video(tmp_path / "clip.mp4", 6, "mp4v"), [(2, 2), (2, 1), (2, 3)])
    stream, _ = open_images(video, CAMERA)
    before = repr(stream.identity())
    times = [frame.t_s for frame in stream]
    np.testing.assert_allclose(np.diff(times) / 0.1, [1, 1, 0.5, 0.5, 1.5], rtol=1e-3)
    assert times[0] == 0
    assert repr(stream.identity()) == before
    given, _ = open_images(video, CAMERA, fps=10.0)
    assert [frame.t_s for frame in given] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4, 0.5])


def test_poses_of_a_video_are_those_of_its_frames_whatever_their_times(tmp_path: Path) -> None:
    video = with_uneven_times(write_video(tmp_path / "clip.mp4", 6, "mp4v"), [(2, 2), (2, 1), (2, 3)])
    (tmp_path / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 6)
    stream, truth = open_images(video, CAMERA)
    assert truth is not None
    assert [frame.t_s for frame in stream] == truth.t_s.tolist()


def test_images_alone_in_a_video_need_a_rate(tmp_path: Path) -> None:
    images = [cv2.imread(str(f), 0) for f in sorted(write_images(tmp_path / "images", 4).iterdir())]
    video = tmp_path / "clip.mjpeg"
    video.write_bytes(b"".join(bytes(cv2.imencode(".jpg", image)[1]) for image in images))
    with pytest.raises(DatasetError, match=r"the video tells no frame rate: give --fps"):
        open_drive(video, camera=CAMERA)
    frames = open_drive(video, camera=CAMERA, fps=5.0).frames
    assert [frame.t_s for frame in frames] == pytest.approx([0.0, 0.2, 0.4, 0.6])


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("calib.txt", f"{ROW.format(0)}\n{ROW.format(-379.8)}", (700, 1.1, 600, 180, 0)),
        ("calib.txt", f"P0: {ROW.format(0)}\nTr: 0 0 0 0 0 0 0 0 0 0 0 0\n", (700, 1.1, 600, 180, 0)),
        ("calib.txt", f"calib_time: 09-Jan-2012\nS_rect_00: 1 2\nP_rect_00: {ROW.format(0)}\n",
         (700, 1.1, 600, 180, 0)),
        ("K.txt", "700 0.5 600\n0 770 180\n0 0 1", (700, 1.1, 600, 180, 0.5)),
        ("Kfull.txt", "700 0.5 600\n0 770 180\n0 0 1", (700, 1.1, 600, 180, 0.5)),
        ("K.txt", "# a camera\n7e2, 0, 600\n0, 770, 180\n0, 0, 1\n", (700, 1.1, 600, 180, 0)),
    ],
)  # fmt: skip
def test_a_camera_is_read_in_the_forms_in_which_data_sets_give_it(
    tmp_path: Path, name: str, content: str, expected: tuple[float, ...]
) -> None:
    (tmp_path / name).write_text(content)
    np.testing.assert_allclose(read_intrinsics(tmp_path / name), expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("calib.txt", "Tr: 1 2 3", "holds no row of 12 numbers"),
        ("calib.txt", f"P0: {ROW.format(0)}\nP2: 9{ROW.format(0)}", "its cameras differ"),
        ("calib.txt", ROW.format(0).replace("770", "-770"), "fu, fv and their ratio positive"),
        ("K.txt", "700 0 600 0 770 180 0 0 2", "must be"),
        ("K.txt", "1e-200 0 600 0 1e200 180 0 0 1", "fu, fv and their ratio positive and finite"),
        ("K.txt", "700 0 x 0 770 180 0 0 1", "K.txt:1: 'x' is not a finite number"),
    ],
)
def test_a_file_without_one_camera_is_refused(tmp_path: Path, name: str, content: str, told: str) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(DatasetError) as caught:
        read_intrinsics(tmp_path / name)
    assert told in str(caught.value)


def test_the_camera_nearest_to_the_images_counts(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images")
    (tmp_path / "calib.txt").write_text(ROW.format(0))
    assert read_intrinsics(find_camera(images))[0] == 700
    assert read_intrinsics(find_camera(tmp_path / "video.mp4"))[0] == 700
    (images / "K.txt").write_text("500 0 32 0 500 24 0 0 1")
    assert read_intrinsics(find_camera(images))[0] == 500


def test_a_camera_for_images_of_another_size_is_refused(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images")
    text = "cam0:\n  camera_model: pinhole\n  intrinsics: [90, 90, 32, 24]\n  resolution: [{}, 48]\n"
    (tmp_path / "a.yaml").write_text(text.format(64))
    assert len(list(open_images(images, tmp_path / "a.yaml")[0])) == 3
    (tmp_path / "a.yaml").write_text(text.format(128))
    with pytest.raises(DatasetError, match="images have 64×48 pixels, the camera is for 128×48"):
        open_images(images, tmp_path / "a.yaml")
    (tmp_path / "a.yaml").write_text(
        "image_width: 640\nimage_height: 480\nK: [90, 0, 32, 0, 90, 24, 0, 0, 1]\n"
    )
    with pytest.raises(DatasetError, match="the camera is for 640×480"):
        open_images(images, tmp_path / "a.yaml")


def test_images_that_repeat_the_one_before_are_a_warning(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images", 12)
    assert not any("repeat" in warning for warning in slam.run(images, camera=CAMERA).result.warnings)
    for number in (4, 5, 6, 9):
        (images / f"{number}.png").write_bytes((images / f"{8 if number == 9 else 3}.png").read_bytes())
    (warning,) = (text for text in slam.run(images, camera=CAMERA).result.warnings if "repeat" in text)
    assert warning.startswith("4 frames repeat the image before to the last bit, at 4 to 6, 9: ")


def test_a_mask_leaves_out_a_part_of_all_images(tmp_path: Path) -> None:
    images, mask = write_images(tmp_path / "images"), tmp_path / "mask.png"
    black_below = np.full((48, 64), 255, np.uint8)
    black_below[20:] = 0
    cv2.imwrite(str(mask), black_below)
    frames = open_drive(images, camera=CAMERA, mask=mask).frames
    seen = np.concatenate([frame.view.pixels for frame in frames])
    assert len(seen) > 0
    assert seen[:, 1].max() < 20
    assert repr(frames.identity()) != repr(open_images(images, CAMERA)[0].identity())
    cv2.imwrite(str(mask), black_below[:, 1:])
    with pytest.raises(DatasetError, match=r"mask\.png: the mask has 63×48 pixels: must be 64×48 as"):
        open_drive(images, camera=CAMERA, mask=mask)
    mask.write_text("black")
    with pytest.raises(DatasetError, match=r"mask\.png: is no image that can be decoded \(5 bytes\)"):
        open_drive(images, camera=CAMERA, mask=mask)
    (tmp_path / "drive.csv").write_text("")
    with pytest.raises(DatasetError, match="mask: is for images, the input is tracks"):
        open_drive(tmp_path / "drive.csv", mask=mask)


@pytest.mark.parametrize(
    ("cx", "cy", "doubted"),
    [(60.0, 46.0, True), (16.0, 12.0, True), (36.0, 20.0, False), (60.0, 24.0, False)],
)
def test_a_camera_whose_middle_is_that_of_images_of_another_size_is_doubted(
    tmp_path: Path, cx: float, cy: float, doubted: bool
) -> None:
    images = write_images(tmp_path / "images")
    warnings = slam.run(images, camera=(90.0, 1.0, cx, cy, 0.0)).result.warnings
    told = f"the middle of images of {2 * cx:.0f}×{2 * cy:.0f} pixels, these have 64×48: if they were scaled"
    assert any(told in warning for warning in warnings) == doubted


def test_a_rate_that_nothing_tells_is_known_to_be_assumed(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images")
    assert open_images(images, CAMERA)[0].assumed_fps == 10
    assert open_images(images, CAMERA, fps=10.0)[0].assumed_fps is None
    (tmp_path / "times.txt").write_text("7\n7.5\n9\n")
    assert open_images(images, CAMERA)[0].assumed_fps is None


def test_times_come_from_the_user_then_the_sensors_then_the_file_then_a_tenth_of_a_second(
    tmp_path: Path,
) -> None:
    images, stamps = write_images(tmp_path / "images"), np.array([50.0, 50.2, 50.3, 50.5])
    np.testing.assert_allclose(times_of(images), [0, 0.1, 0.2])
    (tmp_path / "times.txt").write_text("7\n7.5\n9\n")
    np.testing.assert_array_equal(times_of(images), [7, 7.5, 9])
    np.testing.assert_array_equal(times_of(images, stamps=stamps), [50, 50.2, 50.3])
    np.testing.assert_array_equal(times_of(images, 2.0, stamps), [50, 50.5, 51])
    np.testing.assert_array_equal(times_of(images, 2.0), [0, 0.5, 1])


@pytest.mark.parametrize(("listed", "accepted"), [(3, False), (4, True), (5, True), (6, True), (7, False)])
def test_a_video_may_have_a_few_times_fewer_than_it_declares_frames(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, listed: int, accepted: bool
) -> None:
    video = LongerVideo(write_video(tmp_path / "clip.avi", 5), declared=6)
    monkeypatch.setattr("sfmcpp.sources.image_stream.open_frames", lambda path: video)
    (tmp_path / "times.txt").write_text("".join(f"{k}\n" for k in range(listed)))
    if not accepted:
        with pytest.raises(DatasetError, match=f"holds {listed} times for 6 images"):
            open_images(video.path, CAMERA)
    elif listed < 5:
        with pytest.raises(DatasetError, match="image 4 has no time: 4 are known; give --fps"):
            times_of(video.path)
    else:
        assert times_of(video.path) == list(range(5))


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("1\n2\n2\n", "times.txt:3: time 2 s: must be later than the one before"),
        ("1 2 3\n", "must be 1, the time of an image"),
    ],
)
def test_times_that_cannot_be_are_refused(tmp_path: Path, content: str, told: str) -> None:
    (tmp_path / "times.txt").write_text(content)
    with pytest.raises(DatasetError, match=told):
        open_images(write_images(tmp_path / "images"), CAMERA)


def test_a_drive_shorter_than_the_images_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="3 images for 2 stamps of the sensors' drive: give --fps"):
        open_images(write_images(tmp_path / "images"), CAMERA, stamps=np.array([0.0, 0.1]))


def test_true_poses_beside_the_images_get_their_times(tmp_path: Path) -> None:
    images = write_images(tmp_path / "images")
    assert open_images(images, CAMERA)[1] is None
    (tmp_path / "poses.txt").write_text("".join(f"1 0 0 {k} 0 1 0 0 0 0 1 0\n" for k in range(3)))
    _, truth = open_images(images, CAMERA)
    assert truth is not None
    np.testing.assert_allclose(truth.t_s, [0, 0.1, 0.2])
    np.testing.assert_array_equal(truth.centres[:, 0], [0, 1, 2])


def test_a_mask_that_is_black_nowhere_is_told(tmp_path: Path) -> None:
    images, mask = write_images(tmp_path / "images"), tmp_path / "mask.png"
    told = []
    for level in (3, 0):
        pixels = np.full((48, 64), 255, np.uint8)
        pixels[40:] = level
        cv2.imwrite(str(mask), pixels)
        warnings = slam.run(images, camera=CAMERA, mask=mask).result.warnings
        told.append([text for text in warnings if "mask" in text])
    (of_grey,), of_black = told
    assert of_grey.startswith("1 mask is black nowhere, so nothing is masked: black is 0")
    assert of_black == []
