"""Databases of COLMAP: what pycolmap writes is read and reconstructed, and what is wrong is named."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sfmcpp
from sfmcpp.errors import DatasetError, InvalidArgument
from sfmcpp.model.photos import Photo
from sfmcpp.sfm import match_graph_of_database, reconstruct
from sfmcpp.sfm.positions import choose_positions
from sfmcpp.sources.io.colmap.database import read_database

NAMES = ["b.jpg", "a.jpg", "c.jpg"]
PAIR_BASE = 2**31 - 1


def blob(array: object, dtype: type) -> bytes:
    return np.asarray(array, dtype=dtype).tobytes()


def write_database(path: Path) -> Path:
    """Three images of five keypoints of each kind of columns, matched and partly verified."""
    matches = np.column_stack([np.arange(5), [4, 3, 2, 1, 0]])
    with sqlite3.connect(path) as tables:
        tables.executescript(
            "CREATE TABLE cameras (camera_id, model, width, height, params BLOB, prior_focal_length);"
            "CREATE TABLE images (image_id INTEGER PRIMARY KEY, name, camera_id);"
            "CREATE TABLE keypoints (image_id INTEGER PRIMARY KEY, rows, cols, data BLOB);"
            "CREATE TABLE matches (pair_id INTEGER PRIMARY KEY, rows, cols, data BLOB);"
            "CREATE TABLE two_view_geometries (pair_id INTEGER PRIMARY KEY, rows, cols, data BLOB, config);"
            "CREATE TABLE pose_priors (image_id, position BLOB, coordinate_system);"
        )
        cameras = [(1, 2, 640, 480, blob([700, 320, 240, 0.1], np.float64), 1)]
        cameras += [(4, 1, 800, 600, blob([960, 950, 400, 300], np.float64), 0)]
        tables.executemany("INSERT INTO cameras VALUES (?, ?, ?, ?, ?, ?)", cameras)
        tables.executemany(
            "INSERT INTO images VALUES (?, ?, ?)", zip((3, 5, 8), NAMES, (1, 1, 4), strict=True)
        )
        for image, columns in ((3, 2), (5, 4), (8, 6)):
            places = np.arange(5 * columns).reshape(5, columns) + image
            tables.execute(
                "INSERT INTO keypoints VALUES (?, 5, ?, ?)", (image, columns, blob(places, np.float32))
            )
        for first, second in ((3, 5), (3, 8)):
            row = (first * PAIR_BASE + second, blob(matches, np.uint32))
            tables.execute("INSERT INTO matches VALUES (?, 5, 2, ?)", row)
        row = (3 * PAIR_BASE + 5, blob(matches[:4], np.uint32))
        tables.execute("INSERT INTO two_view_geometries VALUES (?, 4, 2, ?, 3)", row)
        tables.execute("INSERT INTO two_view_geometries VALUES (?, 0, 2, NULL, 1)", (3 * PAIR_BASE + 8,))
        priors = [(5, blob([46.8, -92.0, 200], np.float64), 0), (8, blob([1, 2, 3], np.float64), 1)]
        tables.executemany("INSERT INTO pose_priors VALUES (?, ?, ?)", priors)
    tables.close()
    return path


def test_images_are_sorted_by_name_with_their_cameras_and_positions(tmp_path: Path) -> None:
    found = read_database(write_database(tmp_path / "database.db"))
    assert [photo.name for photo in found.photos] == ["a.jpg", "b.jpg", "c.jpg"]
    assert [photo.size for photo in found.photos] == [(640, 480), (640, 480), (800, 600)]
    assert [photo.focal_px for photo in found.photos] == [700, 700, None]
    assert [photo.camera for photo in found.photos] == ["1", "1", "4"]
    assert [photo.position for photo in found.photos] == [(46.8, -92.0, 200.0), None, None]
    assert found.image_ids == [5, 3, 8]
    assert [(camera.id, camera.model) for camera in found.cameras] == [
        *[(1, "SIMPLE_RADIAL")] * 2,
        (4, "PINHOLE"),
    ]
    np.testing.assert_array_equal(found.cameras[0].intrinsics, [700, 1, 320, 240, 0, 0.1, 0, 0, 0, 0, 0, 0])


def test_keypoints_have_the_sizes_that_their_columns_tell(tmp_path: Path) -> None:
    found = read_database(write_database(tmp_path / "database.db"))
    np.testing.assert_array_equal(found.keypoints[0][0], [5, 6])
    np.testing.assert_array_equal(found.scales[0], 7 + 4 * np.arange(5))
    assert np.isnan(found.scales[1]).all()
    a, b, c, d = 10 + 6 * np.arange(5) + np.arange(4)[:, None]
    np.testing.assert_allclose(found.scales[2], np.sqrt(np.abs(a * d - b * c)), rtol=1e-15)


def test_verified_matches_come_before_the_others(tmp_path: Path) -> None:
    path = write_database(tmp_path / "database.db")
    assert {pair: len(some) for pair, some in read_database(path).matches.items()} == {(1, 0): 4}
    change(path, "DELETE FROM two_view_geometries")
    matches = read_database(path).matches
    assert {pair: len(some) for pair, some in matches.items()} == {(1, 0): 5, (1, 2): 5}
    np.testing.assert_array_equal(matches[1, 2][:2], [[0, 4], [1, 3]])


def change(path: Path, statement: str) -> None:
    with sqlite3.connect(path) as tables:
        tables.executescript(statement)
    tables.close()


@pytest.mark.parametrize(
    ("statement", "reason"),
    [
        ("DROP TABLE keypoints", "is no database of COLMAP: it lacks keypoints"),
        ("DROP TABLE keypoints; CREATE VIEW keypoints AS SELECT 1", "it lacks keypoints"),
        ("ALTER TABLE keypoints DROP COLUMN data;"
         "ALTER TABLE keypoints ADD COLUMN data AS (zeroblob(900000000))",
         "table keypoints has columns that are computed: all must be stored"),
        ("ALTER TABLE images DROP COLUMN name", "is a damaged database: no such column"),
        ("UPDATE cameras SET model = 5", "camera 1: camera model OPENCV_FISHEYE is not supported"),
        ("UPDATE cameras SET width = 0", "image size 0x480 is impossible"),
        ("UPDATE cameras SET params = x'00'", "has 1 bytes, must have 1 rows of 32 bytes"),
        ("UPDATE cameras SET params = zeroblob(32)", "parameters [0.0, 0.0, 0.0, 0.0] are impossible"),
        ("UPDATE cameras SET camera_id = 'x' WHERE camera_id = 4", "camera x = 'x': must be a whole number"),
        ("UPDATE images SET image_id = -3 WHERE image_id = 3", "'b.jpg': id = -3: must be a whole number"),
        ("UPDATE images SET camera_id = 2", "'a.jpg': camera 2 is not in the list"),
        ("UPDATE images SET name = 'a.jpg'", "'a.jpg' is there more than once"),
        ("UPDATE images SET name = 'a' || char(10) || 'b' WHERE image_id = 3", "or hold a line break or NUL"),
        ("UPDATE images SET name = '' WHERE image_id = 3", "images: name '': must not be empty"),
        ("UPDATE images SET name = x'ff00' WHERE image_id = 3", "images: name b'\\xff\\x00': must be text"),
        ("ALTER TABLE keypoints DROP COLUMN cols; ALTER TABLE keypoints ADD COLUMN cols REAL DEFAULT 2.0",
         "has 2.0 columns: must be 2, 4 or 6"),
        ("UPDATE two_view_geometries SET pair_id = 3 * 2147483648 WHERE rows > 0", "is matched with itself"),
        ("UPDATE keypoints SET rows = 1000000000000", "must have 1000000000000 rows of"),
        ("UPDATE keypoints SET data = 'text'", "has str, must have"),
        ("UPDATE keypoints SET cols = 3", "has 3 columns: must be 2, 4 or 6"),
        ("UPDATE keypoints SET image_id = 9 WHERE image_id = 8", "image 9 is not in the list of images"),
        ("UPDATE keypoints SET rows = 1, data = x'0000c07f0000c07f' WHERE cols = 2", "keypoint 0 is impo"),
        ("UPDATE two_view_geometries SET pair_id = 7 WHERE rows > 0", "of images (0, 7): they are not in"),
        ("UPDATE two_view_geometries SET data = x'ff' WHERE rows > 0", "must have 4 rows of 8 bytes"),
        ("UPDATE pose_priors SET position = x'0000000000408f4000000000000020400000000000006940' "
         "WHERE coordinate_system = 0",
         "pose_priors: image 5: latitude 1000°, longitude 8°: out of range"),
        ("DELETE FROM images; DELETE FROM keypoints; DELETE FROM two_view_geometries; DELETE FROM matches",
         "holds no images"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(tmp_path: Path, statement: str, reason: str) -> None:
    path = write_database(tmp_path / "database.db")
    change(path, statement)
    with pytest.raises(DatasetError) as refused:
        match_graph_of_database(path)
    assert reason in str(refused.value)
    assert refused.value.path == str(path)


@pytest.mark.parametrize(
    ("damage", "reason"),
    [
        (lambda data: data[: len(data) // 2], "is a damaged database"),
        (lambda data: data[:200], "is a damaged database"),
        (lambda data: b"no" + data[2:], "is no database of SQLite"),
        (lambda data: data[:100] + bytes(len(data) - 100), "is a damaged database"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, damage: Callable[[bytes], bytes], reason: str) -> None:
    path = write_database(tmp_path / "database.db")
    path.write_bytes(damage(path.read_bytes()))
    with pytest.raises(DatasetError, match=reason):
        match_graph_of_database(path)


def test_a_name_longer_than_any_file_has_is_refused() -> None:
    with pytest.raises(DatasetError, match="file name too long"):
        read_database("x" * 1000)


def test_a_database_with_a_log_leaves_nothing_beside_it_and_needs_no_writable_folder(tmp_path: Path) -> None:
    path = write_database(tmp_path / "database.db")
    change(path, "PRAGMA journal_mode=WAL")
    expected = read_database(path)
    assert list(tmp_path.iterdir()) == [path]
    with closing(sqlite3.connect(path)) as other:
        other.execute(
            "UPDATE images SET name = 'renamed.jpg' WHERE image_id = (SELECT MAX(image_id) FROM images)"
        )
        other.commit()  # into the log, which another program still writes
        assert (tmp_path / "database.db-wal").stat().st_size
        names = [photo.name for photo in read_database(path).photos]
    assert "renamed.jpg" in names
    assert len(names) == len(expected.photos)


def test_what_is_not_used_is_said(tmp_path: Path) -> None:
    path = write_database(tmp_path / "database.db")
    (cartesian,) = match_graph_of_database(path).warnings
    assert cartesian.startswith("position priors in Cartesian coordinates in the database (1) are not used")
    change(
        path,
        "DELETE FROM pose_priors; CREATE TABLE rig_sensors (rig_id, sensor_id);"
        "INSERT INTO rig_sensors VALUES (1, 4)",
    )
    (rigs,) = match_graph_of_database(path).warnings
    assert rigs.startswith("rigs of several cameras in the database (1) are not used")
    assert "COLMAP cannot continue the model" in rigs
    change(path, "DELETE FROM rig_sensors")
    assert match_graph_of_database(path).warnings == []


@pytest.mark.parametrize(
    ("statement", "warning"),
    [
        ("UPDATE pose_priors SET coordinate_system = -1",
         "position priors in undefined coordinates in the database (2) are not used"),
        ("UPDATE pose_priors SET coordinate_system = -1, position = x'" + "000000000000f87f" * 3 + "'", None),
        ("DELETE FROM pose_priors; ALTER TABLE pose_priors ADD COLUMN gravity;"
         "INSERT INTO pose_priors VALUES (3, NULL, -1, x'" + "000000000000f03f" * 3 + "');"
         "INSERT INTO pose_priors VALUES (5, NULL, -1, x'" + "000000000000f87f" * 3 + "');"
         "INSERT INTO pose_priors VALUES (8, NULL, -1, x'" + "000000000000f03f" + "00" * 16 + "')",
         "gravity priors in the database (1) are not used"),
        ("DELETE FROM pose_priors; ALTER TABLE images ADD COLUMN prior_tx;"
         "ALTER TABLE images ADD COLUMN prior_ty;"
         "UPDATE images SET prior_tx = 46.8, prior_ty = -92.0 WHERE image_id = 5;"
         "UPDATE images SET prior_tx = 0, prior_ty = 0 WHERE image_id = 3",
         "positions in the table of images (1), where COLMAP before 3.10 has them, are not used"),
    ],
)  # fmt: skip
def test_priors_that_are_not_used_are_said(tmp_path: Path, statement: str, warning: str | None) -> None:
    path = write_database(tmp_path / "database.db")
    change(path, statement)
    found = match_graph_of_database(path).warnings
    assert len(found) == (warning is not None)
    assert all(text.startswith(warning or "") for text in found)


def with_more_positions(photos: Sequence[Photo]) -> list[Photo]:
    """The photos and copies of the first about it: fewer than five positions, and a line, are refused."""
    assert photos[0].position is not None
    latitude, longitude, height = photos[0].position
    places = [(latitude + k, longitude + k * k, height) for k in range(4)]
    copies = (replace(photos[0], name=f"more {k}.jpg", position=place) for k, place in enumerate(places))
    return [*photos, *copies]


def covariance(*variances: float) -> str:
    return f"x'{blob(np.diag(variances), np.float64).hex()}'"


@pytest.mark.parametrize("names", ["image_id", "corr_data_id, corr_sensor_type"])
def test_covariances_of_positions_are_their_standard_deviations(tmp_path: Path, names: str) -> None:
    path = write_database(tmp_path / "database.db")
    position = f"x'{blob([46.8, -92, 200], np.float64).hex()}'"
    extra = ", 0" * names.count(",")
    columns = f"{names}, position, position_covariance, coordinate_system"
    change(
        path,
        f"DROP TABLE pose_priors; CREATE TABLE pose_priors ({columns});"
        f"INSERT INTO pose_priors VALUES (5{extra}, {position}, {covariance(4, 9, 16)}, 0);"
        f"INSERT INTO pose_priors VALUES (3{extra}, {position}, {covariance(1, 1, 0.25)}, 0)",
    )
    graph = match_graph_of_database(path)
    assert [photo.position_sigmas_m for photo in graph.photos] == [(2, 3, 4), (1, 1, 0.5), None]
    assert graph.warnings == []
    positions = choose_positions("exif", None, with_more_positions(graph.photos))
    assert positions is not None
    assert positions.sigmas_m is not None
    np.testing.assert_array_equal(positions.sigmas_m[:2], [[2, 3, 4], [1, 1, 0.5]])


@pytest.mark.parametrize("missing", ["NULL", covariance(np.nan, np.nan, np.nan), covariance(1, 1, 0)])
def test_covariances_of_some_positions_do_not_count(tmp_path: Path, missing: str) -> None:
    path = write_database(tmp_path / "database.db")
    change(
        path,
        "ALTER TABLE pose_priors ADD COLUMN position_covariance;"
        "UPDATE pose_priors SET coordinate_system = 0;"
        f"UPDATE pose_priors SET position_covariance = {covariance(1, 1, 1)} WHERE image_id = 5;"
        f"UPDATE pose_priors SET position_covariance = {missing} WHERE image_id = 8",
    )
    graph = match_graph_of_database(path)
    (warning,) = graph.warnings
    assert warning.startswith("covariances of position priors in the database (1) are not used, as 1 po")
    assert "c.jpg" in warning
    positions = choose_positions("exif", None, with_more_positions(graph.photos))
    assert positions is not None
    assert positions.sigmas_m is None
    change(path, f"UPDATE pose_priors SET position_covariance = {missing}")
    assert match_graph_of_database(path).warnings == []


def test_a_model_keeps_the_identifiers_and_the_camera_model_of_its_database(tmp_path: Path) -> None:
    pytest.importorskip("poselib", reason="PoseLib is not installed: pip install 'sfmcpp[vision]'")
    path = tmp_path / "database.db"
    pycolmaps(path)
    change(  # images are detected in any order, names then tell no identifier
        path,
        "UPDATE images SET name = 'z' || name WHERE image_id = 1; UPDATE cameras SET camera_id = 7;"
        "UPDATE images SET camera_id = 7",
    )
    run = reconstruct(path)
    extra = run.problem().metadata.extra
    assert extra["colmap_image_ids"].tolist() == [2, 3, 4, 5, 6, 1]
    assert extra["colmap_camera_ids"].tolist() == [7]
    assert extra["colmap_camera_models"] == ["SIMPLE_RADIAL"]
    asked = reconstruct(path, camera_model="opencv").problem().metadata.extra
    assert (asked["colmap_camera_ids"].tolist(), asked["colmap_camera_models"]) == ([7], ["OPENCV"])
    alone = reconstruct(path, shared_camera="each").problem().metadata.extra
    assert alone["colmap_camera_ids"].tolist() == [1, 2, 3, 4, 5, 6]


def pycolmaps(path: Path) -> Any:
    """The model behind a database that pycolmap has written."""
    pycolmap = pytest.importorskip("pycolmap")
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig = 1, 1, 6
    options.num_points3D = 120
    database = pycolmap.Database.open(str(path))
    pycolmap.set_random_seed(1)
    model = pycolmap.synthesize_dataset(options, database)
    database.close()
    return model


def test_a_database_of_pycolmap_is_reconstructed(tmp_path: Path) -> None:
    pytest.importorskip("poselib", reason="PoseLib is not installed: pip install 'sfmcpp[vision]'")
    model = pycolmaps(tmp_path / "database.db")
    run = reconstruct(tmp_path / "database.db")
    assert run.num_registered == 6
    problem = run.problem()
    assert problem.metadata.image_names == [photo.name for photo in run.graph.photos]
    assert sfmcpp.to_pycolmap(problem).num_points3D() == problem.num_points > 100
    with pytest.raises(InvalidArgument, match="model = 1: the run has 1 models"):
        run.problem(1)
    with pytest.raises(InvalidArgument, match=r"^problem = SfmRun.+: must be a Problem, which its method"):
        sfmcpp.solve(run)
    with pytest.raises(InvalidArgument, match=r"a Problem, which sfmcpp\.map\.problem_of_map makes of it"):
        sfmcpp.write(run.model, tmp_path / "model")
    assert run.model is not None
    known = {image.name: image.projection_center() for image in model.images.values()}
    truth = np.array([known[photo.name] for photo in run.graph.photos])
    found = run.model.poses[:, :, 3]
    for centres in (truth, found):
        centres -= centres.mean(axis=0)
        centres /= np.linalg.norm(centres)
    assert np.linalg.svd(truth.T @ found, compute_uv=False).sum() == pytest.approx(1, abs=1e-4)


def test_keypoints_of_larger_images_are_doubted(tmp_path: Path) -> None:
    path = write_database(tmp_path / "database.db")
    with closing(sqlite3.connect(path)) as tables, tables:
        tables.execute("UPDATE cameras SET width = 10, height = 8 WHERE camera_id = 4")
    warnings = match_graph_of_database(path).warnings
    assert any("keypoints of 1 of 3 images lie outside of them" in warning for warning in warnings)


def test_keypoints_of_double_precision_are_refused_with_what_they_must_be(tmp_path: Path) -> None:
    path = write_database(tmp_path / "database.db")
    with closing(sqlite3.connect(path)) as tables, tables:
        tables.execute("UPDATE keypoints SET data = ? WHERE image_id = 3", (blob(np.zeros(10), np.float64),))
    with pytest.raises(DatasetError, match=r"has 80 bytes, must have 5 rows of 8 bytes \(2 float32\)"):
        read_database(path)


def test_pairs_that_were_left_without_verification_are_counted(tmp_path: Path) -> None:
    """Those of which none was found to agree have a row without matches: they were verified."""
    path = write_database(tmp_path / "database.db")
    told = "matches of 1 pair of images in the database are not used"
    assert not any(told in sentence for sentence in read_database(path).unused)
    with closing(sqlite3.connect(path)) as tables, tables:
        tables.execute("DELETE FROM two_view_geometries WHERE rows = 0")
    assert any(told in sentence for sentence in read_database(path).unused)
    with closing(sqlite3.connect(path)) as tables, tables:
        tables.execute("DELETE FROM two_view_geometries")
    found = read_database(path)
    assert len(found.matches) == 2
    assert not any("are not used, as only" in sentence for sentence in found.unused)
