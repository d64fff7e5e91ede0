"""A reconstruction is told as it is: figures, reasons, files that other programs open, always the same."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from sfm_runs import (
    INTRINSICS,
    NO_MATCH,
    SIZE,
    finished_run,
    gps_outcome,
    run_without_model,
    shared_scene,
    thumbnail,
    without_poses,
)
from sfmcpp.errors import DatasetError
from sfmcpp.map import map_of_problem
from sfmcpp.sfm import ImageOutcome
from sfmcpp.sources.io.colmap.formats import ORIGIN
from sfmcpp.study import SfmReport
from sfmcpp.study.pages.sfm_page import sfm_page
from sfmcpp.study.report_files import UNFINISHED
from sfmcpp.study.report_table import grouped_by_reason
from sfmcpp.study.sfm_measures import ModelMeasures

FILES = ["model", "points.ply", "report.html", "report.json", "timings.json", "transforms.json", "view.html"]
MODEL = [f"{name}.{suffix}" for name in ("cameras", "images", "points3D") for suffix in ("bin", "txt")]


def projected(problem: sfmcpp.Problem) -> np.ndarray:
    """(M, 2) pixels of the points, by a pinhole without distortion."""
    poses = problem.cameras[problem.camera_index]
    seen = problem.points[problem.point_index] - poses[:, :, 3]
    x, y, z = np.einsum("mji,mj->im", poses[:, :, :3], seen)
    f, _, cx, cy, *_ = problem.intrinsics[0]
    return np.stack([f * x / z + cx, f * y / z + cy], axis=1)


def digests(folder: Path) -> dict[str, str]:
    """Digest of every file below a folder but the one that says how long it took."""
    found = {}
    for path in sorted(folder.rglob("*.*")):
        if path.name == "timings.json":
            assert json.loads(path.read_bytes())["seconds"]["total"] > 0
            continue
        found[path.relative_to(folder).as_posix()] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def test_errors_are_those_of_the_observations() -> None:
    run = finished_run()
    scene = shared_scene()
    errors = np.linalg.norm(scene.pixels - projected(scene), axis=1)
    report = SfmReport(run).to_dict()
    assert report["mean_error_px"] == pytest.approx(errors.mean(), rel=1e-9)
    of_points = [errors[scene.point_index == point].mean() for point in range(scene.num_points)]
    assert report["mean_point_error_px"] == pytest.approx(np.mean(of_points), rel=1e-9)
    assert f"{np.mean(of_points):.3f} px of points (COLMAP's mean)" in str(SfmReport(run))
    assert report["rms_px"] == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-9)
    for i, name in enumerate(scene.metadata.image_names):
        mine = scene.camera_index == i
        entry = report["images"][name]
        assert entry["mean_error_px"] == pytest.approx(errors[mine].mean(), rel=1e-9)
        assert entry["observations"] == mine.sum()
        assert entry["keypoints"] == mine.sum() + 3  # and the loose ones
    lengths = np.bincount(scene.point_index)
    assert report["track_lengths"] == {str(n): int(c) for n, c in enumerate(np.bincount(lengths)) if c}
    assert report["mean_track_length"] == pytest.approx(lengths.mean())


def test_every_image_is_named_with_its_reason() -> None:
    run = finished_run(left_out=(2, 5))
    report = SfmReport(run)
    content = report.to_dict()
    assert content["counts"]["registered"] == 6
    assert content["input"] == {"path": "trips/fountain/images", "images": 9, "features": 1224, "pairs": 5}
    lost = content["images"]["set/photo 0002.jpg"]
    assert (lost["registered"], lost["reason"], lost["mean_error_px"]) == (False, NO_MATCH, None)
    broken = content["images"]["broken.jpg"]
    assert (broken["registered"], broken["reason"], broken["keypoints"]) == (
        False,
        "cannot be read: truncated",
        0,
    )
    assert report.left_out() == {
        NO_MATCH: ["set/photo 0002.jpg", "set/photo 0005.jpg"],
        "cannot be read: truncated": ["broken.jpg"],
    }
    assert report.is_partial
    assert report.verdict().startswith(
        "6 of 9 images are in the model (set/photo 0002.jpg, set/photo 0005.jpg: "
    )


def test_reasons_that_differ_in_numbers_or_details_are_one_with_what_they_share() -> None:
    entries = [
        ("9 matches agree, 30 are needed", "a"),
        ("cannot be read: truncated", "b"),
        ("12 matches agree, 30 are needed", "c"),
        ("it matches no other image: at best 3, with x.jpg", "d"),
        ("it matches no other image: at best 3, with y.jpg", "e"),
        ("8 inliers: must be at least 15", "f"),
        ("9 inliers: must be at least 16", "g"),
    ]
    assert grouped_by_reason(entries) == {
        "… matches agree, … are needed": ["a", "c"],
        "it matches no other image": ["d", "e"],
        "… inliers: must be at least …": ["f", "g"],
        "cannot be read: truncated": ["b"],
    }


def test_every_pair_is_told_with_its_reason() -> None:
    pairs = SfmReport(finished_run(left_out=(2,))).to_dict()["pairs"]
    assert len(pairs) == 6
    assert pairs[0] == {
        "first": "set/photo 0000.jpg",
        "second": "set/photo 0001.jpg",
        "matches": 60,
        "inliers": 40,
        "kind": "general",
        "median_angle_deg": 4.0,
        "reason": "",
    }
    assert (pairs[-1]["kind"], pairs[-1]["reason"]) == ("none", "12 matches, 30 are needed")


def test_wrong_positions_are_named() -> None:
    run = finished_run()
    run.gps = gps_outcome(run, outlier=3)
    report = SfmReport(run)
    told = report.to_dict()["gps"]
    assert told["outliers"] == ["set/photo 0003.jpg"]
    assert (told["sigma_m"], told["accuracy_m"]) == (0.6, 0.12)
    assert told["origin"] == {"latitude_deg": 48.2, "longitude_deg": 16.37, "height_m": 180.0}
    assert report.to_dict()["images"]["set/photo 0003.jpg"]["gps_residual_m"] == 20.0
    assert "GPS left out    set/photo 0003.jpg" in report.table()


def test_residuals_of_positions_are_told_by_axis_and_images_without_one() -> None:
    run = finished_run()
    offsets = {"set/photo 0003.jpg": np.full(3, 20.0), "a": np.array([3.0, 0.1, 0.0]), "b": np.zeros(3)}
    known = gps_outcome(run, outlier=3)
    run.gps = replace(known, offsets_m=offsets, without_position=["set/photo 0001.jpg"])
    table = SfmReport(run).table()
    assert "GPS residuals   RMS 2.12, 0.0707, 0 m (east, north, up)\n" in table
    assert "without GPS     set/photo 0001.jpg\n" in table
    assert "Residuals: RMS 2.12, 0.0707, 0 m (east, north, up)." in sfm_page(SfmReport(run))


def test_the_report_is_plain_and_nothing_of_it_depends_on_the_machine() -> None:
    slow, fast = finished_run(), finished_run(seconds={"features": 0.1}, options={"seed": 0, "threads": 1})
    slow.options = {"seed": 0, "threads": 8, "resume": True, "camera": Path("K.txt")}
    fast.options |= {"camera": Path("K.txt")}
    reports = [SfmReport(run) for run in (slow, fast)]
    contents = [report.to_dict() for report in reports]
    assert json.loads(json.dumps(contents[0])) == contents[0]
    assert contents[0]["options"] == {"seed": 0, "camera": "K.txt"}
    assert [report.timings()["seconds"]["total"] for report in reports] == [4.0, 0.1]
    assert contents[0] == contents[1]


def test_the_table_tells_what_a_person_asks_first() -> None:
    run = finished_run(left_out=(2,), warnings=["the scene repeats itself"])
    text = str(SfmReport(run))
    for line in (
        "input           trips/fountain/images",
        "images          7 of 9 in the model",
        f"left out        set/photo 0002.jpg: {NO_MATCH}",
        "pairs           5 of 6 match",
        "seconds         4.0 (features 2.5, matching 1.0, mapping 0.5)",
        "warning         the scene repeats itself",
    ):
        assert line in text
    assert "camera          SIMPLE_RADIAL, focal length 1000.00 px ± " in text


def test_all_files_are_written_and_read_back(tmp_path: Path) -> None:
    run = finished_run(left_out=(2,))
    written = SfmReport(run, thumbnail).write(tmp_path / "new/out")
    assert sorted(path.name for path in written) == FILES
    assert sorted(path.name for path in (tmp_path / "new/out/model").iterdir()) == MODEL
    model = sfmcpp.read(tmp_path / "new/out/model")
    assert model.metadata.image_names == [n for i, n in enumerate(run.models[0].image_names) if i != 2]
    transforms = json.loads((tmp_path / "new/out/transforms.json").read_text())
    assert [frame["file_path"] for frame in transforms["frames"]] == model.metadata.image_names
    assert transforms["ply_file_path"] == "points.ply"


def test_pycolmap_opens_the_model_and_finds_what_is_in_it(tmp_path: Path) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    run = finished_run(left_out=(2,))
    report = SfmReport(run, thumbnail)
    report.write(tmp_path)
    binary = pycolmap.Reconstruction()
    binary.read_binary(str(tmp_path / "model"))
    text = pycolmap.Reconstruction()
    text.read_text(str(tmp_path / "model"))
    world, measures = run.models[0], report.measures[0]
    for model in (binary, text):
        names = sorted(image.name for image in model.images.values())
        kept = [name for i, name in enumerate(world.image_names) if i != 2]
        # COLMAP's reader of text ends a name at its first space.
        assert names == (kept if model is binary else [name.split()[0] for name in kept])
        (camera,) = model.cameras.values()
        assert camera.model_name == "SIMPLE_RADIAL"
        assert (camera.width, camera.height) == SIZE
        np.testing.assert_allclose(camera.params, [1000, 320, 240, 0])
        assert model.num_points3D() == measures.num_points
        assert model.compute_num_observations() == measures.num_observations
        assert model.compute_mean_reprojection_error() == pytest.approx(measures.mean_error_px, rel=1e-6)
    for image in binary.images.values():
        number = world.image_names.index(image.name)
        begin, count = world.keypoint_begin[number], world.keypoint_counts[number]
        pixels = np.array([point.xy for point in image.points2D])
        np.testing.assert_array_equal(pixels, world.keypoints[begin : begin + count])
    for number, point in binary.points3D.items():
        row = int(np.flatnonzero(world.point_ids == number)[0])
        np.testing.assert_array_equal(point.color, world.point_colors[row])
        np.testing.assert_array_equal(point.xyz, world.points[row])


@pytest.mark.parametrize(
    ("free", "values", "name"),
    [
        (("f",), {}, "SIMPLE_PINHOLE"),
        (("f", "aspect"), {}, "PINHOLE"),
        (("f", "k1"), {}, "SIMPLE_RADIAL"),
        ((), {"k1": 0.01}, "SIMPLE_RADIAL"),
        (("f", "k1"), {"k2": -0.02}, "RADIAL"),
        (("f", "p1", "p2"), {}, "OPENCV"),
    ],
)
def test_the_camera_model_is_the_smallest_that_holds_what_was_refined(
    tmp_path: Path, free: tuple[str, ...], values: dict[str, float], name: str
) -> None:
    world = finished_run().models[0]
    world.fixed_intrinsics[:] = [intrinsic not in free for intrinsic in INTRINSICS]
    for intrinsic, value in values.items():
        world.intrinsics[:, INTRINSICS.index(intrinsic)] = value
    report = SfmReport(finished_run(models=[world]), thumbnail)
    report.write(tmp_path)
    lines = [line for line in (tmp_path / "model/cameras.txt").read_text().splitlines() if line[0] != "#"]
    assert [line.split()[1] for line in lines] == [name]
    (camera,) = report.to_dict()["cameras"]
    assert camera["model"] == name
    assert camera["distortion"] == values
    assert camera["refined"] == [intrinsic for intrinsic in INTRINSICS if intrinsic in free]


def test_points_stand_alone_in_their_file(tmp_path: Path) -> None:
    run = finished_run()
    SfmReport(run, thumbnail).write(tmp_path)
    header = (tmp_path / "points.ply").read_bytes().split(b"end_header")[0]
    assert f"element vertex {run.problem().num_points}\n".encode() in header


def test_the_origin_of_a_page_is_in_the_frame_of_the_positions(tmp_path: Path) -> None:
    run = finished_run()
    run.gps = replace(
        gps_outcome(run, outlier=3), origin=np.array([691_000.0, 5_334_000.0, 0.0]), geodetic=False
    )
    SfmReport(run, thumbnail).write(tmp_path)
    assert "with the origin at x_m 691000, y_m 5334000, z_m 0" in (tmp_path / "report.html").read_text()


def test_the_same_run_gives_the_same_files(tmp_path: Path) -> None:
    for folder, threads in (("a", 1), ("b", 2)):
        run = finished_run(left_out=(2,), options={"seed": 0, "threads": threads})
        run.seconds["features"] = float(threads)
        run.gps = gps_outcome(run, outlier=3)
        SfmReport(run, thumbnail).write(tmp_path / folder)
    assert digests(tmp_path / "a") == digests(tmp_path / "b")
    assert len(digests(tmp_path / "a")) == len(FILES) - 2 + len([*MODEL, ORIGIN])


def test_one_file_that_fails_keeps_no_other_from_being_written(tmp_path: Path) -> None:
    (tmp_path / "points.ply").mkdir()
    with pytest.raises(DatasetError, match=r"points.ply: is a directory"):
        SfmReport(finished_run(), thumbnail).write(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([UNFINISHED, *FILES])
    assert "8 of 9 images are in the model" in (tmp_path / "report.html").read_text()
    assert not list(tmp_path.rglob("*.tmp"))


def test_without_a_model_the_report_and_its_page_say_why(tmp_path: Path) -> None:
    report = SfmReport(run_without_model(), thumbnail)
    assert [path.name for path in report.write(tmp_path)] == ["report.json", "timings.json", "report.html"]
    assert report.verdict().startswith("no model: none of 4 images could be registered (set/photo 0000.jpg")
    content = json.loads((tmp_path / "report.json").read_text())
    assert (content["models"], content["cameras"], content["mean_error_px"]) == ([], [], None)
    assert NO_MATCH in (tmp_path / "report.html").read_text()


def test_further_models_are_written_beside_the_largest(tmp_path: Path) -> None:
    run = finished_run(left_out=(0, 1, 2))
    run.models.append(without_poses(map_of_problem(shared_scene()), [3, 4, 5, 6, 7]))
    run.images.update({name: ImageOutcome(True, 1) for name in run.models[0].image_names[:3]})
    report = SfmReport(run, thumbnail)
    report.write(tmp_path)
    assert sfmcpp.read(tmp_path / "model").num_cameras == 5
    other = sfmcpp.read(tmp_path / "model_1")
    assert other.metadata.image_names == run.models[0].image_names[:3]
    content = report.to_dict()
    assert [model["images"] for model in content["models"]] == [5, 3]
    assert content["images"]["set/photo 0000.jpg"]["observations"] > 0
    assert "in model 1, which is not connected to the largest" in report.left_out()
    assert report.is_partial


def test_further_models_of_an_earlier_run_do_not_stay_and_nothing_else_is_removed(tmp_path: Path) -> None:
    several = finished_run()
    several.models += [without_poses(map_of_problem(shared_scene()), [0, 1, 2]) for _ in range(3)]
    SfmReport(several, thumbnail).write(tmp_path)
    (tmp_path / "model_3/mine.txt").touch()
    (tmp_path / "model_7").mkdir()
    two = finished_run()
    two.models.append(several.models[1])
    SfmReport(two, thumbnail).write(tmp_path)
    names = {path.name for path in tmp_path.iterdir() if path.is_dir()}
    assert names == {"model", "model_1", "model_3", "model_7"}
    assert [path.name for path in (tmp_path / "model_3").iterdir()] == ["mine.txt"]
    SfmReport(run_without_model(), thumbnail).write(tmp_path)
    assert sfmcpp.read(tmp_path / "model").num_cameras == 8  # the last that was found


def test_a_model_of_tracks_alone_is_written_too(tmp_path: Path) -> None:
    run = finished_run()
    run.models[0].camera_sizes[:] = 0
    run.models[0].point_colors[:] = 0
    report = SfmReport(run)
    assert sorted(path.name for path in report.write(tmp_path)) == FILES
    assert "Mean residuals of camera 1" in (tmp_path / "report.html").read_text()
    largest = np.ceil(run.models[0].keypoints[run.models[0].keypoint_points >= 0].max(axis=0))
    width, height = sfmcpp.read(tmp_path / "model").metadata.image_sizes[0]
    assert (width, height) == tuple(largest)


def test_a_systematic_residual_shows_where_it_is() -> None:
    scene = shared_scene(12, 400, sigma_px=0.0)
    left_top = (scene.pixels < (320, 240)).all(axis=1)
    scene.pixels[left_top] += (0.25, -0.5)
    found = ModelMeasures(map_of_problem(scene)).residual_map([0], columns=4)
    assert found is not None
    assert found.counts.shape == (3, 4)
    assert found.counts.sum() == scene.num_observations
    np.testing.assert_allclose(found.means[0, :2], [[0.25, -0.5]] * 2, atol=1e-9)
    assert np.nanmax(np.abs(found.means[2, :])) < 1e-9
    assert np.nanmax(np.abs(found.means[:, 2:])) < 0.01  # a shifted pixel may cross into the next cell


def test_the_sigma_of_the_focal_length_grows_with_the_noise() -> None:
    found = []
    for sigma in (0.2, 0.8):
        scene = shared_scene(10, 200, sigma_px=sigma)
        sfmcpp.solve(scene)
        sigmas = ModelMeasures(map_of_problem(scene)).sigmas[0]
        assert set(sigmas) == {"f", "k1"}
        assert abs(scene.intrinsics[0, 0] - 1000.0) < 5 * sigmas["f"]
        found.append(sigmas["f"])
    assert found[1] / found[0] == pytest.approx(4.0, rel=0.05)


def test_thumbnails_that_cannot_be_made_are_left_out(tmp_path: Path) -> None:
    SfmReport(finished_run(), lambda photo: None).write(tmp_path / "none")
    SfmReport(finished_run(), thumbnail).write(tmp_path / "all")
    pages = [(tmp_path / folder / "view.html").read_text() for folder in ("none", "all")]
    assert [page.count("data:image/jpeg;base64,") for page in pages] == [0, 8]


def test_a_run_is_shown_in_one_line_with_its_models() -> None:
    """Notebooks show what a cell ends with, and a run holds every keypoint of every image."""
    run = finished_run()
    assert run.model is not None
    assert repr(run) == f"SfmRun({run.source!r}: {len(run.images)} images, {run.model!r})"
    run.models.clear()
    assert repr(run).endswith("images, no model)")
