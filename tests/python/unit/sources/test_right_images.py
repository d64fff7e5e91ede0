"""Corners are found again in right images, rectified or not; what is no pair is left out, and said."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")

from sfmcpp import CheckpointFolder, slam  # noqa: E402
from sfmcpp.errors import DatasetError  # noqa: E402
from sfmcpp.geometry import so3  # noqa: E402
from sfmcpp.geometry.pinhole import homogeneous, to_normalised, to_pixels  # noqa: E402
from sfmcpp.model.frames import Frame  # noqa: E402
from sfmcpp.sources.drives import open_drive  # noqa: E402
from sfmcpp.sources.right_images import RightImages, partners  # noqa: E402
from sfmcpp.sources.stereo_pair import StereoPair  # noqa: E402
from sfmcpp.sources.vision import KltSettings, follow_features, open_frames  # noqa: E402
from stereo_images import (  # noqa: E402
    BASELINE_M,
    BESIDE,
    LENSES,
    RECTIFIED,
    TURNED,
    beside,
    calib,
    depths,
    way,
    write_pictures,
    write_rectified,
)

COUNT = 8
CAMERA = (RECTIFIED[0], RECTIFIED[2], RECTIFIED[3])
START_NS, STEP_NS = 1403636579763555584, 50_000_000


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Rectified pairs: ``image_0``, ``image_1``, ``calib.txt``."""
    place = tmp_path_factory.mktemp("street")
    write_rectified(place, COUNT)
    return place


def frames_of(street: Path, **told: Any) -> tuple[list[Frame], list[str]]:
    """The frames of its left images, and doubts of the right ones."""
    frames = open_drive(street / "image_0", **(told or {"stereo": True})).frames
    return list(frames), list(frames.right_doubts)


def altered(street: Path, folder: Path, change: Callable[[int, Path], bytes | None]) -> Path:
    """Its right images as `change` makes them of their numbers and files; None: there is none."""
    folder.mkdir()
    for number, file in enumerate(sorted((street / "image_1").iterdir())):
        content = change(number, file)
        if content is not None:
            (folder / file.name).write_bytes(content)
    return folder


@pytest.mark.parametrize(
    ("lenses", "pose"), [((RECTIFIED, RECTIFIED), BESIDE), (LENSES, TURNED)], ids=["rectified", "turned"]
)
def test_corners_are_where_a_right_camera_with_the_axes_of_the_left_one_would_see_them(
    tmp_path: Path, lenses: tuple[np.ndarray, np.ndarray], pose: np.ndarray
) -> None:
    poses = way(2)
    left = open_frames(write_pictures(tmp_path / "left", poses, lenses[0]))
    right = open_frames(write_pictures(tmp_path / "right", beside(poses, pose), lenses[1]))
    settings = KltSettings(window_px=11)  # small beside what the walls are slanted
    found = RightImages(right, left, StereoPair(*lenses, pose), settings)
    for number, view in enumerate(follow_features(left, settings)):
        both = found.beside(number, list(left)[number], view)
        assert both.right is not None
        np.testing.assert_array_equal(both.right.centre_m, pose[:, 3])
        rays = to_normalised(view.pixels, lenses[0])
        depth, _ = depths(poses[number], rays)
        points = homogeneous(rays) * depth[:, None] - pose[:, 3]
        expected = to_pixels(points[:, :2] / points[:, 2:], lenses[0])
        errors = both.right.pixels - expected
        assert np.isfinite(errors).mean() > 0.5
        np.testing.assert_allclose(np.nanmedian(errors, axis=0), 0.0, rtol=0, atol=0.05)
        assert np.nanmedian(np.linalg.norm(errors, axis=1)) < 0.4
    assert found.doubts == []


def test_right_images_beside_give_metres_and_leave_the_left_ones_as_they_are(street: Path) -> None:
    run = slam.run(street / "image_0", stereo=True)
    assert run.result.metric
    assert run.result.warnings == []
    steps = np.linalg.norm(np.diff(run.trajectory().centres, axis=0), axis=1)
    true = np.linalg.norm(np.diff(way(COUNT)[:, :, 3], axis=0), axis=1)
    assert steps.sum() == pytest.approx(true.sum(), rel=0.02)
    alone, _ = frames_of(street, stereo=False)
    for one, other in zip(alone, frames_of(street)[0], strict=True):
        assert one.view.right is None
        np.testing.assert_array_equal(one.view.pixels, other.view.pixels)


def test_a_run_goes_on_from_a_checkpoint_to_the_same_bits(street: Path, tmp_path: Path) -> None:
    whole = slam.run(street / "image_0", stereo=True)
    kept, told = CheckpointFolder(tmp_path), {"callback": lambda frame, _: frame < 4}
    slam.run(street / "image_0", stereo=True, checkpoint=kept, **told)
    again = slam.run(street / "image_0", stereo=True, resume=kept)
    np.testing.assert_array_equal(again.trajectory().poses, whole.trajectory().poses)
    with pytest.raises(DatasetError):
        slam.run(street / "image_0", baseline_m=2 * BASELINE_M, resume=kept)


def test_a_frame_without_its_right_image_is_seen_by_the_left_camera_alone(
    street: Path, tmp_path: Path
) -> None:
    content: dict[int, bytes | None] = {3: None, 5: b"no picture"}
    right = altered(street, tmp_path / "right", lambda k, file: content.get(k, file.read_bytes()))
    frames, doubts = frames_of(street, right=right, baseline_m=BASELINE_M)
    assert [frame.number for frame in frames if frame.view.right is None] == [3, 5]
    assert doubts[0] == "2 frames are without a right image, the first 000003.png"
    assert doubts[1].startswith("right images cannot be read: 000005.png: is no image that can be decoded")


def test_where_most_images_are_no_pair_all_are_left_out_and_it_is_said(street: Path, tmp_path: Path) -> None:
    lower = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 4.0]])

    def moved(number: int, file: Path) -> bytes:
        if number == COUNT - 1:
            return file.read_bytes()
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        size = image.shape[::-1]
        return cv2.imencode(".png", cv2.warpAffine(image, lower, size, borderMode=cv2.BORDER_REFLECT))[
            1
        ].tobytes()

    right = altered(street, tmp_path / "right", moved)
    frames, doubts = frames_of(street, right=right, baseline_m=BASELINE_M)
    assert all(frame.view.right is None for frame in frames)
    assert len(doubts) == 1
    assert "in 7 of 8 pairs of images most of what both show is off its epipolar line, by 4 px" in doubts[0]
    assert doubts[0].endswith("right images are left out")


def test_cameras_that_nearly_fit_the_images_are_doubted(street: Path) -> None:
    left, right = (open_frames(street / name) for name in ("image_0", "image_1"))
    tilt = np.radians(0.3)
    turned = np.column_stack([so3.rotation_from_angle_axis(np.array([[tilt, 0, 0]]))[0], BESIDE[:, 3]])
    found = RightImages(right, left, StereoPair(RECTIFIED, RECTIFIED, turned), KltSettings())
    for number, view in enumerate(follow_features(left, KltSettings())):
        assert found.beside(number, list(left)[number], view).right is not None
    (doubt,) = found.doubts
    told = re.search(r"both images of a pair show is off its epipolar line by (\S+) px in the middle", doubt)
    assert told is not None
    assert float(told[1]) == pytest.approx(RECTIFIED[0] * tilt, rel=0.1)


def test_a_baseline_in_millimetres_is_doubted(street: Path) -> None:
    _, doubts = frames_of(street, stereo=True, baseline_m=1000 * BASELINE_M)
    told = "the right camera is 400 m beside the left one by its calibration: if those are millimetres"
    assert [told in doubt for doubt in doubts] == [True]


def test_images_of_something_else_are_named(street: Path, tmp_path: Path) -> None:
    black = cv2.imencode(".png", np.zeros((192, 256), np.uint8))[1].tobytes()
    right = altered(street, tmp_path / "right", lambda *_: black)
    assert (
        "right images show only 0.0% of the corners" in frames_of(street, right=right, baseline_m=1.0)[1][0]
    )


def test_swapped_cameras_are_refused_once_it_is_clear(street: Path) -> None:
    swapped = open_drive(street / "image_1", right=street / "image_0", camera=CAMERA, baseline_m=BASELINE_M)
    with pytest.raises(DatasetError, match=r"image_0: shows what .*image_1 shows shifted to the wrong side"):
        list(swapped.frames)


def test_cameras_told_the_other_way_round_need_not_be_swapped(street: Path) -> None:
    turned_round = open_drive(street / "image_1", right=street / "image_0")
    frames = list(turned_round.frames)
    assert frames[0].view.right is not None
    np.testing.assert_allclose(frames[0].view.right.centre_m, [-BASELINE_M, 0.0, 0.0], rtol=0, atol=1e-12)


def test_left_images_are_no_right_ones(street: Path) -> None:
    rule = "image_0: shows the images of .*image_0: must be another camera"
    with pytest.raises(DatasetError, match=rule):
        frames_of(street, right=street / "image_0", baseline_m=BASELINE_M)


def test_right_images_that_shift_nothing_give_no_scale_and_it_is_said(street: Path, tmp_path: Path) -> None:
    def brighter(number: int, file: Path) -> bytes:
        image = cv2.imread(str(street / "image_0" / file.name), cv2.IMREAD_GRAYSCALE)
        return cv2.imencode(".png", np.clip(image + 1.0, 0, 255).astype(np.uint8))[1].tobytes()

    right = altered(street, tmp_path / "right", brighter)
    run = slam.run(street / "image_0", right=right, baseline_m=BASELINE_M)
    assert not run.result.metric
    assert any(told.startswith("right images give no metric scale") for told in run.result.warnings)


def test_right_images_of_another_size_are_refused(street: Path, tmp_path: Path) -> None:
    small = cv2.imencode(".png", np.zeros((180, 240), np.uint8))[1].tobytes()
    right = altered(street, tmp_path / "right", lambda *_: small)
    with pytest.raises(
        DatasetError, match="240×180 pixels, those of the left camera 256×192: must be the same"
    ):
        open_drive(street / "image_0", right=right, baseline_m=BASELINE_M)


def empty_files(folder: Path, names: list[str]) -> Path:
    folder.mkdir()
    for name in names:
        (folder / name).touch()
    return folder


def stamped(*stamps_ns: int) -> list[str]:
    return [f"{START_NS + stamp}.png" for stamp in stamps_ns]


@pytest.mark.parametrize(
    ("left", "right", "expected"),
    [
        (["1.png", "2.png", "3.png"], ["1.jpg", "3.jpg"], {0: 0, 2: 1}),
        (["left_08.png", "left_09.png"], ["right_09.png", "right_10.png"], {1: 0}),
        (stamped(0, STEP_NS, 2 * STEP_NS), stamped(400_000, STEP_NS + 3_000_000), {0: 0}),
        (["a.png", "b.png"], ["c.png", "d.png"], None),
        (["1_10.png", "2_10.png"], ["a_10.png", "b_10.png"], None),
    ],
)
def test_images_of_a_pair_have_one_name_time_or_number(
    tmp_path: Path, left: list[str], right: list[str], expected: dict[int, int] | None
) -> None:
    folders = [
        open_frames(empty_files(tmp_path / name, names)) for name, names in (("l", left), ("r", right))
    ]
    if expected is None:
        with pytest.raises(DatasetError, match=r"r: none of its images, as .*, belongs to one of .*l, as"):
            partners(*folders)
    else:
        assert partners(*folders) == expected


def test_one_camera_file_with_two_matrices_names_no_numbers(street: Path, tmp_path: Path) -> None:
    (tmp_path / "image_l").symlink_to(street / "image_0")
    (tmp_path / "image_r").symlink_to(street / "image_1")
    (tmp_path / "calib.txt").write_text(calib(("", "")))
    told = {"stereo": True, "camera": tmp_path / "calib.txt"}
    frames = list(open_drive(tmp_path / "image_l", **told).frames)
    assert frames[0].view.right is not None
    np.testing.assert_allclose(frames[0].view.right.centre_m, [BASELINE_M, 0, 0], rtol=0, atol=1e-12)
