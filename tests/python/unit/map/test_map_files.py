"""Maps and COLMAP models: nothing is lost on the way, there and back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp import Problem, circle_scene
from sfmcpp.map import map_of_problem, problem_of_map, read_map, write_map
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sources.io.colmap import binary, text
from sfmcpp.sources.io.colmap.tables import CameraTable, ImageTable, PointTable, Tables

FORMATS = ["colmap-text", "colmap-binary"]
PARAMS = {
    "SIMPLE_PINHOLE": [500.0, 320, 240],
    "PINHOLE": [500.0, 520, 320, 240],
    "SIMPLE_RADIAL": [510.0, 320, 240, -0.05],
    "RADIAL": [510.0, 320, 240, -0.05, 0.01],
    "OPENCV": [500.0, 515, 321, 239, -0.05, 0.01, 0.002, -0.001],
}


def everything(seed: int) -> Tables:
    """A model with all that one can hold.

    Cameras of every model, one of them without an image; images without keypoints and without points; loose
    keypoints; tracks in no order; a point that nothing sees; identifiers that are not in a row.
    """
    rng, here = np.random.default_rng(seed), Path("generated")
    models = [*PARAMS, "RADIAL"]
    cameras = CameraTable(
        here,
        None,
        rng.permutation(90)[: len(models)],
        models=models,
        sizes=rng.integers(1, 5000, (len(models), 2)),
        params=[PARAMS[model] for model in models],
    )
    counts = np.array([7, 0, 9, 4, 8, 6, 5])
    num_images, num_points = len(counts), 10
    image_ids, point_ids = (
        np.sort(rng.permutation(500)[:num_images]),  # images are read in the order of their identifiers
        rng.permutation(2**40 + np.arange(99))[:num_points],
    )
    image = np.repeat(np.arange(num_images), counts)
    number = np.arange(len(image)) - np.repeat(np.cumsum(counts) - counts, counts)
    seen = np.full(len(image), -1)
    for i in set(range(num_images)) - {1, 3}:
        mine = np.flatnonzero(image == i)
        seen[rng.permutation(mine)[:4]] = rng.permutation(num_points - 1)[:4]
    rows = rng.permutation(np.flatnonzero(seen >= 0))
    rows = rows[np.argsort(seen[rows], kind="stable")]
    turns = Rotation.from_rotvec(rng.uniform(-0.2, 0.2, (num_images, 3))).as_quat(scalar_first=True)
    images = ImageTable(
        here,
        None,
        image_ids,
        quaternions=turns,
        translations=rng.uniform([-1, -1, 6], [1, 1, 8], (num_images, 3)),
        camera_ids=cameras.ids[rng.permutation(np.r_[0:5, 0:2])],
        names=[f"ordner {k}/bäum.jpg" for k in range(num_images)],
        keypoint_counts=counts,
        keypoints=rng.uniform(0, 600, (len(image), 2)),
        keypoint_points=np.where(seen >= 0, point_ids[np.maximum(seen, 0)], -1),
    )
    points = PointTable(
        here,
        None,
        point_ids,
        positions=rng.uniform(-1, 1, (num_points, 3)),
        colors=rng.integers(0, 256, (num_points, 3)).astype(np.uint8),
        errors=rng.uniform(0, 2, num_points),
        track_counts=np.bincount(seen[rows], minlength=num_points),
        track_images=image_ids[image[rows]],
        track_keypoints=number[rows],
    )
    return Tables(cameras, images, points)


def write_tables(tables: Tables, folder: Path, format: str) -> Path:
    folder.mkdir()
    is_text = format == "colmap-text"
    names = text.FILES if is_text else binary.FILES
    contents = text.text_files(tables) if is_text else binary.binary_files(tables)
    for name, content in zip(names, contents, strict=True):
        (folder / name).write_bytes(b"".join(content))
    return folder


def read_tables(folder: Path, format: str) -> Tables:
    return text.read_text(folder) if format == "colmap-text" else binary.read_binary(folder)


def assert_same_tables(found: Tables, expected: Tables) -> None:
    """All of a model but the errors of points; poses and ratios of focal lengths to rounding."""
    for name in ("ids", "models", "sizes"):
        np.testing.assert_array_equal(getattr(found.cameras, name), getattr(expected.cameras, name))
    for ours, theirs in zip(found.cameras.params, expected.cameras.params, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=4e-16)
    exact = ("ids", "camera_ids", "names", "keypoint_counts", "keypoints", "keypoint_points")
    for name in exact:
        np.testing.assert_array_equal(getattr(found.images, name), getattr(expected.images, name), name)
    sign = np.sign((found.images.quaternions * expected.images.quaternions).sum(axis=1, keepdims=True))
    np.testing.assert_allclose(sign * found.images.quaternions, expected.images.quaternions, atol=1e-15)
    np.testing.assert_allclose(found.images.translations, expected.images.translations, atol=1e-14)
    for name in ("ids", "positions", "colors", "track_counts", "track_images", "track_keypoints"):
        np.testing.assert_array_equal(getattr(found.points, name), getattr(expected.points, name), name)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("format", FORMATS)
def test_a_model_with_everything_is_written_as_it_was_read(tmp_path: Path, seed: int, format: str) -> None:
    tables = everything(seed)
    world = read_map(write_tables(tables, tmp_path / "given", format))
    write_map(world, tmp_path / "once", format=format)
    once = read_tables(tmp_path / "once", format)
    assert_same_tables(once, tables)
    np.testing.assert_allclose(once.points.errors, world.point_errors, rtol=1e-12)
    assert (once.points.errors[tables.points.track_counts > 0] > 0).all()
    assert once.points.errors[-1] == -1
    write_map(read_map(tmp_path / "once"), tmp_path / "twice", format=format)
    twice = read_tables(tmp_path / "twice", format)
    assert_same_tables(twice, once)
    np.testing.assert_allclose(twice.points.errors, once.points.errors, rtol=1e-9)


def test_a_map_of_a_model_is_what_the_model_says(tmp_path: Path) -> None:
    tables = everything(4)
    world = read_map(write_tables(tables, tmp_path / "given", "colmap-binary"))
    assert world.image_names == tables.images.names
    assert world.camera_names == tables.cameras.models
    np.testing.assert_array_equal(world.keypoints, tables.images.keypoints)
    np.testing.assert_array_equal(world.camera_sizes, tables.cameras.sizes)
    points = np.append(world.point_ids, -1)[world.keypoint_points]
    np.testing.assert_array_equal(points, tables.images.keypoint_points)
    np.testing.assert_array_equal(world.camera_ids[world.image_cameras], tables.images.camera_ids)
    rotations = Rotation.from_quat(tables.images.quaternions, scalar_first=True)
    np.testing.assert_allclose(world.poses[:, :, :3], rotations.inv().as_matrix(), atol=1e-15)


def test_images_without_a_pose_and_points_without_a_position_stay_out_of_files(tmp_path: Path) -> None:
    world = map_of_problem(circle_scene(5, 30, seed=1))
    world.poses[2] = np.nan
    world.points[7] = np.nan
    write_map(world, tmp_path / "model")
    again = read_map(tmp_path / "model")
    np.testing.assert_array_equal(again.image_ids, [1, 2, 4, 5])
    assert 8 not in again.point_ids.tolist()
    # Their keypoints are there, and see nothing.
    assert len(again.keypoints) == len(world.keypoints) - world.keypoint_counts[2]
    assert (again.keypoint_points < 0).sum() == (again.keypoint_images.max() + 1)


@pytest.mark.parametrize("model", ["calibrated", "perspective", "bal"])
def test_a_problem_comes_back_from_its_map(model: str) -> None:
    problem = circle_scene(6, 40, camera_model=model, seed=2, pixel_sigma_px=1.0)
    back = problem_of_map(map_of_problem(problem))
    assert back.camera_model == model
    names = ("cameras", "intrinsics", "points", "intrinsics_index", "fixed_intrinsics")
    for name in names:
        np.testing.assert_array_equal(getattr(back, name), getattr(problem, name), name)
    assert observations(back) == observations(problem)


def observations(problem: Problem) -> set[Any]:
    return set(
        zip(
            problem.camera_index.tolist(),
            problem.point_index.tolist(),
            *problem.pixels.T.tolist(),
            strict=True,
        )
    )


def test_colmap_reads_what_a_map_wrote(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap")
    world = read_map(write_tables(everything(5), tmp_path / "given", "colmap-binary"))
    write_map(world, tmp_path / "model")
    model = pycolmap.Reconstruction(str(tmp_path / "model"))
    assert model.num_points3D() == len(world.points)
    model.update_point_3d_errors()
    theirs = {number: point.error for number, point in model.points3D.items()}
    seen = world.point_errors >= 0
    ours = dict(zip(world.point_ids[seen].tolist(), world.point_errors[seen].tolist(), strict=True))
    for number, error in ours.items():
        assert theirs[number] == pytest.approx(error, rel=1e-9)


def test_a_map_tells_its_size() -> None:
    world = map_of_problem(circle_scene(5, 40, seed=0))
    assert repr(world) == "Map('calibrated': 5 images, 5 with a pose, 40 points)"
    world.poses[0] = np.nan
    world.remove_points([3])
    assert repr(world) == "Map('calibrated': 5 images, 4 with a pose, 39 points)"


@pytest.mark.parametrize("geodetic", [True, False])
@pytest.mark.parametrize("name", ["model", "model.npz"])
def test_the_origin_of_the_world_is_kept(tmp_path: Path, name: str, geodetic: bool) -> None:
    scene = circle_scene(4, 30, seed=0)
    WorldOrigin(np.array([46.8, -92.0, 198.0]), geodetic).put_into(scene.metadata)
    world = map_of_problem(scene)
    write_map(world, tmp_path / name)
    again = read_map(tmp_path / name).origin
    assert again is not None
    assert again.geodetic == geodetic
    np.testing.assert_array_equal(again.place, [46.8, -92.0, 198.0])
    assert map_of_problem(circle_scene(4, 30, seed=0)).origin is None
