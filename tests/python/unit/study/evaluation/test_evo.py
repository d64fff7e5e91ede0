"""The same numbers as evo's, an independent program, on the same trajectories."""

from __future__ import annotations

import copy
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sfmcpp.model import Trajectory
from sfmcpp.sources.io.trajectories import read_trajectory, write_trajectory
from sfmcpp.study.evaluation import Evaluation, ImagePoses, associate, evaluate, evaluate_model
from trajectory_helpers import noisy, path

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    pytest.importorskip("evo", reason="evo is not installed: pip install evo")
    from evo.core import metrics, sync
    from evo.core.trajectory import PoseTrajectory3D
    from evo.tools import file_interface

RELATIONS = {
    "translation_part": metrics.PoseRelation.translation_part,
    "rotation_angle_deg": metrics.PoseRelation.rotation_angle_deg,
    "full_transformation": metrics.PoseRelation.full_transformation,
}
UNITS = {"frames": metrics.Unit.frames, "m": metrics.Unit.meters}


def evos(trajectory: Trajectory) -> Any:
    poses = np.tile(np.eye(4), (len(trajectory), 1, 1))
    poses[:, :3] = trajectory.poses
    return PoseTrajectory3D(poses_se3=list(poses), timestamps=trajectory.t_s)


def drifting(truth: Trajectory) -> Trajectory:
    """Noisy, shrinking on the way, in another frame."""
    estimate = noisy(truth)
    poses = estimate.poses.copy()
    poses[:, :, 3] *= np.linspace(0.5, 0.4, len(poses))[:, None]
    return estimate.with_poses(poses)


def assert_same_statistics(metric: Any, pair: tuple[Any, Any], ours: dict[str, float]) -> None:
    metric.process_data(pair)
    theirs = metric.get_all_statistics()
    assert set(theirs) == set(ours)
    for name, value in theirs.items():
        assert ours[name] == pytest.approx(value, rel=1e-7, abs=1e-9), name


def assert_as_evo(evaluation: Evaluation, pair: tuple[Any, Any], all_pairs: bool = False) -> None:
    content = evaluation.to_dict()
    delta, unit = evaluation.rpe_delta
    for name, relation in RELATIONS.items():
        assert_same_statistics(metrics.APE(relation), pair, content["ape"][name])
        relative = metrics.RPE(relation, delta, UNITS[unit], all_pairs=all_pairs)
        assert_same_statistics(relative, pair, content["rpe"][name])


@pytest.mark.parametrize("with_scale", [True, False])
@pytest.mark.parametrize(("rule", "count"), [("all", -1), ("first:0.25", 15), ("first:10", 10), ("none", 0)])
def test_alignment_and_errors_are_evos(rule: str, count: int, with_scale: bool) -> None:
    truth = path()
    theirs = evos(drifting(truth))
    if count:
        theirs.align(evos(truth), correct_scale=with_scale, n=count)
    ours = evaluate(drifting(truth), truth, align_to=rule, with_scale=with_scale)
    np.testing.assert_allclose(ours.estimate.centres, theirs.positions_xyz, atol=1e-9)
    assert_as_evo(ours, (evos(truth), theirs))


@pytest.mark.parametrize("all_pairs", [False, True])
@pytest.mark.parametrize(("delta", "unit"), [(1.0, "frames"), (7.0, "frames"), (5.0, "m"), (20.0, "m")])
def test_relative_errors_are_evos(delta: float, unit: str, all_pairs: bool) -> None:
    truth = path(200)
    estimate = noisy(truth)
    ours = evaluate(estimate, truth, align_to="none", delta=delta, delta_unit=unit, all_pairs=all_pairs)
    assert_as_evo(ours, (evos(truth), evos(estimate)), all_pairs)


@pytest.mark.parametrize("all_pairs", [False, True])
@pytest.mark.parametrize("delta", [0.5, 2.0, 3.3])
def test_relative_errors_over_stops_are_evos(delta: float, all_pairs: bool) -> None:
    truth = path()
    estimate = drifting(truth)
    poses = estimate.poses.copy()
    for begin, end in ((5, 9), (20, 33), (len(poses) - 4, len(poses))):  # it stands there, and turns
        poses[begin:end, :, 3] = poses[begin, :, 3]
    estimate = estimate.with_poses(poses)
    ours = evaluate(estimate, truth, align_to="none", delta=delta, delta_unit="m", all_pairs=all_pairs)
    assert_as_evo(ours, (evos(truth), evos(estimate)), all_pairs)


def test_association_is_evos() -> None:
    truth = path(80)
    rng = np.random.default_rng(3)
    jitter = Trajectory(truth.t_s + rng.uniform(-0.02, 0.02, 80), truth.poses)
    for estimate, other in [(jitter.at(np.arange(0, 80, 3)), truth), (truth, jitter.at(np.arange(5, 80, 7)))]:
        ours = associate(estimate, other)
        reference, found = sync.associate_trajectories(evos(other), evos(estimate))
        np.testing.assert_array_equal(ours.truth.t_s, reference.timestamps)
        np.testing.assert_array_equal(ours.estimate.t_s, found.timestamps)


def test_files_mean_the_same_to_evo(tmp_path: Path) -> None:
    truth = path()
    tum, kitti, euroc = tmp_path / "tum.txt", tmp_path / "kitti.txt", tmp_path / "euroc.csv"
    for file, format in ((tum, "tum"), (kitti, "kitti"), (euroc, "euroc")):
        write_trajectory(truth, file, format=format)
    for found in (
        file_interface.read_tum_trajectory_file(tum),
        file_interface.read_kitti_poses_file(kitti),
        file_interface.read_euroc_csv_trajectory(euroc),
    ):
        np.testing.assert_allclose(np.array(found.poses_se3)[:, :3], truth.poses, atol=1e-12)
    theirs = tmp_path / "theirs.txt"
    file_interface.write_tum_trajectory_file(theirs, evos(truth))
    np.testing.assert_allclose(read_trajectory(theirs).poses, truth.poses, atol=1e-12)


@pytest.mark.real
def test_a_real_drive_with_drift_is_measured_as_by_evo(data_dir: Path) -> None:
    truth = read_trajectory(data_dir / "kitti_tracks/2011_09_26_drive_0036_sync_KLT.mat")
    estimate = drifting(truth)
    theirs = copy.deepcopy(evos(estimate))
    theirs.align(evos(truth), correct_scale=True)
    assert_as_evo(evaluate(estimate, truth, delta=10.0, delta_unit="m"), (evos(truth), theirs))


@pytest.mark.parametrize("with_scale", [True, False])
def test_errors_of_images_are_evos(with_scale: bool) -> None:
    truth = path()
    estimate = drifting(truth)
    names = tuple(f"{i}.jpg" for i in range(len(truth)))
    ours = evaluate_model(
        ImagePoses(names[::-1], estimate.poses[::-1]), ImagePoses(names, truth.poses), with_scale=with_scale
    ).to_dict()
    theirs = evos(estimate)
    theirs.align(evos(truth), correct_scale=with_scale)
    pair = (evos(truth), theirs)
    assert_same_statistics(metrics.APE(RELATIONS["translation_part"]), pair, ours["centre_error"])
    assert_same_statistics(metrics.APE(RELATIONS["rotation_angle_deg"]), pair, ours["rotation_error_deg"])
