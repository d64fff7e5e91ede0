"""COLMAP: exact round trips, what COLMAP's own reader makes of our files, and every kind of damage."""

from __future__ import annotations

import re
import struct
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from io_helpers import (
    PROPERTY,
    assert_same_metadata,
    assert_same_problem,
    no_warnings,
    random_problem,
    refusal,
    residuals,
)
from sfmcpp import DatasetError, Problem
from sfmcpp.model.metadata import SECOND_SIGHTINGS
from sfmcpp.sources.io import read, write

FORMATS = ["colmap-text", "colmap-binary"]
MODELS = {
    "SIMPLE_PINHOLE": ({"f": 900}, {"f"}),
    "PINHOLE": ({"f": 900, "aspect": 0.2}, {"f", "aspect"}),
    "SIMPLE_RADIAL": ({"f": 900, "k1": 0.3}, {"f", "k1"}),
    "RADIAL": ({"f": 900, "k1": 0.3, "k2": 0.2}, {"f", "k1", "k2"}),
    "OPENCV": ({"f": 900, "k1": 0.3, "p1": 0.1, "p2": 0.1}, {"f", "aspect", "k1", "k2", "p1", "p2"}),
}


def small_model(folder: Path, **files: str) -> Path:
    """Write two images of two shared points, one loose keypoint each; `files` replace contents."""
    texts = {
        "cameras": "# cameras\n7 OPENCV 640 480 500 510 320 240 0.1 -0.01 0.001 0.002\n",
        "images": "# images\n3 1 0 0 0 0 0 5 7 a b.jpg\n10 20 4 30 40 -1\n"
        "9 1 0 0 0 1 0 5 7 c.jpg\n50 60 -1 70 80 4\n",
        "points3D": "4 1 2 3 255 0 7 0.5 3 0 9 1\n",
    }
    for name, text in (texts | files).items():
        (folder / f"{name}.txt").write_text(text, encoding="latin-1")
    return folder


def random_model(seed: int, model: str) -> Problem:
    """Random cameras, some sharing intrinsics, with everything COLMAP files can tell."""
    varying, free = MODELS[model]
    varying = varying | {"cx": 320, "cy": 240}
    problem = random_problem(seed, "perspective", varying, shared=True).set_free_intrinsics(*free)
    rng = np.random.default_rng(seed)
    rows, cameras, points = len(problem.intrinsics), problem.num_cameras, problem.num_points
    problem.metadata.image_names = [f"näme {i} %s.jpg" for i in range(cameras)]
    problem.metadata.extra = {
        "colmap_camera_ids": rng.permutation(50)[:rows],
        "colmap_camera_models": [model] * rows,
        "colmap_camera_sizes": rng.integers(1, 9999, (rows, 2)),
        "colmap_image_ids": np.sort(rng.permutation(50)[:cameras]),
        "colmap_point_ids": rng.permutation(2**40 + np.arange(50))[:points],
    }
    return problem


@PROPERTY
@given(st.integers(0, 2**32), st.sampled_from(sorted(MODELS)), st.sampled_from(FORMATS))
def test_random_problems_survive_writing_and_reading(seed: int, model: str, format: str) -> None:
    problem = random_model(seed, model)
    with tempfile.TemporaryDirectory() as folder, no_warnings():
        write(problem, Path(folder) / "model", format=format)
        again = read(Path(folder) / "model")
        write(again, Path(folder) / "model 2", format=format)
        third = read(Path(folder) / "model 2")
    assert_same_problem(again, problem, intrinsics_rtol=4e-16)
    assert again.metadata.image_names == problem.metadata.image_names
    np.testing.assert_array_equal(again.metadata.point_colors, problem.metadata.point_colors)
    for key, value in problem.metadata.extra.items():
        np.testing.assert_array_equal(again.metadata.extra[key], value, err_msg=key)
    assert_same_problem(third, again, intrinsics_rtol=4e-16)
    assert_same_metadata(third, again)


@pytest.mark.parametrize("format", FORMATS)
def test_keypoints_without_a_point_survive(tmp_path: Path, format: str) -> None:
    original = read(small_model(tmp_path))
    write(original, tmp_path / "new", format=format)
    again = read(tmp_path / "new")
    np.testing.assert_array_equal(again.metadata.extra["colmap_loose_pixels"], [[30, 40], [50, 60]])
    np.testing.assert_array_equal(again.metadata.extra["colmap_keypoint_index"], [0, 1])
    original.metadata.source_format = format
    assert_same_problem(again, original, intrinsics_rtol=4e-16)
    assert_same_metadata(again, original)


@pytest.mark.parametrize("format", FORMATS)
def test_cameras_are_in_the_order_of_image_ids_whatever_that_of_the_file(tmp_path: Path, format: str) -> None:
    by_id = read(small_model(tmp_path))
    images = "9 1 0 0 0 1 0 5 7 c.jpg\n50 60 -1 70 80 4\n3 1 0 0 0 0 0 5 7 a b.jpg\n10 20 4 30 40 -1\n"
    shuffled = read(small_model(tmp_path, images=images))
    assert shuffled.metadata.image_names == ["a b.jpg", "c.jpg"]
    assert_same_problem(shuffled, by_id)
    assert_same_metadata(shuffled, by_id)
    by_id.metadata.extra["colmap_image_ids"] = np.array([9, 3])
    write(by_id, tmp_path / "new", format=format)
    np.testing.assert_array_equal(read(tmp_path / "new").cameras, by_id.cameras[::-1])


def test_a_fault_is_named_where_the_file_has_it_though_images_are_sorted(tmp_path: Path) -> None:
    images = "9 1 0 0 0 1 0 5 7 c.jpg\n50 60 -1 70 80 4\n3 0 0 0 0 0 0 5 7 a.jpg\n10 20 4 30 40 -1\n"
    error = refusal(small_model(tmp_path, images=images))
    assert (error.line, error.reason) == (3, "the quaternion is zero")
    problem = read(small_model(tmp_path, images=images.replace("3 0 0", "3 1 0")))
    problem.metadata.extra["colmap_image_ids"] = np.array([9, 3])
    write(problem, tmp_path / "new")
    path = tmp_path / "new" / "images.bin"
    whole = path.read_bytes()
    path.write_bytes(whole.replace(struct.pack("<I4d", 3, 1, 0, 0, 0), struct.pack("<I4d", 3, 0, 0, 0, 0)))
    assert "entry 1 (id 3): the quaternion is zero" in str(refusal(tmp_path / "new"))


def test_residual_is_that_of_the_definition(tmp_path: Path) -> None:
    problem = read(small_model(tmp_path))
    u, v = np.array([1.0, 2.0]) / (3 + 5)
    r2 = u * u + v * v
    radial = 0.1 * r2 - 0.01 * r2**2
    x = u + u * radial + 2 * 0.001 * u * v + 0.002 * (r2 + 2 * u * u)
    y = v + v * radial + 2 * 0.002 * u * v + 0.001 * (r2 + 2 * v * v)
    expected = np.array([500 * x + 320 - 10, 510 * y + 240 - 20])
    np.testing.assert_allclose(residuals(problem)[0], expected, rtol=1e-13)


def test_binary_is_read_where_a_folder_has_both(tmp_path: Path) -> None:
    original = read(small_model(tmp_path))
    original.points += 1
    write(original, tmp_path / "other", format="colmap-binary")
    for file in (tmp_path / "other").iterdir():
        file.rename(tmp_path / file.name)
    np.testing.assert_array_equal(read(tmp_path).points, original.points)
    np.testing.assert_array_equal(read(tmp_path, format="colmap-text").points, original.points - 1)


@pytest.mark.parametrize("other", FORMATS)
@pytest.mark.parametrize("format", FORMATS)
def test_a_folder_has_one_model_whatever_kinds_of_files(tmp_path: Path, format: str, other: str) -> None:
    problem = read(small_model(tmp_path))
    folder = tmp_path / "model"
    write(problem, folder, format=other)
    kinds = {format, other}
    problem.points += 1
    write(problem, folder, format=format)
    for kind in kinds:
        np.testing.assert_array_equal(read(folder, format=kind).points, problem.points)
    assert len(list(folder.iterdir())) == 3 * len(kinds)


@pytest.mark.parametrize("name", ["frames.bin", "rigs.txt"])
def test_a_model_is_not_mixed_with_the_rigs_of_another(tmp_path: Path, name: str) -> None:
    problem = read(small_model(tmp_path))
    (tmp_path / name).write_bytes(b"")
    with pytest.raises(DatasetError, match=r"would be replaced, .* write to another folder"):
        write(problem, tmp_path, format="colmap-binary")
    assert not (tmp_path / "cameras.bin").exists()


@pytest.mark.parametrize("format", FORMATS)
def test_errors_of_points_are_those_of_the_problem_that_is_written(tmp_path: Path, format: str) -> None:
    problem = random_model(5, "OPENCV")
    write(problem, tmp_path / "new", format=format)
    lengths = np.linalg.norm(residuals(problem), axis=1)
    inside = np.einsum(
        "mij,mi->mj",
        problem.rotations[problem.camera_index],
        problem.points[problem.point_index] - problem.centres[problem.camera_index],
    )
    seen = inside[:, 2] > 0
    for point, error in enumerate(point_errors(tmp_path / "new", format)):
        mine = seen & (problem.point_index == point)
        expected = lengths[mine].mean() if mine.any() else -1.0
        np.testing.assert_allclose(error, expected, rtol=1e-9)


def point_errors(folder: Path, format: str) -> np.ndarray:
    """Column of errors as the files have it."""
    from sfmcpp.sources.io.colmap import binary, text

    tables = text.read_text(folder) if format == "colmap-text" else binary.read_binary(folder)
    return tables.points.errors


def test_a_changed_parameter_moves_the_camera_to_a_model_that_has_it(tmp_path: Path) -> None:
    problem = random_model(3, "SIMPLE_RADIAL")
    problem.intrinsics[:, problem.intrinsic_names.index("k2")] = 0.25
    write(problem, tmp_path / "new")
    again = read(tmp_path / "new")
    assert set(again.metadata.extra["colmap_camera_models"]) == {"RADIAL"}
    np.testing.assert_array_equal(again.intrinsics, problem.intrinsics)


@pytest.mark.parametrize(
    ("free", "model"), [(["f"], "SIMPLE_PINHOLE"), (["f", "k1"], "SIMPLE_RADIAL"), (["p1"], "OPENCV")]
)
def test_the_smallest_model_with_all_free_parameters_is_taken(
    tmp_path: Path, free: list[str], model: str
) -> None:
    problem = random_problem(7, "perspective", {"f": 900, "cx": 5}, least=3).set_free_intrinsics(*free)
    write(problem, tmp_path / "new")
    assert set(read(tmp_path / "new").metadata.extra["colmap_camera_models"]) == {model}


@pytest.mark.parametrize(("name", "format"), [("skew", "colmap-text"), ("k4", "colmap-binary")])
def test_intrinsics_without_a_place_are_refused_by_name(tmp_path: Path, name: str, format: str) -> None:
    problem = random_problem(7, "perspective", {"f": 900, name: 0.5}, least=3)
    with pytest.raises(DatasetError, match=rf"intrinsics\[0\]: no supported .*{name} = "):
        write(problem, tmp_path / "new", format=format)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("colmap_camera_ids", [-1], "its id must be from 0"),
        ("colmap_image_ids", [5, 5], "id 5 is used twice"),
        ("colmap_point_ids", [2**62 + 1], "its id must be from 0"),
        ("colmap_point_ids", [1, 2], "has 2 entries: must be 1"),
        ("colmap_camera_sizes", [[-1, 5]], "its image size must be from 0"),
        ("colmap_loose_pixels", [[np.inf, 1], [2, 3]], "keypoints is not finite"),
        (SECOND_SIGHTINGS, [[1, 2]], "must be (any, 3)"),
        ("colmap_keypoint_index", [1, 1], "does not number each image's keypoints once"),
    ],
)
def test_metadata_that_could_not_be_read_again_are_refused(
    tmp_path: Path, key: str, value: list[float], reason: str
) -> None:
    problem = read(small_model(tmp_path))
    problem.metadata.extra[key] = np.array(value)
    with pytest.raises(DatasetError, match=re.escape(reason)):
        write(problem, tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("name", ["", " a", "a\nb", "a\0b"])
def test_names_that_text_cannot_hold_are_refused(tmp_path: Path, name: str) -> None:
    problem = read(small_model(tmp_path))
    problem.metadata.image_names[1] = name
    with pytest.raises(DatasetError, match="image name"):
        write(problem, tmp_path / "new")


IMAGE = "3 1 0 0 0 0 0 5 7 a.jpg\n10 20 4 30 40 -1\n"
DAMAGE = [
    ("cameras", "7 FOV 640 480 500 320 240 0.1\n", 1, "camera model FOV is not supported: must be one of"),
    ("cameras", "7 PINHOLE 640 480 500 320 240\n", 1, "holds 6 numbers, its camera model takes 7"),
    ("cameras", "7\n", 1, "must hold id, model, width, height and parameters"),
    ("cameras", "7 PINHOLE 640 -1 5 5 3 2\n", 1, "image size -1"),
    ("cameras", "7 PINHOLE 640 480 0 5 3 2\n", 1, "fx must not be 0"),
    ("cameras", "#\n7 RADIAL 6 4 5 3 2 1 nan\n", 2, "nan is not a finite number"),
    ("cameras", "7 SIMPLE_PINHOLE 6 4 5 3 2\n" * 2, 2, "id 7 is used twice"),
    ("cameras", "8 SIMPLE_PINHOLE 6 4 5 3 2\n", 2, "camera id is not in the list"),
    ("images", IMAGE + "9 1 0 0 0 1 0 5 7\n\n", 3, "must hold id, quaternion, translation"),
    ("images", IMAGE + "9 0 0 0 0 1 0 5 7 c\n50 60 -1 70 80 4\n", 3, "quaternion is zero"),
    (
        "images",
        IMAGE + "9 1 0 0 0 1 0 5 7 c\n50 60 -1 70 80\n",
        4,
        "holds 5 numbers: must be a multiple of 3",
    ),
    ("images", IMAGE + "9 1 0 0 0 1 0 5 7 c\xff\n50 60 -1 70 80 4\n", 3, "not UTF-8"),
    ("images", IMAGE + "9 1 0 0 x 1 0 5 7 c\n50 60 -1 70 80 4\n", 3, "'x' is not a finite number"),
    ("images", IMAGE + "9 1 0 0 0 1 0 5 7 c\n50 60 4 70 80 4\n", 3, "which does not list it"),
    ("images", IMAGE + "9 1 0 0 0 1 0 5 7 c\n50 60 4\n", 1, "keypoint that its image does not have"),
    ("images", IMAGE, 1, "an image that is not in the list"),
    ("points3D", "4 1 2 3 255 0 7\n", 1, "holds 7 numbers: must be 8"),
    ("points3D", "4 1 2 3 256 0 7 0.5 3 0 9 1\n", 1, "colour 256"),
    ("points3D", "4 1 2 3 255 0 7 0.5 3 1 9 1\n", 1, "the image gives to another point"),
    (
        "points3D",
        "4 1 2 3 255 0 7 0.5 3 0 3 0 9 1\n",
        1,
        "observes this point twice by its keypoint 0",
    ),
    ("points3D", "-4 1 2 3 255 0 7 0.5 3 0 9 1\n", 1, "point id -4"),
    ("points3D", "", 2, "which does not list it"),
]


@pytest.mark.parametrize(("name", "text", "line", "reason"), DAMAGE)
def test_damaged_text_is_named_with_its_line(
    tmp_path: Path, name: str, text: str, line: int | None, reason: str
) -> None:
    error = refusal(small_model(tmp_path, **{name: text}))
    assert reason in str(error)
    assert error.line == line


@pytest.mark.parametrize("format", FORMATS)
def test_of_several_keypoints_of_a_point_in_one_image_the_first_in_the_track_counts(
    tmp_path: Path, format: str
) -> None:
    images = "3 1 0 0 0 0 0 5 7 b.jpg\n10 20 4 30 40 -1 11 21 4 12 22 4\n9 1 0 0 0 1 0 5 7 c.jpg\n50 60 4\n"
    tracks = "4 1 2 3 255 0 7 0.5 3 2 9 0 3 0 3 3\n"
    problem = read(small_model(tmp_path, images=images, points3D=tracks))
    assert problem.pixels.tolist() == [[11, 21], [50, 60]]
    assert problem.camera_index.tolist() == [0, 1]
    assert problem.metadata.extra["colmap_loose_pixels"].tolist() == [[10, 20], [30, 40], [12, 22]]
    write(problem, tmp_path / "again", format=format)
    again = read(tmp_path / "again", format=format)
    assert_same_problem(again, problem)
    assert again.metadata.extra["colmap_loose_keypoint_index"].tolist() == [0, 1, 3]
    assert again.metadata.extra[SECOND_SIGHTINGS].tolist() == [[0, 0, 4], [0, 3, 4]]


def test_missing_files_are_named(tmp_path: Path) -> None:
    small_model(tmp_path)
    (tmp_path / "images.txt").unlink()
    assert "lacks images.txt" in str(refusal(tmp_path))


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin", "points3D.bin"])
@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda data: data[:-1], "truncated"),
        (lambda data: data + b"\0", "trailing garbage: 1 bytes"),
        (lambda data: b"\xff" * 8 + data[8:], "cannot hold 18446744073709551615 entries"),
        (lambda data: data[:5], "truncated"),
        (lambda data: b"", "the file is empty"),
    ],
)
def test_damaged_binary_is_refused(tmp_path: Path, name: str, damage: object, reason: str) -> None:
    write(read(small_model(tmp_path)), tmp_path / "new")
    path = tmp_path / "new" / name
    path.write_bytes(damage(path.read_bytes()))  # type: ignore[operator]
    error = refusal(tmp_path / "new")
    assert reason in str(error)
    assert error.path == str(path)


@pytest.mark.parametrize(("number", "model"), [(7, "FOV"), (13, "DIVISION"), (17, "EQUIRECTANGULAR")])
def test_an_unsupported_binary_camera_model_is_named(tmp_path: Path, number: int, model: str) -> None:
    write(read(small_model(tmp_path)), tmp_path / "new")
    path = tmp_path / "new" / "cameras.bin"
    data = path.read_bytes()
    path.write_bytes(data[:12] + bytes([number]) + data[13:])
    reason = str(refusal(tmp_path / "new"))
    assert f"camera model {model} is not supported" in reason
    assert ("image_undistorter" in reason) == (model != "EQUIRECTANGULAR")


@pytest.mark.parametrize("format", FORMATS)
def test_rigs_of_one_camera_each_are_rewritten_with_the_model(tmp_path: Path, format: str) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 2, 1, 3
    options.num_points3D = 30
    model = pycolmap.synthesize_dataset(options)
    getattr(model, "write_text" if format == "colmap-text" else "write_binary")(str(tmp_path))
    problem = read(tmp_path)
    problem.cameras[:, :, 3] += [1, 2, 3]
    problem.points += [1, 2, 3]
    write(problem, tmp_path, format=format)
    moved = pycolmap.Reconstruction(str(tmp_path))
    assert {key: frame.rig_id for key, frame in moved.frames.items()} == {
        key: frame.rig_id for key, frame in model.frames.items()
    }
    for key, image in model.images.items():
        assert moved.images[key].frame_id == image.frame_id
        centre = moved.images[key].projection_center()
        np.testing.assert_allclose(centre, image.projection_center() + np.array([1.0, 2, 3]), atol=1e-12)
    fewer = problem.with_cameras(np.arange(4))
    fewer.metadata.extra["colmap_image_ids"] = np.arange(4) + 50  # not those of the frames
    write(fewer, tmp_path, format=format)
    frames = pycolmap.Reconstruction(str(tmp_path)).frames
    assert sorted(frames) == [50, 51, 52, 53]


def test_models_inside_a_folder_and_files_of_another_kind_are_named(tmp_path: Path) -> None:
    (tmp_path / "sparse" / "0").mkdir(parents=True)
    problem = read(small_model(tmp_path / "sparse" / "0"))
    write(problem, tmp_path / "sparse" / "1", format="colmap-binary")
    folder = tmp_path / "sparse"
    with pytest.raises(DatasetError, match=f"{folder / '0'}, {folder / '1'} are$"):
        read(folder)
    (folder / "1" / "cameras.bin").unlink()
    (folder / "1" / "cameras.txt").touch()
    with pytest.raises(DatasetError, match=r"lacks cameras\.bin \(and has cameras\.txt, which go"):
        read(folder / "1")


def test_a_database_is_told_where_it_goes(tmp_path: Path) -> None:
    path = tmp_path / "database.db"
    path.write_bytes(b"SQLite format 3\0")
    with pytest.raises(DatasetError, match="is a database of COLMAP: sfmcpp reconstruct"):
        read(path)
    path.write_bytes(b"")
    with pytest.raises(DatasetError, match="is no database of SQLite"):
        read(path)
