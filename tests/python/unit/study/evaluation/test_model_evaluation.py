"""Models measured against the truth: errors that were put in come out, whatever world the model is in."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import sfmcpp
from model_helpers import AWAY, moved, named, true_poses
from sfmcpp import DatasetError, InvalidArgument, Metadata, Problem
from sfmcpp.geometry.so3 import exp
from sfmcpp.map import Map, map_of_problem
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sensors import east_north_up, geodetic_of
from sfmcpp.study.evaluation import ImagePoses, evaluate_model, read_image_poses, read_truth


def problem_of(images: ImagePoses) -> Problem:
    count = len(images)
    none = np.empty(0, dtype=np.int32)
    lens = [[1000.0, 1, 320, 240, 0, 0, 0, 0, 0, 0, 0, 0]] * count
    data = Metadata(image_names=list(images.names))
    return Problem(
        "perspective", images.poses, lens, np.empty((0, 3)), none, none, np.empty((0, 2)), metadata=data
    )


def test_a_perfect_model_in_another_world_has_no_errors() -> None:
    truth = named(true_poses())
    found = evaluate_model(moved(truth), truth)
    assert found.names == truth.names
    assert found.alignment.similarity.scale == pytest.approx(4.0)
    assert found.centre_errors.max() < 1e-12
    assert found.rotation_errors_deg.max() < 1e-5
    assert [found.auc(t) for t in (1, 3, 5, 10)] == pytest.approx([1, 1, 1, 1], abs=1e-5)
    assert (found.missing, found.unknown, found.outliers, found.note) == ((), (), (), "")


def test_displacements_without_alignment_are_the_errors() -> None:
    truth = named(true_poses())
    poses = truth.poses.copy()
    poses[2, :, 3] += [0.3, 0, 0.4]
    poses[4, :, :3] = poses[4, :, :3] @ exp(np.deg2rad([0, 2.0, 0]))
    found = evaluate_model(named(poses), truth, align_to="none")
    assert found.centre_errors == pytest.approx([0, 0, 0.5, 0, 0, 0, 0, 0, 0])
    assert found.rotation_errors_deg == pytest.approx([0, 0, 0, 0, 2, 0, 0, 0, 0], abs=1e-6)
    content = found.to_dict()
    assert content["centre_error"]["mean"] == pytest.approx(0.5 / 9)
    assert content["centre_error"]["median"] == 0
    assert content["centre_error"]["max"] == pytest.approx(0.5)
    assert content["rotation_error_deg"]["max"] == pytest.approx(2)
    assert content["per_image"]["0002.jpg"]["centre_error"] == pytest.approx(0.5)
    assert content["alignment"]["pairs"] == 0
    json.dumps(content, allow_nan=False)


def test_a_truth_that_is_of_another_scene_or_with_other_axes_is_doubted() -> None:
    truth = named(true_poses())
    poses = truth.poses.copy()
    poses[:4, :, 1:3] *= -1  # OpenGL's axes, of less than half
    assert evaluate_model(named(poses), truth).warning == ""
    poses[4:, :, 1:3] *= -1
    found = evaluate_model(named(poses), truth)
    assert "half of the images are turned by more than 90°: are both of the same scene" in found.warning
    assert found.to_dict()["warning"] == found.warning


def test_errors_are_in_the_truths_unit() -> None:
    truth = named(true_poses())
    poses = truth.poses.copy()
    poses[:, :, 3] += np.random.default_rng(3).normal(0, 0.01, (9, 3))
    noisy = ImagePoses(truth.names, AWAY.apply_to_poses(poses))
    found = evaluate_model(noisy, truth)
    # A similarity takes 7 of the 27 degrees of freedom of the noise.
    expected = 0.01 * np.sqrt(3 * (27 - 7) / 27)
    assert found.to_dict()["centre_error"]["rmse"] == pytest.approx(expected, rel=0.3)


def test_missing_images_count_as_failures_of_all_their_pairs() -> None:
    truth = named(true_poses(9))
    found = evaluate_model(moved(truth, [0, 1, 3, 4, 5, 8]), truth)
    assert found.missing == ("0002.jpg", "0006.jpg", "0007.jpg")
    assert found.num_images == 9
    assert len(found.relative_errors_deg) == 36
    assert np.isinf(found.relative_errors_deg).sum() == 36 - 15
    assert found.auc(10) == pytest.approx(15 / 36, abs=1e-5)


def test_images_that_the_truth_does_not_have_are_named_and_count_for_nothing() -> None:
    truth = named(true_poses(9))
    short = ImagePoses(truth.names[:6], truth.poses[:6])
    found = evaluate_model(moved(truth), short)
    assert found.unknown == ("0006.jpg", "0007.jpg", "0008.jpg")
    assert found.auc(1) == pytest.approx(1, abs=1e-4)
    assert found.to_dict()["images"]["not_in_truth"] == list(found.unknown)


def test_relative_errors_do_not_feel_the_alignment() -> None:
    truth = named(true_poses())
    poses = truth.poses.copy()
    poses[3, :, 3] += 2.0
    ours = named(poses)
    far, near = (evaluate_model(ours, truth, align_to=rule) for rule in ("none", "all"))
    np.testing.assert_allclose(far.relative_errors_deg, near.relative_errors_deg, atol=1e-5)
    assert far.relative_errors_deg.max() > 5


def test_a_robust_alignment_names_the_outliers_and_leaves_the_others_exact() -> None:
    truth = named(true_poses(12))
    poses = truth.poses.copy()
    poses[[1, 5, 6, 9], :, 3] += np.array([[9.0, 0, 0], [0, -7, 0], [0, 0, 30], [3, 3, 3]])
    ours = ImagePoses(truth.names, AWAY.apply_to_poses(poses))
    found = evaluate_model(ours, truth, align_to="robust")
    assert found.outliers == ("0001.jpg", "0005.jpg", "0006.jpg", "0009.jpg")
    good = [row for row in range(12) if row not in (1, 5, 6, 9)]
    assert found.centre_errors[good].max() < 1e-9
    assert found.centre_errors[6] == pytest.approx(30)
    assert found.alignment.count == 8
    assert evaluate_model(ours, truth).centre_errors[good].max() > 0.5


def test_a_robust_alignment_keeps_all_of_a_clean_model() -> None:
    truth = named(true_poses(30))
    poses = truth.poses.copy()
    poses[:, :, 3] += np.random.default_rng(3).uniform(-0.01, 0.01, (30, 3))
    assert evaluate_model(named(poses), truth, align_to="robust").outliers == ()


@pytest.mark.parametrize("by", ["positions", "poses"])
def test_the_alignment_can_keep_the_scale(by: str) -> None:
    truth = named(true_poses())
    ours = named(truth.poses * np.array([1, 1, 1, 2.0]))
    found = evaluate_model(ours, truth, with_scale=False, align_by=by)
    assert found.alignment.similarity.scale == 1
    assert found.centre_errors.max() > 1


def test_poses_align_two_images_and_a_line_where_positions_cannot() -> None:
    truth = named(true_poses(2))
    with pytest.raises(
        InvalidArgument, match="the 2 images in both do not determine an alignment by positions"
    ):
        evaluate_model(moved(truth), truth)
    assert evaluate_model(moved(truth), truth, align_by="poses").centre_errors.max() < 1e-12
    poses = true_poses(5)
    poses[:, :, 3] = np.arange(5)[:, None] * [1.0, 2, 3]
    line = named(poses)
    with pytest.raises(InvalidArgument, match="poses hold on a line"):
        evaluate_model(moved(line), line)
    assert evaluate_model(moved(line), line, align_by="poses").rotation_errors_deg.max() < 1e-5


def test_no_common_image_is_told_with_some_of_both_sides() -> None:
    truth = named(true_poses())
    with pytest.raises(InvalidArgument) as caught:
        evaluate_model(named(true_poses(), "img_{}.png"), truth)
    for shown in ("'img_0.png'", "'0000.jpg'", "and 6 more"):
        assert shown in str(caught.value)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"align_to": "first:3"}, "must be one of all, robust, none"),
        ({"align_by": "names"}, "must be one of positions, poses"),
        ({"max_difference_s": -1.0}, "must be finite and not negative"),
        ({"max_difference_s": 0.5}, "max_difference_s = 0.5: the truth has no times"),
    ],
)
def test_options_are_checked(options: dict[str, object], told: str) -> None:
    truth = named(true_poses())
    with pytest.raises(InvalidArgument, match=told):
        evaluate_model(truth, truth, **options)


def test_a_model_can_be_a_problem_a_map_a_file_or_a_folder(tmp_path: Path) -> None:
    truth = named(true_poses())
    ours = problem_of(moved(truth))
    sfmcpp.write(ours, tmp_path / "model.npz")
    sfmcpp.write(ours, tmp_path / "model")
    (tmp_path / "run").mkdir()
    sfmcpp.write(ours, tmp_path / "run/model")
    world = Map("perspective")
    cameras = world.add_cameras(ours.intrinsics[:1])
    poses = ours.cameras.copy()
    poses[4] = np.nan
    world.add_images(
        list(truth.names), np.repeat(cameras, 9), np.zeros(9, np.int64), np.empty((0, 2)), poses=poses
    )
    paths = [tmp_path / "model.npz", tmp_path / "model", str(tmp_path / "run")]
    for model in (ours, *paths):
        assert evaluate_model(model, truth).centre_errors.max() < 1e-9
    assert evaluate_model(world, problem_of(truth)).missing == ("0004.jpg",)


def test_paths_of_truths_are_told_apart(tmp_path: Path) -> None:
    truth = named(true_poses())
    sfmcpp.write(problem_of(truth), tmp_path / "truth")
    assert isinstance(read_truth(tmp_path / "truth"), ImagePoses)
    rows = [" ".join(map(repr, pose.ravel().tolist())) for pose in truth.poses]
    (tmp_path / "poses.txt").write_text("\n".join(rows))
    found = evaluate_model(moved(truth), tmp_path / "poses.txt")
    assert (found.matched_by, len(found.names)) == ("order", 9)
    assert found.centre_errors.max() < 1e-9


def test_what_is_no_model_is_told(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="is a folder without a model"):
        read_image_poses(tmp_path)
    (tmp_path / "trajectory.txt").write_text("0 0 0 0 0 0 0 1\n")
    with pytest.raises(DatasetError, match=r"evaluate .*trajectory.txt instead"):
        read_image_poses(tmp_path)
    nameless = problem_of(named(true_poses()))
    nameless.metadata.image_names = []
    sfmcpp.write(nameless, tmp_path / "model.npz")
    with pytest.raises(DatasetError, match=r"model.npz: model: names 0 of 9 images, must name all"):
        read_image_poses(tmp_path / "model.npz")
    with pytest.raises(InvalidArgument, match="occurs twice"):
        ImagePoses(("a", "a"), true_poses(2))


def test_the_report_of_a_reconstruction_tells_which_images_could_have_been_registered(tmp_path: Path) -> None:
    """Of a drive of 9 frames, 6 were given and 5 registered: one is missing, not four."""
    truth = named(true_poses(9), "{:010d}.png")
    sfmcpp.write(problem_of(moved(truth, [2, 3, 4, 6, 7])), tmp_path / "model")
    images = {truth.names[row]: {"registered": row != 5, "reason": ""} for row in range(2, 8)}
    (tmp_path / "report.json").write_text(json.dumps({"images": images}))
    rows = [" ".join(map(repr, pose.ravel().tolist())) for pose in truth.poses]
    (tmp_path / "poses.txt").write_text("\n".join(rows))
    found = evaluate_model(tmp_path, tmp_path / "poses.txt")
    assert found.missing == ("0000000005.png",)
    assert found.centre_errors.max() < 1e-9
    (tmp_path / "report.json").unlink()
    assert len(evaluate_model(tmp_path, tmp_path / "poses.txt").missing) == 4


@pytest.mark.real
def test_strechas_truth_agrees_with_itself_as_a_colmap_model(data_dir: Path, tmp_path: Path) -> None:
    truth = data_dir / "fountain_p11/gt_dense_cameras"
    sfmcpp.write(sfmcpp.read(truth), tmp_path / "model")
    found = evaluate_model(tmp_path / "model", truth)
    assert (len(found.names), found.missing) == (11, ())
    assert found.centre_errors.max() < 1e-9
    assert found.auc(1) == pytest.approx(1, abs=1e-5)


def test_without_alignment_the_origins_of_both_worlds_count() -> None:
    site = [46.8, -92.0, 198.0]
    poses = true_poses()
    places = geodetic_of(poses[:, :, 3], site)
    for origin in ([46.81, -92.02, 150.0], [46.8, -91.9999, 198.0], site):
        centres = east_north_up(places, origin)
        # The axes of the other world, from three places a metre apart.
        steps = geodetic_of(np.concatenate([np.zeros((1, 3)), np.eye(3)]), site)
        axes = np.diff(east_north_up(steps, origin)[[0, 1, 0, 2, 0, 3]], axis=0)[::2].T
        model = named(np.concatenate([axes @ poses[:, :, :3], centres[:, :, None]], axis=2))
        ours, true = (
            replace(images, origin=WorldOrigin(np.array(place), geodetic=True))
            for images, place in ((model, origin), (named(poses), site))
        )
        found = evaluate_model(ours, true, align_to="none")
        assert found.centre_errors.max() < 1e-6
        assert found.rotation_errors_deg.max() < 1e-5
        assert found.note == ""


def test_without_alignment_an_origin_that_one_alone_tells_is_noted_and_one_of_another_kind_refused() -> None:
    truth = named(true_poses())
    far = replace(named(truth.poses), origin=WorldOrigin(np.array([5e5, 4e6, 0.0]), geodetic=False))
    near = replace(named(truth.poses), origin=WorldOrigin(np.array([5e5, 3.999e6, 0.0]), geodetic=False))
    assert evaluate_model(far, near, align_to="none").centre_errors == pytest.approx([1000.0] * 9)
    alone = evaluate_model(far, truth, align_to="none")
    assert "the origin of the world is told by one of both alone" in alone.note
    assert alone.centre_errors.max() == 0
    assert evaluate_model(far, truth).note == ""
    other = replace(truth, origin=WorldOrigin(np.zeros(3), geodetic=True))
    with pytest.raises(InvalidArgument, match="origin: that of one world is x, y, z, of the other"):
        evaluate_model(far, other, align_to="none")


def test_problems_and_maps_tell_the_origin_of_their_world() -> None:
    model, moved_by = problem_of(named(true_poses())), np.array([1000.0, -2000.0, 0.0])
    WorldOrigin(np.zeros(3), geodetic=False).put_into(model.metadata)
    other = model.copy()
    other.cameras[:, :, 3] -= moved_by
    WorldOrigin(moved_by, geodetic=False).put_into(other.metadata)
    for truth in (other, map_of_problem(other)):
        assert evaluate_model(model, truth, align_to="none").centre_errors.max() < 1e-9
