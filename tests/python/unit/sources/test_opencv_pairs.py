"""Stereo pairs as OpenCV and ROS write them: every file of one pair tells the same two cameras."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed: pip install 'sfmcpp[vision]'")
pytest.importorskip("yaml", reason="PyYAML is not installed: pip install 'sfmcpp[vision]'")

from sfmcpp.errors import DatasetError  # noqa: E402
from sfmcpp.geometry.pinhole import pinhole_rows  # noqa: E402
from sfmcpp.sources.cameras import read_camera, read_intrinsics  # noqa: E402
from sfmcpp.sources.stereo_pair import StereoPair, stereo_pair  # noqa: E402
from stereo_images import LENSES, SIZE, TURNED  # noqa: E402

MATRICES = [np.array([[f, 0, cx], [0, f * aspect, cy], [0, 0, 1]]) for f, aspect, cx, cy, *_ in LENSES]
LENS_NUMBERS = [lens[[5, 6, 10, 11, 7]] for lens in LENSES]
# OpenCV's convention: x of the right camera is R x of the left one + T.
R, T = TURNED[:, :3].T, -TURNED[:, :3].T @ TURNED[:, 3:]
R1, R2, P1, P2, Q, *_ = cv2.stereoRectify(
    MATRICES[0], LENS_NUMBERS[0], MATRICES[1], LENS_NUMBERS[1], SIZE, R, T, alpha=0
)
RECTIFIED_LENS = np.array([P1[0, 0], 1.0, P1[0, 2], P1[1, 2], 0.0])
RECTIFIED_POSE = np.column_stack([np.eye(3), [-P2[0, 3] / P2[0, 0], 0, 0]])
RECTIFICATION = {"R1": R1, "R2": R2, "P1": P1, "P2": P2, "Q": Q}


def stored(file: Path, **matrices: np.ndarray) -> Path:
    """A file as OpenCV writes it."""
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_WRITE)
    for name, matrix in matrices.items():
        storage.write(name, np.asarray(matrix))
    storage.release()
    return file


def lenses(matrix: tuple[str, str], distortion: tuple[str, str]) -> dict[str, np.ndarray]:
    """Both cameras under these names."""
    pairs = zip((*matrix, *distortion), (*MATRICES, *LENS_NUMBERS), strict=True)
    return dict(pairs)


def ros(file: Path, side: int, projection: np.ndarray) -> Path:
    """A file as ROS's calibration writes one for each camera."""
    matrices = {
        "camera_matrix": MATRICES[side],
        "distortion_coefficients": LENS_NUMBERS[side],
        "rectification_matrix": (R1, R2)[side],
        "projection_matrix": projection,
    }
    rows = [f"{name}: {{rows: 1, data: {np.ravel(m).tolist()}}}" for name, m in matrices.items()]
    head = f"image_width: {SIZE[0]}\nimage_height: {SIZE[1]}\ndistortion_model: plumb_bob\n"
    file.write_text(head + "\n".join(rows))
    return file


def pair_of(place: Path, camera: str) -> StereoPair:
    """The pair of images in folders that say nothing, by the camera of a file there."""
    for name in ("a", "b"):
        (place / name).mkdir(exist_ok=True)
    file = place / camera
    return stereo_pair(place / "a", place / "b", read_intrinsics(file), file, None)


def require_same(pair: StereoPair, left: np.ndarray, right: np.ndarray, pose: np.ndarray) -> None:
    for one, other in ((pair.left, left), (pair.right, right)):
        np.testing.assert_allclose(pinhole_rows(one), other, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(pair.pose, pose, rtol=0, atol=1e-9)


@pytest.mark.parametrize("suffix", ["yml", "json", "xml"])
@pytest.mark.parametrize(
    ("matrix", "distortion"),
    [
        (("M1", "M2"), ("D1", "D2")),
        (("cameraMatrix1", "cameraMatrix2"), ("distCoeffs1", "distCoeffs2")),
        (("camera_matrix_left", "camera_matrix_right"), ("dist_coeffs_left", "dist_coeffs_right")),
        (("K_l", "K_r"), ("D_l", "D_r")),
        (("Left_Camera_Matrix", "Right_Camera_Matrix"), ("Left_Distortion", "Right_Distortion")),
        (("K0", "K1"), ("D0", "D1")),
        (("mtxL", "mtxR"), ("distL", "distR")),
    ],
)
def test_r_and_t_of_a_stereo_calibration_tell_the_pose(
    tmp_path: Path, matrix: tuple[str, str], distortion: tuple[str, str], suffix: str
) -> None:
    stored(tmp_path / f"s.{suffix}", **lenses(matrix, distortion), R=R, T=T, E=np.eye(3), F=np.eye(3))
    require_same(pair_of(tmp_path, f"s.{suffix}:{matrix[0]}"), *LENSES, TURNED)


def test_opencvs_sample_has_the_pose_in_a_second_file(tmp_path: Path) -> None:
    stored(tmp_path / "intrinsics.yml", **lenses(("M1", "M2"), ("D1", "D2")))
    with pytest.raises(
        DatasetError, match=r"not known: looked in .*intrinsics.yml:M1 for .*R and T of OpenCV"
    ):
        pair_of(tmp_path, "intrinsics.yml:M1")
    stored(tmp_path / "extrinsics.yml", R=R, T=T, **RECTIFICATION)
    require_same(pair_of(tmp_path, "intrinsics.yml:M1"), *LENSES, TURNED)


def test_the_second_camera_may_be_the_left_one(tmp_path: Path) -> None:
    stored(tmp_path / "s.yml", **lenses(("M1", "M2"), ("D1", "D2")), R=R, T=T)
    require_same(pair_of(tmp_path, "s.yml:M2"), *LENSES[::-1], np.column_stack([R, T]))


def test_rectified_images_have_the_camera_of_p1(tmp_path: Path) -> None:
    stored(tmp_path / "s.yml", **lenses(("M1", "M2"), ("D1", "D2")), R=R, T=T, **RECTIFICATION)
    require_same(pair_of(tmp_path, "s.yml:P1"), RECTIFIED_LENS, RECTIFIED_LENS, RECTIFIED_POSE)


def test_without_r_and_t_the_rectification_tells_the_pose(tmp_path: Path) -> None:
    names = {"LEFT_R": R1, "LEFT_P": P1, "RIGHT_R": R2, "RIGHT_P": P2}
    file = stored(tmp_path / "orb.yaml", **lenses(("LEFT_K", "RIGHT_K"), ("LEFT_D", "RIGHT_D")), **names)
    file.write_text(file.read_text().replace("T_", "T."))
    require_same(pair_of(tmp_path, "orb.yaml:LEFT.K"), *LENSES, TURNED)


@pytest.mark.parametrize("folders", ["{}.yaml", "{}/camera_info.yaml", "camera_{}.yaml"])
def test_two_files_of_ros_tell_the_pose(tmp_path: Path, folders: str) -> None:
    for side, (name, projection) in enumerate((("left", P1), ("right", P2))):
        file = tmp_path / folders.format(name)
        file.parent.mkdir(exist_ok=True)
        ros(file, side, projection)
    left = folders.format("left")
    require_same(pair_of(tmp_path, left), *LENSES, TURNED)
    assert read_camera(tmp_path / left).size == SIZE
    rectified = pair_of(tmp_path, f"{left}:projection_matrix")
    require_same(rectified, RECTIFIED_LENS, RECTIFIED_LENS, RECTIFIED_POSE)


def test_cameras_that_were_calibrated_alone_tell_none(tmp_path: Path) -> None:
    ros(tmp_path / "left.yaml", 0, P1)
    ros(tmp_path / "right.yaml", 1, P1)
    with pytest.raises(
        DatasetError, match=r"where its camera is .* projection_matrix of ROS's files of both"
    ):
        pair_of(tmp_path, "left.yaml")


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"R": 2 * R}, "it holds no rotation"),
        ({"T": np.zeros((2, 1))}, "holds 2 numbers: must be 3, a matrix of 3×1"),
        ({"M2": -MATRICES[1]}, "the calibration matrix is"),
    ],
)
def test_what_is_no_pair_is_refused(tmp_path: Path, changed: dict[str, np.ndarray], told: str) -> None:
    matrices = {**lenses(("M1", "M2"), ("D1", "D2")), "R": R, "T": T} | changed
    stored(tmp_path / "s.yml", **matrices)
    text = (tmp_path / "s.yml").read_text().splitlines()
    name = next(iter(changed))
    line = next(k for k, row in enumerate(text, 1) if row.startswith(f"{name}:"))
    with pytest.raises(DatasetError) as caught:
        pair_of(tmp_path, "s.yml:M1")
    assert f"s.yml:{line}: {told}" in str(caught.value)


def test_several_cameras_must_be_chosen_from(tmp_path: Path) -> None:
    file = stored(tmp_path / "s.yml", **lenses(("M1", "M2"), ("D1", "D2")), **RECTIFICATION)
    with pytest.raises(DatasetError, match=r"holds M1, M2, P1, P2: say which, as in s\.yml:M1"):
        read_intrinsics(file)
    with pytest.raises(DatasetError, match=r"holds no camera 'M3': it holds M1, M2, P1, P2"):
        read_intrinsics(tmp_path / "s.yml:M3")
