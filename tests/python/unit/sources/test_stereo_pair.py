"""A right camera is found by the name of its folder; where it is tell files of KITTI, EuRoC and Kalibr."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.sources.stereo_pair import StereoArgument, StereoPair, right_images, stereo_pair

F, CX, CY = 700.0, 600.0, 180.0
INTRINSICS = np.array([F, 1.0, CX, CY, 0.0])
RIGHT = np.array([710.0, 1.0, 610.0, 170.0, 0.0])
# Where the right camera is in the axes of the left one.
POSE = np.column_stack(
    [so3.rotation_from_angle_axis(np.radians([[0.5, -1.0, 0.8]]))[0], [0.11, 0.001, -0.002]]
)


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("mav0/cam0/data", "mav0/cam1/data"),
        ("00/image_0", "00/image_1"),
        ("sync/image_02/data", "sync/image_03/data"),
        ("image_l", "image_r"),
        ("drive_left", "drive_right"),
        ("left/images", "right/images"),
    ],
)
def test_right_images_are_beside_by_the_usual_names(tmp_path: Path, left: str, right: str) -> None:
    for folder in (left, right):
        (tmp_path / folder).mkdir(parents=True)
    assert right_images(tmp_path / left, StereoArgument()) == tmp_path / right


def test_a_link_counts_by_its_own_name_and_a_video_by_its_stem(tmp_path: Path) -> None:
    (tmp_path / "some").mkdir()
    for name in ("image_l", "image_r"):
        (tmp_path / name).symlink_to(tmp_path / "some")
    assert right_images(tmp_path / "image_l", StereoArgument()).name == "image_r"
    for name in ("left.mp4", "right.mp4"):
        (tmp_path / name).touch()
    assert right_images(tmp_path / "left.mp4", StereoArgument()) == tmp_path / "right.mp4"


@pytest.mark.parametrize(("name", "looked"), [("run0", ""), ("image_0", r"looked for .*image_1.*; ")])
def test_where_there_are_none_it_is_said_what_was_looked_for(tmp_path: Path, name: str, looked: str) -> None:
    (tmp_path / name).mkdir()
    (tmp_path / "run1").mkdir()
    with pytest.raises(DatasetError, match=rf"{name}: no images of a right camera.*{looked[:-2]}.*--right"):
        right_images(tmp_path / name, StereoArgument())


def found_pair(
    place: Path, camera: Path | None, names: Sequence[str] = ("image_0", "image_1"), **told: float
) -> StereoPair:
    for name in names:
        (place / name).mkdir(parents=True, exist_ok=True)
    left, right = (place / name for name in names)
    return stereo_pair(left, right, INTRINSICS, camera, told.get("baseline_m"))


def kitti(place: Path, matrices: dict[str, tuple[float, float]]) -> Path:
    """``calib.txt`` with cameras at these x and z."""
    rows = [
        f"{name}{F} 0 {CX} {-F * x - CX * z} 0 {F} {CY} {-CY * z} 0 0 1 {-z}\n"
        for name, (x, z) in matrices.items()
    ]
    (place / "calib.txt").write_text("".join(rows))
    return place / "calib.txt"


FOUR = {"P0: ": (0.0, 0.0), "P1: ": (0.54, 0.0), "P2: ": (-0.06, 0.003), "P3: ": (0.47, -0.001)}


@pytest.mark.parametrize(
    ("matrices", "names", "centre"),
    [
        (FOUR, ("image_0", "image_1"), (0.54, 0.0, 0.0)),
        (FOUR, ("image_02/data", "image_03/data"), (0.53, 0.0, -0.004)),
        (FOUR, ("image_3", "image_2"), (-0.53, 0.0, 0.004)),
        ({"P0: ": (0.0, 0.0), "P1: ": (0.54, 0.0)}, ("image_l", "image_r"), (0.54, 0.0, 0.0)),
    ],
)
def test_kittis_matrices_tell_the_baseline(
    tmp_path: Path,
    matrices: dict[str, tuple[float, float]],
    names: tuple[str, str],
    centre: tuple[float, ...],
) -> None:
    pair = found_pair(tmp_path, kitti(tmp_path, matrices), names)
    np.testing.assert_allclose(pair.centre_m, centre, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(pair.pose[:, :3], np.eye(3))
    np.testing.assert_array_equal(pair.right, INTRINSICS)


def test_of_four_matrices_names_without_numbers_choose_none(tmp_path: Path) -> None:
    file = kitti(tmp_path, FOUR)
    with pytest.raises(DatasetError, match=r"holds 4 cameras: the names image_l and image_r do not tell"):
        found_pair(tmp_path, file, ("image_l", "image_r"))


def test_numbers_of_a_camera_leave_the_baseline_to_the_matrices_beside(tmp_path: Path) -> None:
    kitti(tmp_path, {name: (2 * x, z) for name, (x, z) in FOUR.items()})
    # Of images of half the size: the matrices tell metres by their own focal length.
    for name in ("image_0", "image_1"):
        (tmp_path / name).mkdir()
    half = INTRINSICS * [0.5, 1, 0.5, 0.5, 1]
    pair = stereo_pair(tmp_path / "image_0", tmp_path / "image_1", half, None, None)
    np.testing.assert_allclose(pair.centre_m, [1.08, 0, 0], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(pair.right, half)


def document(pose_name: str, pose: np.ndarray, intrinsics: np.ndarray) -> str:
    square = np.vstack([pose, [0, 0, 0, 1]]).ravel().tolist()
    f, _, cx, cy, _ = intrinsics.tolist()
    return f"{pose_name}: {square}\ncamera_model: pinhole\nintrinsics: [{f}, {f}, {cx}, {cy}]\n"


def joined(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.column_stack([one[:, :3] @ other[:, :3], one[:, :3] @ other[:, 3] + one[:, 3]])


def inverse(pose: np.ndarray) -> np.ndarray:
    return np.column_stack([pose[:, :3].T, -pose[:, :3].T @ pose[:, 3]])


def test_files_of_euroc_tell_the_pose_by_that_on_the_body(tmp_path: Path) -> None:
    body = np.column_stack([so3.rotation_from_angle_axis(np.array([[0.3, 1.2, -0.4]]))[0], [0.1, 0.2, 0.3]])
    for name, pose, camera in (("cam0", body, INTRINSICS), ("cam1", joined(body, POSE), RIGHT)):
        (tmp_path / name / "data").mkdir(parents=True)
        (tmp_path / name / "sensor.yaml").write_text(document("T_BS", pose, camera))
    pair = found_pair(tmp_path, tmp_path / "cam0/sensor.yaml", ("cam0/data", "cam1/data"))
    np.testing.assert_allclose(pair.pose, POSE, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(pair.right, RIGHT)


@pytest.mark.parametrize(("camera", "turned"), [("cam0", False), ("cam1", True)])
def test_a_chain_of_kalibr_tells_the_pose_of_either_camera(tmp_path: Path, camera: str, turned: bool) -> None:
    first = document("T_cam_imu", np.eye(3, 4), INTRINSICS)
    second = document("T_cn_cnm1", inverse(POSE), RIGHT)
    indented = ("".join(f"  {line}\n" for line in text.splitlines()) for text in (first, second))
    (tmp_path / "camchain.yaml").write_text("cam0:\n{}cam1:\n{}".format(*indented))
    pair = found_pair(tmp_path, tmp_path / f"camchain.yaml:{camera}")
    np.testing.assert_allclose(pair.pose, inverse(POSE) if turned else POSE, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(pair.right, INTRINSICS if turned else RIGHT)


STEPS = [inverse(POSE), inverse(joined(POSE, POSE))]


def chain_of_three(place: Path) -> Path:
    """Of three cameras, the third farther beside the second than this beside the first."""
    lenses = (INTRINSICS, RIGHT, INTRINSICS)
    parts = [document("T_cn_cnm1", step, lens) for step, lens in zip([POSE, *STEPS], lenses, strict=True)]
    indented = ["".join(f"  {line}\n" for line in text.splitlines()) for text in parts]
    (place / "chain.yaml").write_text("".join(f"cam{k}:\n{text}" for k, text in enumerate(indented)))
    return place


@pytest.mark.parametrize(("left", "right"), [(0, 1), (0, 2), (1, 2), (2, 0), (2, 1)])
def test_of_a_longer_chain_the_folder_tells_the_right_camera(tmp_path: Path, left: int, right: int) -> None:
    names = [f"cam{k}/data" for k in (left, right)]
    pair = found_pair(tmp_path, chain_of_three(tmp_path) / f"chain.yaml:cam{left}", names)
    # Poses of the cameras in the first one.
    places = [np.eye(3, 4), POSE, joined(POSE, joined(POSE, POSE))]
    expected = joined(inverse(places[left]), places[right])
    np.testing.assert_allclose(pair.pose, expected, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(pair.right, RIGHT if right == 1 else INTRINSICS)


def test_of_a_longer_chain_a_folder_without_a_number_chooses_none(tmp_path: Path) -> None:
    rule = r"chain\.yaml:1: holds 3 cameras: the name right does not tell which of cam1, cam2 took"
    with pytest.raises(DatasetError, match=rule):
        found_pair(tmp_path, chain_of_three(tmp_path) / "chain.yaml:cam0", ["left", "right"])


def test_a_baseline_counts_before_files_and_with_the_lens_of_the_right_folder(tmp_path: Path) -> None:
    file = kitti(tmp_path, FOUR)
    pair = found_pair(tmp_path, file, baseline_m=0.3)
    np.testing.assert_array_equal(pair.pose, np.column_stack([np.eye(3), [0.3, 0, 0]]))
    np.testing.assert_array_equal(pair.right, INTRINSICS)
    (tmp_path / "image_1" / "K.txt").write_text("710 0 610 0 710 170 0 0 1")
    np.testing.assert_array_equal(found_pair(tmp_path, file, baseline_m=0.3).right, RIGHT)
    with pytest.raises(InvalidArgument, match=r"baseline_m = -0.3"):
        found_pair(tmp_path, file, baseline_m=-0.3)


@pytest.mark.parametrize("known", [True, False])
def test_where_nothing_tells_the_baseline_it_is_said_what_would(tmp_path: Path, known: bool) -> None:
    (tmp_path / "K.txt").write_text("700 0 600 0 700 180 0 0 1")
    rule = "looked in .*K.txt for P0 and P1" if known else "looked for P0 and P1"
    with pytest.raises(DatasetError, match=rf"image_1: where its camera is .* not known: {rule}.*--baseline"):
        found_pair(tmp_path, tmp_path / "K.txt" if known else None)


def test_points_and_pixels_agree(tmp_path: Path) -> None:
    lens = np.array([700.0, 1.0, 600.0, 180.0, 0.0, -0.2, 0.05, 0.0, 0.0, 0.0, 0.001, -0.001])
    pair = StereoPair(INTRINSICS, lens, POSE)
    rays = np.random.default_rng(0).uniform(-0.3, 0.3, (20, 2))
    inverse_depth = np.linspace(0.0, 0.5, 20)
    turned = pair.turned_rays(pair.in_right(rays, inverse_depth))
    np.testing.assert_allclose(pair.inverse_depths(rays, turned), inverse_depth, rtol=0, atol=1e-6)
