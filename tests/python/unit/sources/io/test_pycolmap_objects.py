"""Reconstructions of pycolmap in memory: taken over, solved, handed back."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import sfmcpp
from io_helpers import assert_same_problem
from sfmcpp.cli.console import ExitCode
from sfmcpp.cli.main import main
from sfmcpp.map.files import read_map

pycolmap = pytest.importorskip("pycolmap")


def scene() -> sfmcpp.Problem:
    return sfmcpp.perturb(sfmcpp.circle_scene(6, 40, seed=1), point_sigma_m=0.1, seed=2)


def reconstruction(cameras_per_rig: int = 1) -> Any:
    """Six images of pycolmap's own synthetic scene."""
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig = 1, cameras_per_rig
    options.num_frames_per_rig = 6 // cameras_per_rig
    options.num_points3D, options.camera_model_id = 50, pycolmap.CameraModelId.SIMPLE_RADIAL
    options.camera_params = [1280.0, 512.0, 384.0, 0.01]
    pycolmap.set_random_seed(1)
    return pycolmap.synthesize_dataset(options)


def test_a_problem_comes_back_as_it_was() -> None:
    once = sfmcpp.from_pycolmap(sfmcpp.to_pycolmap(scene()))
    again = sfmcpp.from_pycolmap(sfmcpp.to_pycolmap(once))
    np.testing.assert_allclose(once.points, scene().points, rtol=0, atol=0)
    assert_same_problem(again, once, intrinsics_rtol=4e-16)


def test_residuals_are_those_that_pycolmap_computes() -> None:
    model = reconstruction()
    problem = sfmcpp.from_pycolmap(model)
    assert (problem.num_cameras, problem.num_points) == (model.num_images(), model.num_points3D())
    theirs = model.compute_mean_reprojection_error()
    # pycolmap's synthetic keypoints are exact to single precision.
    assert theirs == pytest.approx(np.linalg.norm(sfmcpp.residuals(problem), axis=1).mean(), abs=1e-3)


def test_errors_of_points_are_those_of_the_solved_state() -> None:
    problem = scene()
    before = sfmcpp.to_pycolmap(problem)
    sfmcpp.solve(problem)
    after = sfmcpp.to_pycolmap(problem)
    written = np.array([after.points3D[i].error for i in sorted(after.points3D)])
    after.update_point_3d_errors()
    theirs = np.array([after.points3D[i].error for i in sorted(after.points3D)])
    np.testing.assert_allclose(written, theirs, rtol=1e-9)
    assert written.mean() < 0.5 * np.mean([p.error for p in before.points3D.values()])


def test_names_and_identifiers_are_kept() -> None:
    model = reconstruction()
    again = sfmcpp.to_pycolmap(sfmcpp.from_pycolmap(model))
    assert {i: image.name for i, image in again.images.items()} == {
        i: image.name for i, image in model.images.items()
    }
    assert sorted(again.points3D) == sorted(model.points3D)


def tracks_of(model: Any) -> dict[int, set[tuple[int, int]]]:
    return {
        i: {(e.image_id, e.point2D_idx) for e in point.track.elements} for i, point in model.points3D.items()
    }


def with_second_sightings(model: Any, points: int) -> Any:
    """The model whose first points are each seen once more, by a free keypoint of their first image."""
    for point_id in sorted(model.points3D)[:points]:
        seen = model.points3D[point_id].track.elements[0]
        keypoints = model.images[seen.image_id].points2D
        free = next(i for i, keypoint in enumerate(keypoints) if not keypoint.has_point3D())
        model.add_observation(point_id, pycolmap.TrackElement(seen.image_id, free))
    return model


def test_second_sightings_of_a_point_count_once_and_are_put_back() -> None:
    model = with_second_sightings(reconstruction(), 7)
    problem = sfmcpp.from_pycolmap(model)
    assert problem.num_observations == model.compute_num_observations() - 7
    again = sfmcpp.to_pycolmap(problem)
    assert tracks_of(again) == tracks_of(model)
    for image_id, image in model.images.items():
        pixels = [[p.xy for p in of.points2D] for of in (image, again.images[image_id])]
        np.testing.assert_array_equal(*pixels)
    written = [again.points3D[i].error for i in sorted(again.points3D)]
    again.update_point_3d_errors()
    np.testing.assert_allclose(written, [again.points3D[i].error for i in sorted(again.points3D)], atol=1e-9)


def test_a_second_sighting_goes_with_the_point() -> None:
    model = with_second_sightings(reconstruction(), 2)
    problem = sfmcpp.from_pycolmap(model)
    gone = problem.metadata.extra["colmap_point_ids"][0]
    kept = problem.point_index > 0
    again = sfmcpp.to_pycolmap(problem.with_observations(kept))
    expected = tracks_of(model) | {int(gone): set()}
    assert tracks_of(again) == expected


def test_images_without_a_pose_are_named() -> None:
    model = reconstruction()
    model.deregister_frame(model.images[3].frame_id)
    problem = sfmcpp.from_pycolmap(model)
    assert problem.num_cameras == 5
    assert problem.metadata.extra["unregistered_images"] == [model.images[3].name]
    assert "unregistered_images" not in sfmcpp.from_pycolmap(reconstruction()).metadata.extra


def test_images_of_older_pycolmap_are_registered_instead_of_having_a_pose() -> None:
    model = reconstruction()
    images = {
        key: SimpleNamespace(name=image.name, registered=key != 3) for key, image in model.images.items()
    }
    older = SimpleNamespace(write_binary=model.write_binary, images=images)
    problem = sfmcpp.from_pycolmap(older)
    assert problem.metadata.extra["unregistered_images"] == [model.images[3].name]


def test_rigs_are_solved_as_pycolmap_solves_them() -> None:
    problem = sfmcpp.from_pycolmap(reconstruction(cameras_per_rig=3))
    assert problem.rigs is not None
    assert (problem.rigs.num_frames, problem.rigs.num_sensors) == (2, 3)
    start = sfmcpp.perturb(
        problem, point_sigma_m=0.02, position_sigma_m=0.02, rotation_sigma_deg=0.2, seed=1
    ).set_free_intrinsics()
    start.pixels += np.random.default_rng(2).standard_normal(start.pixels.shape)
    model = sfmcpp.to_pycolmap(start)
    summary = sfmcpp.solve(start, function_tolerance=1e-12)
    theirs = adjusted_by_pycolmap(model)
    assert summary.initial_cost == pytest.approx(theirs.initial_cost, rel=1e-9)
    assert summary.final_cost == pytest.approx(theirs.final_cost, rel=1e-9)
    again = sfmcpp.from_pycolmap(model)
    assert sfmcpp.cost(again) == pytest.approx(summary.final_cost, rel=1e-9)


def test_free_sensors_are_found_where_pycolmap_finds_them() -> None:
    problem = sfmcpp.from_pycolmap(reconstruction(cameras_per_rig=3))
    start = sfmcpp.perturb(
        problem, point_sigma_m=0.02, position_sigma_m=0.02, rotation_sigma_deg=0.2, seed=1
    ).set_free_intrinsics()
    start.pixels += np.random.default_rng(2).standard_normal(start.pixels.shape)
    assert start.rigs is not None
    start.rigs = start.rigs.freed()
    model = sfmcpp.to_pycolmap(start)
    summary = sfmcpp.solve(start, function_tolerance=1e-13)
    theirs = adjusted_by_pycolmap(model, sensors=True)
    assert summary.initial_cost == pytest.approx(theirs.initial_cost, rel=1e-9)
    assert summary.final_cost == pytest.approx(theirs.final_cost, rel=1e-8)
    found = sfmcpp.from_pycolmap(model).rigs
    assert found is not None
    np.testing.assert_allclose(start.rigs.sensors[:, :, :3], found.sensors[:, :, :3], atol=1e-5)
    ours, other = (np.linalg.norm(rigs.sensors[1:, :, 3], axis=1) for rigs in (start.rigs, found))
    assert ours[0] / ours[1] == pytest.approx(other[0] / other[1], rel=1e-4)


def adjusted_by_pycolmap(model: Any, sensors: bool = False) -> Any:
    """Ceres' summary of pycolmap's own adjustment of frames and points, of sensors too if told."""
    config = pycolmap.BundleAdjustmentConfig()
    for image in model.images:
        config.add_image(image)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.UNSPECIFIED)
    config.set_constant_rig_from_world_pose(min(model.frames))
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_extra_params = False
    options.refine_sensor_from_rig = sensors
    options.print_summary = False
    options.ceres.solver_options.max_num_iterations = 100
    options.ceres.solver_options.function_tolerance = 1e-14
    return pycolmap.create_default_bundle_adjuster(options, config, model).solve().ceres_summary


def test_rigs_and_frames_come_back_as_they_were() -> None:
    model = reconstruction(cameras_per_rig=2)
    again = sfmcpp.to_pycolmap(sfmcpp.from_pycolmap(model))
    assert sorted(again.frames) == sorted(model.frames)
    for number, frame in model.frames.items():
        other = again.frames[number]
        np.testing.assert_allclose(
            other.rig_from_world.matrix(), frame.rig_from_world.matrix(), rtol=0, atol=1e-12
        )
        assert {(d.sensor_id.id, d.id) for d in other.data_ids} == {
            (d.sensor_id.id, d.id) for d in frame.data_ids
        }
    for number, rig in model.rigs.items():
        assert again.rigs[number].ref_sensor_id == rig.ref_sensor_id
        for sensor, pose in rig.non_ref_sensors.items():
            found = again.rigs[number].sensor_from_rig(sensor)
            np.testing.assert_allclose(found.matrix(), pose.matrix(), rtol=0, atol=1e-12)


def test_rigs_of_any_problem_become_those_of_pycolmap() -> None:
    scene = sfmcpp.rig_walk_scene(12, 300, camera_model="perspective", seed=1)
    model = sfmcpp.to_pycolmap(scene)
    assert (model.num_rigs(), model.num_frames(), model.num_images()) == (1, 4, 12)
    again = sfmcpp.from_pycolmap(model)
    np.testing.assert_allclose(again.cameras, scene.cameras, rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", ["write_text", "write_binary"])
def test_rigs_in_files_are_read_and_a_map_of_them_is_refused(tmp_path: Path, kind: str) -> None:
    model = reconstruction(cameras_per_rig=2)
    getattr(model, kind)(str(tmp_path))
    assert_same_problem(sfmcpp.read(tmp_path), sfmcpp.from_pycolmap(model), intrinsics_rtol=4e-16)
    with pytest.raises(sfmcpp.DatasetError, match="has rigs: the images of a map move by themselves"):
        read_map(tmp_path)


@pytest.mark.parametrize("format", ["colmap-text", "colmap-binary"])
def test_rigs_are_the_same_after_reading_and_writing(tmp_path: Path, format: str) -> None:
    once = sfmcpp.from_pycolmap(reconstruction(cameras_per_rig=3))
    sfmcpp.write(once, tmp_path / "model", format=format)
    again = sfmcpp.read(tmp_path / "model", format=format)
    assert_same_problem(again, once, intrinsics_rtol=4e-16)
    assert again.rigs is not None
    assert once.rigs is not None
    np.testing.assert_array_equal(again.rigs.frame_of_camera, once.rigs.frame_of_camera)
    np.testing.assert_array_equal(again.rigs.sensor_of_camera, once.rigs.sensor_of_camera)
    np.testing.assert_allclose(again.rigs.sensors, once.rigs.sensors, rtol=0, atol=1e-14)


def test_a_model_solved_by_the_command_line_has_errors_of_its_solved_state(tmp_path: Path) -> None:
    start, solved = tmp_path / "start", tmp_path / "solved"
    sfmcpp.write(scene(), start)
    assert main(["solve", str(start), "-o", str(solved), "--quiet"]) == ExitCode.DONE
    model = pycolmap.Reconstruction(str(solved))
    written = [model.points3D[i].error for i in sorted(model.points3D)]
    model.update_point_3d_errors()
    np.testing.assert_allclose(written, [model.points3D[i].error for i in sorted(model.points3D)], rtol=1e-9)
    assert np.mean(written) < 0.5 * pycolmap.Reconstruction(str(start)).compute_mean_reprojection_error()


def test_principal_points_lie_in_the_middle_by_way_of_bundlers_files(tmp_path: Path) -> None:
    """Which count pixels from there: what COLMAP projects misses them by the same pixels before and after."""
    model = reconstruction()
    sfmcpp.write(sfmcpp.from_pycolmap(model), tmp_path / "a.out")
    again = sfmcpp.to_pycolmap(sfmcpp.read(tmp_path / "a.out"))
    for camera in again.cameras.values():
        assert (2 * camera.principal_point_x, 2 * camera.principal_point_y) == (camera.width, camera.height)
    for image in again.images.values():
        pixels, camera = np.array([p.xy for p in image.points2D]), again.cameras[image.camera_id]
        assert ((pixels >= 0) & (pixels <= [camera.width, camera.height])).all()
    again.update_point_3d_errors()
    model.update_point_3d_errors()
    errors = [sorted(p.error for p in m.points3D.values()) for m in (model, again)]
    np.testing.assert_allclose(errors[1], errors[0], rtol=0, atol=1e-9)


def test_cameras_of_bundler_that_are_not_registered_are_no_images_of_colmap(tmp_path: Path) -> None:
    problem = sfmcpp.circle_scene(3, 12, camera_model="bal", seed=0)
    sfmcpp.write(problem, tmp_path / "a.out")
    lines = (tmp_path / "a.out").read_text().splitlines()
    lines[1] = "4 12"
    lines[2:2] = ["0 0 0"] * 5  # the first camera of the file; those behind it move by one
    moved = [re.sub(r" (\d+) (\d+) (\S+) (\S+)", lambda m: f" {int(m[1]) + 1} {m[2]} {m[3]} {m[4]}", line)
             for line in lines[24::3]]  # fmt: skip
    lines[24::3] = moved
    (tmp_path / "a.out").write_text("\n".join(lines) + "\n")
    model = sfmcpp.to_pycolmap(sfmcpp.read(tmp_path / "a.out"))
    assert sorted(image.name for image in model.images.values()) == [f"image_{i:06d}" for i in (2, 3, 4)]
    assert all(camera.focal_length > 0 and camera.width > 1 for camera in model.cameras.values())
    expected = sfmcpp.to_pycolmap(problem).compute_mean_reprojection_error()
    assert model.compute_mean_reprojection_error() == pytest.approx(expected, rel=1e-9)


def test_anything_else_is_refused_by_name() -> None:
    with pytest.raises(
        sfmcpp.InvalidArgument, match=r"reconstruction is a str, must be a pycolmap\.Reconstr"
    ):
        sfmcpp.from_pycolmap("sparse/0")


def test_reconstructions_that_are_half_built_are_refused() -> None:
    half_built = reconstruction()
    half_built.frames[min(half_built.frames)].rig_from_world = None
    for made in (half_built, pycolmap.Reconstruction):
        with pytest.raises(sfmcpp.InvalidArgument, match=r"^reconstruction: pycolmap cannot write it: "):
            sfmcpp.from_pycolmap(made)


def test_a_sensor_without_a_pose_is_named() -> None:
    model = reconstruction(cameras_per_rig=3)
    rig = model.rigs[min(model.rigs)]
    rig.reset_sensor_from_rig(max(rig.non_ref_sensors, key=lambda sensor: sensor.id))
    with pytest.raises(sfmcpp.InvalidArgument, match=r"^reconstruction: rig 1: the pose of camera 3 in the"):
        sfmcpp.from_pycolmap(model)


def test_cameras_that_colmap_has_not_are_refused_by_name() -> None:
    problem = scene()
    with pytest.raises(sfmcpp.InvalidArgument, match=r"^problem: no camera of COLMAP .* 'projective'"):
        sfmcpp.to_pycolmap(sfmcpp.as_projective(problem))
    model = sfmcpp.CameraFunction(lambda points, rows: points[:, :2], problem.intrinsic_names, name="own")
    arrays = (problem.cameras, problem.intrinsics, problem.points)
    seen = (problem.camera_index, problem.point_index, problem.pixels)
    own = sfmcpp.Problem(model, *arrays, *seen, intrinsics_index=problem.intrinsics_index)
    with pytest.raises(sfmcpp.InvalidArgument, match="'own'"):
        sfmcpp.to_pycolmap(own)


def test_what_no_file_of_colmap_can_hold_is_refused_by_name() -> None:
    problem = scene()
    problem.points[3, 1] = np.nan
    with pytest.raises(sfmcpp.InvalidArgument, match=r"^problem: .*points\[3"):
        sfmcpp.to_pycolmap(problem)


def test_metadata_that_do_not_fit_are_named() -> None:
    problem = sfmcpp.circle_scene(4, 30, camera_model="perspective", seed=0)
    problem.metadata.extra["colmap_point_ids"] = np.arange(1, 30)
    with pytest.raises(
        sfmcpp.InvalidArgument, match=r"^problem: metadata colmap_point_ids has 29 entries: must be 30"
    ):
        sfmcpp.to_pycolmap(problem)
