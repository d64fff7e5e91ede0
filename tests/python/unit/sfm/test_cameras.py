"""Who shares a camera, what is known of it, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.model.photos import Photo
from sfmcpp.sfm.cameras import cameras_of, parse_camera_argument, shared_by

LARGE, SMALL = (3000, 2000), (1500, 1000)


def test_photos_share_a_camera_as_asked_and_never_across_sizes() -> None:
    photos = [
        Photo("a/1.jpg", size=LARGE, camera="x"),
        Photo("a/2.jpg", size=LARGE, camera="y"),
        Photo("b/3.jpg", size=LARGE, camera="x"),
        Photo("b/4.jpg", size=SMALL, camera="x"),
    ]
    assert shared_by(photos, "auto").tolist() == [0, 1, 0, 2]
    assert shared_by(photos, "folder").tolist() == [0, 0, 1, 2]
    assert shared_by(photos, "each").tolist() == [0, 1, 2, 3]
    assert shared_by(photos[:3], "one").tolist() == [0, 0, 0]
    with pytest.raises(InvalidArgument, match=r"the images have 2 sizes \(1500×1000, 3000×2000\)"):
        shared_by(photos, "one")


def test_a_focal_length_comes_from_the_user_then_from_the_files_then_from_a_usual_lens() -> None:
    told = [Photo("1", size=LARGE, focal_px=2500.0), Photo("2", size=LARGE, focal_px=2700.0)]
    silent = [Photo("1", size=LARGE)]
    assert parse_camera_argument("auto").cameras(told, sharing="one", model="auto").intrinsics[0, 0] == 2600.0
    given = parse_camera_argument("2000").cameras(told, sharing="one", model="auto")
    assert given.intrinsics[0, :4].tolist() == [2000.0, 1.0, 1500.0, 1000.0]
    assert not given.guessed[0]
    guess = parse_camera_argument("auto").cameras(silent, sharing="one", model="auto")
    assert guess.guessed[0]
    assert guess.intrinsics[0, 0] == 1.2 * 3000
    with pytest.raises(InvalidArgument, match=r"1 images tell no focal length \(1\)"):
        parse_camera_argument("exif").cameras(silent, sharing="one", model="auto")


@pytest.mark.parametrize(
    ("name", "text", "shift"),
    [
        ("K.txt", "2700 0 1510\n0 2710 990\n0 0 1\n", 0.0),
        ("calib.txt", "P0: 2700 0 1510 0 0 2710 990 0 0 0 1 0\n", 0.5),
        ("cam.yaml", "cam0:\n  camera_model: pinhole\n  intrinsics: [2700, 2710, 1510, 990]\n", 0.5),
        ("cam.yml", "%YAML:1.0\ncamera_matrix: [2700, 0, 1510, 0, 2710, 990, 0, 0, 1]\n", 0.5),
    ],
)
def test_principal_points_of_files_that_count_from_the_first_pixel_are_moved_by_half(
    tmp_path: Path, name: str, text: str, shift: float
) -> None:
    (tmp_path / name).write_text(text)
    row = parse_camera_argument(tmp_path / name).calibration
    assert row is not None
    assert row[:4] == pytest.approx([2700, 2710 / 2700, 1510 + shift, 990 + shift])


def test_a_calibration_of_another_image_size_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "camchain.yaml"
    file.write_text(
        "cam0:\n  camera_model: pinhole\n  intrinsics: [2700, 2710, 1510, 990]\n  resolution: [3000, 2000]\n"
    )
    camera = parse_camera_argument(file)
    photo = Photo("1.jpg", Path("1.jpg"), size=LARGE)
    assert camera.cameras([photo], sharing="auto", model="auto").fixed.all()
    other = Photo("2.jpg", Path("2.jpg"), size=(2400, 1600))
    with pytest.raises(
        DatasetError,
        match=r"camchain.yaml: .* is for images of 3000×2000 px, 2.jpg has 2400×1600: scale",
    ):
        camera.cameras([photo, other], sharing="auto", model="auto")
    # What is known by tracks alone is as large as these reach.
    camera.cameras([Photo("3", size=(2400, 1990))], sharing="auto", model="auto")
    with pytest.raises(DatasetError, match="3 has 3100×1990"):
        camera.cameras([Photo("3", size=(3100, 1990))], sharing="auto", model="auto")


def test_a_calibration_stays_as_it_is(tmp_path: Path) -> None:
    file = tmp_path / "K.txt"
    file.write_text("2700 0 1510\n0 2710 990\n0 0 1\n")
    cameras = parse_camera_argument(file).cameras([Photo("1", size=LARGE)], sharing="auto", model="auto")
    assert cameras.fixed.all()
    assert cameras.intrinsics[0, :4] == pytest.approx([2700, 2710 / 2700, 1510, 990])
    with pytest.raises(DatasetError, match=r"K.txt: cx = 1510 .* calibration of images of another size"):
        parse_camera_argument(file).cameras([Photo("1", size=SMALL)], sharing="auto", model="auto")
    file.write_text("2700 0 1510\n0 1e300 990\n0 0 1\n")
    with pytest.raises(DatasetError, match=r"K.txt: focal length 1e\+300 px: must be from .* px for images"):
        parse_camera_argument(file).cameras([Photo("1", size=LARGE)], sharing="auto", model="auto")
    with pytest.raises(DatasetError, match="there is no such file"):
        parse_camera_argument(str(tmp_path / "L.txt"))


def test_the_model_says_which_intrinsics_are_estimated() -> None:
    photos = [Photo("1", size=LARGE)]
    for model, names in {
        "simple-pinhole": {"f"},
        "pinhole": {"f", "aspect"},
        "auto": {"f", "k1"},
        "opencv": {"f", "aspect", "k1", "k2", "p1", "p2"},
    }.items():
        free = ~cameras_of(photos, model=model).fixed[0]
        assert {name for name, is_free in zip(PERSPECTIVE, free, strict=True) if is_free} == names


@pytest.mark.parametrize("wish", ["0", "-5", "nan", "1e9", "10", "some words"])
def test_no_focal_length_is_refused(wish: str) -> None:
    with pytest.raises(InvalidArgument, match="camera"):
        parse_camera_argument(wish).cameras([Photo("1", size=LARGE)], sharing="auto", model="auto")


def test_intrinsics_as_an_array() -> None:
    matrix = np.array([[1000.0, 0.5, 320], [0, 1010, 240], [0, 0, 1]])
    row = parse_camera_argument(matrix).calibration
    assert row is not None
    assert row[:5] == pytest.approx([1000, 1.01, 320, 240, 0.5])
    assert not row[5:].any()


@pytest.mark.parametrize("matrix", [np.zeros((3, 3)), 2 * np.diag([500.0, 500, 1]), np.eye(3)[[0, 2, 1]]])
def test_a_matrix_that_is_no_calibration_is_refused(matrix: np.ndarray) -> None:
    with pytest.raises(InvalidArgument, match="camera: "):
        parse_camera_argument(matrix)


def test_a_transposed_matrix_is_refused() -> None:
    matrix = np.array([[1000.0, 0, 320], [0, 1010, 240], [0, 0, 1]])
    with pytest.raises(InvalidArgument, match="camera: "):
        parse_camera_argument(matrix.T)


@pytest.mark.parametrize("row", [[-500.0, 1, 320, 240, 0], [500.0, -1, 320, 240, 0], [500.0, 0, 320, 240, 0]])
def test_what_must_be_positive_is_named(row: list[float]) -> None:
    with pytest.raises(InvalidArgument, match=r"camera = \[.*\]: f and aspect must be positive"):
        parse_camera_argument(row)


def test_a_focal_length_that_stays_must_be_told() -> None:
    told, silent = [Photo("1", size=LARGE, focal_px=2500.0)], [Photo("1", size=LARGE)]
    for wish, photos, focal in (("2000", silent, 2000.0), ("auto", told, 2500.0)):
        cameras = parse_camera_argument(wish).cameras(photos, sharing="one", model="fixed")
        assert cameras.fixed.all()
        assert cameras.intrinsics[0, :4].tolist() == [focal, 1.0, 1500.0, 1000.0]
    with pytest.raises(InvalidArgument, match="camera_model = 'fixed': wants a focal length"):
        parse_camera_argument("auto").cameras(silent, sharing="one", model="fixed")
