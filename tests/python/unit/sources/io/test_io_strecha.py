"""Strecha's cameras: what a file says, what is refused, and real photos whose matches agree with them."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from sfmcpp import DatasetError
from sfmcpp.sources.io import convert, formats, read, write

CALIBRATION = "2759.48 1.5 1520.69 \n0 2764.16 1006.81 \n0 0 1 \n"
# A quarter turn about y, as the rows of world_from_camera, and a centre.
POSE = "0 0 1\n0 1 0\n-1 0 0\n5 -7 0.25\n"
TEXT = CALIBRATION + "0.01 -0.002 0.0003\n" + POSE + "3072 2048\n"


def write_camera(folder: Path, name: str, text: str = TEXT) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}.camera"
    path.write_text(text)
    return path


def test_every_number_of_a_file_has_its_place(tmp_path: Path) -> None:
    write_camera(tmp_path / "truth", "0000.jpg")
    problem = read(tmp_path / "truth")
    values = dict(zip(problem.intrinsic_names, problem.intrinsics[0], strict=True))
    assert values["f"] == 2759.48
    assert values["f"] * values["aspect"] == pytest.approx(2764.16, rel=1e-15)
    assert [values[n] for n in ("skew", "cx", "cy")] == [1.5, 1520.69, 1006.81]
    assert [values[n] for n in ("k1", "k2", "k3", "k4", "p1")] == [0.01, -0.002, 0.0003, 0, 0]
    assert problem.metadata.image_names == ["0000.jpg"]
    assert np.array_equal(problem.metadata.image_sizes, [[3072, 2048]])
    np.testing.assert_allclose(problem.rotations[0] @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_array_equal(problem.centres, [[5, -7, 0.25]])
    assert (problem.num_points, problem.num_observations, problem.fixed_intrinsics.all()) == (0, 0, True)


def test_cameras_come_by_name_and_share_equal_calibrations(tmp_path: Path) -> None:
    other = TEXT.replace("2759.48", "3000")
    for name, text in (("b.png", other), ("c.png", TEXT), ("a.png", TEXT)):
        write_camera(tmp_path / "truth", name, text)
    problem = read(tmp_path / "truth")
    assert problem.metadata.image_names == ["a.png", "b.png", "c.png"]
    assert problem.intrinsics[problem.intrinsics_index, 0].tolist() == [2759.48, 3000, 2759.48]
    assert len(problem.intrinsics) == 2


def test_the_cameras_can_be_handed_on_as_a_colmap_model(tmp_path: Path) -> None:
    plain = TEXT.replace("0.01 -0.002 0.0003", "0 0 0").replace("1.5 1520", "0 1520")
    write_camera(tmp_path / "truth", "a.jpg", plain)
    convert(tmp_path / "truth", tmp_path / "model")
    before, after = read(tmp_path / "truth"), read(tmp_path / "model")
    assert after.metadata.image_names == ["a.jpg"]
    np.testing.assert_allclose(after.cameras, before.cameras, atol=1e-13)
    np.testing.assert_allclose(after.intrinsics, before.intrinsics, rtol=1e-14)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (TEXT.replace("3072 2048", "3072"), "holds 25 numbers: must be 26"),
        (TEXT + "7\n", "holds 27 numbers"),
        (TEXT.replace("2759.48", "-1"), "a.jpg.camera:1: the calibration matrix is"),
        (TEXT.replace("0 0 1 \n", "0 0 2 \n"), "a.jpg.camera:1: the calibration matrix is"),
        (TEXT.replace("-1 0 0\n", "1 0 0\n"), "a.jpg.camera:5: the nine numbers from here are no rotation"),
        (TEXT.replace("3072 2048", "3072.5 2048"), "a.jpg.camera:9: image size 3072.5"),
        (TEXT.replace("5 -7", "5 nan"), "a.jpg.camera:8: "),
        ("", "the file is empty"),
    ],
    ids=range(8),
)
def test_what_is_no_camera_is_named_with_its_line(text: str, told: str, tmp_path: Path) -> None:
    write_camera(tmp_path / "truth", "a.jpg", text)
    with pytest.raises(DatasetError) as caught:
        read(tmp_path / "truth")
    assert told in str(caught.value)


def test_a_folder_without_cameras_is_no_such_truth(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"without files named IMAGE\.camera"):
        read(tmp_path, format="strecha")


def test_it_is_read_only(tmp_path: Path) -> None:
    write_camera(tmp_path / "truth", "a.jpg")
    problem = read(tmp_path / "truth")
    with pytest.raises(DatasetError, match="format strecha can be read but not written"):
        write(problem, tmp_path / "truth")
    assert [f.name for f in formats() if f.name == "strecha"] == ["strecha"]


def epipolar_distances_px(problem, i: int, j: int, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Symmetric distances (n, 2) [px] of matches from the epipolar lines of P_i and P_j (Hartley's F)."""
    f, aspect, cx, cy = problem.intrinsics[0, :4]
    matrix = np.array([[f, 0, cx], [0, f * aspect, cy], [0, 0, 1]])
    rotations, centres = problem.rotations, problem.centres
    turn = rotations[j].T @ rotations[i]
    x, y, z = rotations[j].T @ (centres[i] - centres[j])
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn
    back = np.linalg.inv(matrix)
    fundamental = back.T @ essential @ back
    one, other = (np.column_stack([p, np.ones(len(p))]) for p in (first, second))
    lines_j, lines_i = one @ fundamental.T, other @ fundamental
    product = np.abs(np.sum(other * lines_j, axis=1))
    return np.column_stack([product / np.linalg.norm(lines[:, :2], axis=1) for lines in (lines_j, lines_i)])


@pytest.mark.real
def test_matches_of_real_photos_lie_on_the_epipolar_lines_of_the_file(data_dir: Path) -> None:
    cv2 = pytest.importorskip("cv2")
    problem = read(data_dir / "fountain_p11/gt_dense_cameras")
    assert problem.num_cameras == 11
    found = []
    for name in problem.metadata.image_names[4:6]:
        image = cv2.imread(str(data_dir / "fountain_p11/images" / name), cv2.IMREAD_GRAYSCALE)
        image = image[256:1280, 768:2304]
        keypoints, descriptors = cv2.SIFT_create(2000).detectAndCompute(image, None)
        found.append((np.array([k.pt for k in keypoints]) + np.array([768, 256]), descriptors))
    (first, a), (second, b) = found
    matches = [m for m, n in cv2.BFMatcher().knnMatch(a, b, k=2) if m.distance < 0.7 * n.distance]
    left = first[[m.queryIdx for m in matches]]
    right = second[[m.trainIdx for m in matches]]
    distances = epipolar_distances_px(problem, 4, 5, left, right)
    assert len(matches) > 200
    assert np.median(distances) < 0.4
    # The test can fail: with the neighbour's truth the same matches are far away.
    assert np.median(epipolar_distances_px(problem, 4, 6, left, right)) > 4


@pytest.mark.real
def test_no_real_camera_is_lost_among_other_files(data_dir: Path, tmp_path: Path) -> None:
    folder = tmp_path / "both"
    folder.mkdir()
    # File by file: a copy of the whole folder may not be written to where the data are read-only.
    for file in (data_dir / "herz_jesus_p8/gt_dense_cameras").iterdir():
        shutil.copyfile(file, folder / file.name)
    (folder / "readme.txt").write_text("not a camera")
    problem = read(folder)
    assert problem.metadata.image_names == [f"{i:04d}.jpg" for i in range(8)]
    assert len(problem.intrinsics) == 1
